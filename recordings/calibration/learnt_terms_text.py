"""Make the tables of nuisances of the joint fit that a calibration learnt besides its line."""

from collections.abc import Mapping
from typing import Any, Final

from analysis.calibration.use.learnt_priors import LearntPriors
from analysis.model.prior_settings import LearnableTerm

#: Meaning and unit of each term.
TERMS: Final[Mapping[LearnableTerm, tuple[str, str]]] = {
    "const": ("constant force", "N"),
    "lag": ("delay of the force", "s"),
    "slip": ("friction of slipping wheels", "s/m"),
    "quadratic": ("resistance that grows with the square of the speed", "N·s²/m²"),
    "direction": ("Coulomb friction", "N"),
    "load_transfer": ("share of the force that moves with the acceleration", "s²/m"),
    "wheel_slip": ("slip of the wheels against the accelerometer", "1/N"),
    "gain": ("gain of the wheels' speed against the accelerometer", "1"),
    "speed_delay": ("delay of the wheels' speed", "s"),
}


#: Runs of a campaign that would determine a term better.
RUNS: Final[Mapping[LearnableTerm, str]] = {
    "const": "runs in both directions, at different throttles",
    "lag": "runs with sharper starts",
    "slip": "runs at different throttles",
    "quadratic": "runs that cruise at several speeds",
    "direction": "runs in both directions, at different throttles",
    "load_transfer": "runs at different throttles",
    "wheel_slip": "runs at different throttles",
    "gain": "a known distance rolled, for the wheel radius",
    "speed_delay": "runs with sharper starts",
}


def make_learnt_term_rows(learnt: LearntPriors | None) -> list[Mapping[str, Any]]:
    """Make rows on learnt terms: term, unit, mean and its uncertainty, width, number of logs.

    Args:
        learnt: learnt priors of the evidence; None if there are none.
    """
    if learnt is None:
        return []
    return [
        {
            "term": TERMS[term][0],
            "unit": TERMS[term][1],
            "mean": f"{prior.mean:.3g}",
            "mean_u": f"{prior.mean_u:.2g}",
            "width": f"{prior.std:.2g}",
            "logs": sum(each.term == term for each in learnt.logs),
        }
        for term, prior in learnt.terms.items()
    ]
