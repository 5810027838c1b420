"""What mending a cause would do to the mass: the fit once more, of a motion that is mended.

One refit costs a fraction of a replay. What a replay would do besides (other windows accepted,
another mean) is in the uncertainty.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from analysis.diagnosis.evidence import Bools
from analysis.findings.case import Case
from analysis.findings.cause import Change
from analysis.weighing.equation import Equation, begins
from analysis.weighing.joint_fit import again
from analysis.weighing.joint_result import JointFit
from analysis.weighing.kinematics import kinematics

#: Of the deviation by noise alone: what a replay accepts besides, and the mean that it takes.
_OF_REPLAY: Final = 0.5
#: Of the change itself: what is mended is not all that the cause did.
_OF_SIZE: Final = 0.05
_ROUNDS: Final = 3

#: What is left of starts that were cut is not what they were, to this share of the change.
_CUT: Final = 0.5

#: Stretches of a log that are fitted once more.
_TRIED: Final = 48
#: Fewer samples are not fitted.
_FEWEST: Final = 200
_SHORTEST: Final = 20

Mend = Callable[[Equation], Equation]


def left_out(case: Case, rows: Bools) -> Change | None:
    """Fit once more without samples, which leaves some starts as another answer would have them.

    Args:
        case: the log.
        rows: (n,) grid samples that say nothing.
    """
    return anew(case, lambda motion: motion.without(rows), _CUT)


def anew(case: Case, mend: Mend, relative_u: float = 0.0) -> Change | None:
    """Fit once more where the answer as it is says little of what a replay will say.

    Args:
        case: the log.
        mend: makes the motion as it would be.
        relative_u: as of `mended`.
    """
    change = mended(case, mend, relative_u)
    if change is None or case.fit is None:
        return None
    return Change(change.kg, float(np.hypot(change.u_kg, case.fit.u_kg)))


def mended(case: Case, mend: Mend, relative_u: float = 0.0) -> Change | None:
    """Fit once more from the joint fit on, and compare with the mass of the motion as it is.

    Args:
        case: the log.
        mend: makes the motion as it would be.
        relative_u: standard uncertainty of what is mended, as a share of it.
    """
    fit = case.fit
    if fit is None:
        return None
    before, after = _before_kg(case, fit), _mass_kg(case, mend(fit.motion))
    if before is None or after is None:
        return None
    kg = after - before
    of_noise = fit.parts_kg(fit.weights(fit.main))["noise"]
    return Change(kg, float(np.hypot(max(relative_u, _OF_SIZE) * kg, _OF_REPLAY * of_noise)))


def _before_kg(case: Case, fit: JointFit) -> float | None:
    """The mass of the motion as it is: the fit's own, or that of the same part of a long log."""
    if "refitted" not in case.kept:
        whole = np.unique(fit.motion.group[fit.motion.used]).size <= _TRIED
        if whole and fit.states is not None:
            case.kept["states"] = fit.states.count
        case.kept["refitted"] = fit.mass_kg if whole else _mass_kg(case, fit.motion)
    return case.kept["refitted"]  # type: ignore[return-value]


def _mass_kg(case: Case, motion: Equation) -> float | None:
    fit, noise = case.fit, case.column_noise
    if fit is None or noise is None:
        return None
    priors = case.machine.settings.priors
    # of a long log a part says as much of what a cause does
    motion = whole_stretches(motion.beginning(_TRIED))
    if motion.used.sum() < _FEWEST:
        return None
    wheels = kinematics(motion, noise, priors)
    states = None if fit.states is None else fit.states.among(motion)
    if states is not None and states.count != case.kept.setdefault("states", states.count):
        return None
    begun = replace(fit, motion=motion, kinematics=wheels, states=states)
    found = again(begun, noise, priors, rounds=_ROUNDS).mass_kg
    return found if np.isfinite(found) else None


def whole_stretches(motion: Equation) -> Equation:
    """The motion with its stretches numbered anew: what was left out may have cut some in two."""
    parts = np.where(motion.used, np.cumsum(begins(motion.group)) - 1, -1)
    size = np.bincount(parts[parts >= 0], minlength=1)
    short = (parts >= 0) & (size[np.maximum(parts, 0)] < _SHORTEST)
    return replace(motion, group=parts.astype(np.int64)).without(short)
