"""Comparison of the paper's estimates with the joint fit: which of them it contradicts."""

from typing import Final, NamedTuple

import numpy as np

from analysis.diagnosis.check_inputs import CheckInputs
from analysis.model.schema import column_values

#: So many deviations of both together contradict a method, if it matters by this share.
_CONTRADICTS: Final = 3.0
_MATTERS: Final = 0.01
#: A term this many deviations from 0 is there.
_TERM_IS_THERE: Final = 3.0


class Disagreement(NamedTuple):
    """Distance of a method from the answer in standard deviations, and whether it disagrees."""

    method: str
    deviations: float
    contradicted: bool


def compare_methods_with_joint_fit(inputs: CheckInputs) -> list[Disagreement]:
    """Compare every method that has a mass with the joint fit.

    A method without nuisance terms assumes that they are 0, except for a configured Coulomb term.
    If the log shows a term that is not 0, or if its starts disagree, the method's own deviation is
    too small, and its interval must at least contain that of the answer. With several loads no
    method agrees, since each estimates one mass.
    """
    weighing, totals = inputs.weighing, inputs.totals
    if weighing is None or totals is None:
        return []
    fit = weighing.fit
    modelled = _nuisances_shared_with_methods(inputs)
    shows = any(t > _TERM_IS_THERE for term, t in fit.term_t_values.items() if term not in modelled)
    shows = shows or bool(fit.fit.misfit.any())
    shows = shows or (fit.states is not None and fit.states.has_excess_scatter)
    out: list[Disagreement] = []
    columns = (
        totals["method"].to_list(),
        column_values(totals, "mass_kg"),
        column_values(totals, "mass_std_kg"),
    )
    for method, mass_kg, std_kg in zip(*columns, strict=True):
        if not np.isfinite(mass_kg):
            continue
        difference_kg = mass_kg - fit.mass_kg
        if fit.count > 1 or not np.isfinite(std_kg):
            out.append(Disagreement(method, np.inf, contradicted=True))
            continue
        deviations = difference_kg / float(np.hypot(std_kg, fit.u_kg))
        far = abs(deviations) > _CONTRADICTS and abs(difference_kg) > _MATTERS * abs(fit.mass_kg)
        misses = shows and abs(difference_kg) + fit.u_kg > 1.96 * std_kg
        out.append(Disagreement(method, float(deviations), contradicted=far or misses))
    return out


def _nuisances_shared_with_methods(inputs: CheckInputs) -> set[str]:
    """Nuisances that the methods also model: the Coulomb term, or a constant for one direction."""
    if inputs.weighing is None or not inputs.machine.settings.forces.coulomb:
        return set()
    return {"direction" if inputs.weighing.fit.motion.drives_both_ways else "const"}
