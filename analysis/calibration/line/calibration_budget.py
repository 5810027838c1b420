"""The uncertainty budget of a calibrated mass (GUM)."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from analysis.calibration.line.calibration import BudgetRow, Component, StatedPart
from analysis.calibration.line.line_inversion import Inversion
from analysis.calibration.line.line_model import DAY, LACK_OF_FIT, REFERENCES, REPEATABILITY, RUN
from estimators.arrays import Floats

#: What a budget of weighing has to name, stated or not.
EXPECTED: Final = ("wheel radius", "force share", "local gravity", "tare")
_UNSTATED: Final = "not stated; a constant of the machine, which the line takes with it"
_TARE_UNSTATED: Final = "not stated beside what the references have of it"
_KINDS: Final = {REPEATABILITY: "random", RUN: "random", DAY: "day", LACK_OF_FIT: "line"}
_MEANINGS: Final = {
    REPEATABILITY: "readings of one run about their mean",
    RUN: "runs about the line, beyond their readings' scatter",
    DAY: "means of days about the line",
    LACK_OF_FIT: "means of loads about the line, beyond the scatter of their runs",
}


def calibration_budget_rows(
    inversion: Inversion,
    components: Sequence[Component],
    stated_parts: Sequence[StatedPart],
    at: tuple[float, int],
    common_kg: float | None,
) -> tuple[BudgetRow, ...]:
    """Rows of all components in kg of calibrated mass; their squares add up to the total.

    Args:
        inversion: inversion of the line.
        components: components of the line, in its order.
        stated_parts: components that the points do not show.
        at: the mass, and its number of readings.
        common_kg: common error that counts, in kg of m̂; None if the line absorbs it.
    """
    mass_kg, readings = at
    anew = clip_negative_parts(inversion.variance_parts_kg2(readings), components)
    size = abs(inversion.slope_1)
    rows = [
        BudgetRow(
            component.name,
            _KINDS[component.name],
            float(u_kg),
            component.freedom,
            _MEANINGS[component.name]
            + ("" if component.freedom is not None else "; stated, not estimated"),
        )
        for component, u_kg in zip(components, anew, strict=True)
        if component.scatters
    ]
    names = {row.component for row in rows}
    if DAY not in names:
        rows.append(BudgetRow(DAY, "day", None, None, "unknown: the runs do not tell it apart"))
    if LACK_OF_FIT not in names:
        rows.append(
            BudgetRow(LACK_OF_FIT, "line", 0.0, None, "none found beyond the runs' scatter")
        )
    level, slope, references = line_uncertainty_parts_kg(inversion, mass_kg)
    rows += [
        BudgetRow("level", "line", level / size, None, "of the line at its centroid"),
        BudgetRow("slope", "line", slope / size, None, "of the line, at this mass"),
        BudgetRow(
            REFERENCES, "line", references / size, None, "certificates, with what they share"
        ),
    ]
    if common_kg is None:
        rows.append(
            BudgetRow("common error", "absorbed", 0.0, None, "priors and scale: in every m̂ alike")
        )
    else:
        known = "priors and scale: no second day shows whether they stay, so they count once"
        rows.append(BudgetRow("common error", "stated", common_kg / size, None, known))
    rows += [_make_stated_row(one, size) for one in stated_parts]
    given = {one.component for one in stated_parts}
    for name in EXPECTED:
        if name == "tare" and name not in given:
            rows.append(BudgetRow(name, "stated", None, None, _TARE_UNSTATED))
        elif name not in given:
            rows.append(BudgetRow(name, "absorbed", None, None, _UNSTATED))
    return tuple(rows)


def clip_negative_parts(parts_kg2: Floats, components: Sequence[Component]) -> Floats:
    """(effects,) standard deviations; a negative variance reduces the next finer effect."""
    parts = parts_kg2.copy()
    names = [component.name for component in components]
    for coarse, fine in ((DAY, RUN), (RUN, REPEATABILITY)):
        if coarse in names and fine in names:
            over = min(parts[names.index(coarse)], 0.0)
            parts[names.index(coarse)] -= over
            parts[names.index(fine)] += over
    return np.sqrt(np.maximum(parts, 0.0))


def line_uncertainty_parts_kg(inversion: Inversion, mass_kg: float) -> tuple[float, float, float]:
    """Uncertainty of the line at a mass, in kg of m̂: due to centroid, slope and references."""
    own = inversion.scatters > 0.0
    line = np.tensordot(inversion.variance_kg2[own], inversion.on_line[own], 1)
    h = mass_kg - inversion.centre_kg
    across = line[0, 1] / line[1, 1] if line[1, 1] > 0.0 else 0.0
    level = max(line[0, 0] - across * line[0, 1], 0.0)
    slope = line[1, 1] * (h + across) ** 2
    given = np.tensordot(inversion.variance_kg2[~own], inversion.on_line[~own], 1)
    references = given[0, 0] + 2.0 * h * given[0, 1] + h**2 * given[1, 1]
    return float(np.sqrt(level)), float(np.sqrt(slope)), float(np.sqrt(max(references, 0.0)))


def _make_stated_row(one: StatedPart, size: float) -> BudgetRow:
    """Row of a stated component; zero if the line absorbs it."""
    if one.absorbed:
        before = "" if one.u_kg is None else f"; {one.u_kg / size:.3g} kg without a calibration"
        known = f"{one.known}; the line takes it with it{before}"
        return BudgetRow(one.component, "absorbed", 0.0, None, known)
    u_kg = None if one.u_kg is None else one.u_kg / size
    return BudgetRow(one.component, "stated", u_kg, None, one.known)
