"""The uncertainty budget of a calibrated mass (GUM), and the next load that reduces it most."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from analysis.calibration.line.calibration import (
    BudgetRow,
    Calibration,
    Component,
    Point,
    StatedPart,
)
from analysis.calibration.line.line_inversion import LineInversion
from analysis.calibration.line.line_limits import LIMITS
from analysis.calibration.line.line_model import (
    DAY,
    LACK_OF_FIT,
    REFERENCES,
    REPEATABILITY,
    RUN,
    RunMeans,
    make_covariance_structure,
)
from analysis.calibration.line.variance_components import (
    Variances,
    WithinRunVariance,
    compute_expected_information,
)
from estimators.arrays import Floats

#: Components that a budget of weighing must list, stated or not.
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


class LineUncertainty(NamedTuple):
    """Standard uncertainty of the calibration line at one mass, in kg of m̂, by cause."""

    centroid_kg: float
    slope_kg: float
    references_kg: float


def make_calibration_budget(
    inversion: LineInversion,
    components: Sequence[Component],
    stated_parts: Sequence[StatedPart],
    mass_kg_and_readings: tuple[float, int],
    common_kg: float | None,
) -> tuple[BudgetRow, ...]:
    """Rows of all components in kg of calibrated mass; their squares add up to the total.

    Args:
        inversion: inversion of the line.
        components: components of the line, in the order of its effects.
        stated_parts: components that the points do not show.
        mass_kg_and_readings: the mass, and its number of readings.
        common_kg: common error that counts, in kg of m̂; None if the line absorbs it.
    """
    mass_kg, readings = mass_kg_and_readings
    anew = clip_negative_variances_to_stds_kg(
        inversion.compute_later_mass_variance_by_effect_kg2(readings), components
    )
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
    level, slope, references = split_line_uncertainty(inversion, mass_kg)
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
    rows += [_make_stated_budget_row(one, size) for one in stated_parts]
    given = {one.component for one in stated_parts}
    for name in EXPECTED:
        if name == "tare" and name not in given:
            rows.append(BudgetRow(name, "stated", None, None, _TARE_UNSTATED))
        elif name not in given:
            rows.append(BudgetRow(name, "absorbed", None, None, _UNSTATED))
    return tuple(rows)


def clip_negative_variances_to_stds_kg(
    parts_kg2: Floats, components: Sequence[Component]
) -> Floats:
    """(effects,) standard deviations in kg; a negative variance reduces the next finer effect."""
    parts = parts_kg2.copy()
    names = [component.name for component in components]
    for coarse, fine in ((DAY, RUN), (RUN, REPEATABILITY)):
        if coarse in names and fine in names:
            over = min(parts[names.index(coarse)], 0.0)
            parts[names.index(coarse)] -= over
            parts[names.index(fine)] += over
    return np.sqrt(np.maximum(parts, 0.0))


def split_line_uncertainty(inversion: LineInversion, mass_kg: float) -> LineUncertainty:
    """Uncertainty of the line at a mass, in kg of m̂: due to centroid, slope and references."""
    own = inversion.scatters > 0.0
    line = np.tensordot(inversion.variance_kg2[own], inversion.on_line[own], 1)
    h = mass_kg - inversion.centre_kg
    across = line[0, 1] / line[1, 1] if line[1, 1] > 0.0 else 0.0
    level = max(line[0, 0] - across * line[0, 1], 0.0)
    slope = line[1, 1] * (h + across) ** 2
    given = np.tensordot(inversion.variance_kg2[~own], inversion.on_line[~own], 1)
    references = given[0, 0] + 2.0 * h * given[0, 1] + h**2 * given[1, 1]
    variances_kg2 = level, slope, max(references, 0.0)
    return LineUncertainty(*(float(np.sqrt(each)) for each in variances_kg2))


def _make_stated_budget_row(stated_part: StatedPart, mass_kg: float) -> BudgetRow:
    """Budget row of a stated component; its uncertainty is 0 if the line absorbs it."""
    if stated_part.absorbed:
        before = (
            ""
            if stated_part.u_kg is None
            else f"; {stated_part.u_kg / mass_kg:.3g} kg without a calibration"
        )
        known = f"{stated_part.known}; the line takes it with it{before}"
        return BudgetRow(stated_part.component, "absorbed", 0.0, None, known)
    u_kg = None if stated_part.u_kg is None else stated_part.u_kg / mass_kg
    return BudgetRow(stated_part.component, "stated", u_kg, None, stated_part.known)


@dataclass(frozen=True, slots=True)
class NextLoad:
    """A possible additional run, on a day of its own.

    Attributes:
        load_id: load on board.
        reference_kg: reference mass of the load.
        determinant_1: determinant of the covariance of level and slope with the run, over the
            present one.
        half_width_kg: largest half interval of a later mass at the references, with the run.
        half_width_now_kg: that half interval without the run.
    """

    load_id: str
    reference_kg: float
    determinant_1: float
    half_width_kg: float
    half_width_now_kg: float


def rank_loads_for_next_run(
    calibration: Calibration, *, is_on_last_campaign_day: bool = False
) -> tuple[NextLoad, ...]:
    """Rank the campaign's loads by the benefit of one more run, the best first.

    Variances stay as estimated. The run has the median number of readings, and its degrees of
    freedom count.

    Args:
        calibration: calibration of the campaign so far.
        is_on_last_campaign_day: whether the run is on the campaign's last day, not on a new one.

    Source:
        D-optimality: Atkinson, Donev and Tobias, Optimum Experimental Designs, 10.
    """
    used = [point for point in calibration.points if point.mean_kg is not None]
    ends = [reference.reference_kg for reference in calibration.references]
    now = make_line_inversion_for_points(calibration, used)
    now_kg = compute_widest_half_interval_kg(calibration, now, ends)
    found: list[NextLoad] = []
    for reference in calibration.references:
        more = replace(
            used[-1],
            load_id=reference.load_id,
            day=used[-1].day
            if is_on_last_campaign_day
            else make_day_label_absent_from_points(used),
            reference_kg=reference.reference_kg,
            readings=calibration.budget_at[1],
        )
        then = make_line_inversion_for_points(calibration, [*used, more])
        found.append(
            NextLoad(
                load_id=reference.load_id,
                reference_kg=reference.reference_kg,
                # rounded, so that equal loads are not ranked by rounding errors
                determinant_1=round(
                    compute_determinant_of_line_covariance(then)
                    / compute_determinant_of_line_covariance(now),
                    9,
                ),
                half_width_kg=compute_widest_half_interval_kg(calibration, then, ends),
                half_width_now_kg=now_kg,
            )
        )
    return tuple(sorted(found, key=lambda one: (one.determinant_1, one.load_id)))


def make_day_label_absent_from_points(points: list[Point]) -> str:
    """Day label that no run uses."""
    return max((point.day for point in points), key=len) + "+"


def compute_determinant_of_line_covariance(inversion: LineInversion) -> float:
    """Determinant of the covariance of level and slope of the line."""
    covariance = np.tensordot(inversion.variance_kg2, inversion.on_line, 1)
    return float(np.linalg.det(covariance))


def compute_widest_half_interval_kg(
    calibration: Calibration, inversion: LineInversion, masses_kg: list[float]
) -> float:
    """Largest half interval of a later mass, in kg, over the given masses."""
    confidence_1, readings = calibration.confidence_1, float(calibration.budget_at[1])
    return max(
        inversion.compute_half_interval_kg(mass_kg, confidence_1, readings) for mass_kg in masses_kg
    )


def make_line_inversion_for_points(calibration: Calibration, points: list[Point]) -> LineInversion:
    """The calibration's line with its variances, as if fitted to these points."""
    loads = {one.load_id: k for k, one in enumerate(calibration.references)}
    days = list(dict.fromkeys(point.day for point in points))
    reference_kg = np.array([one.reference_kg for one in calibration.references])
    load = np.array([loads[point.load_id] for point in points], np.int64)
    design = np.column_stack([np.ones(load.size), reference_kg[load] - calibration.centre_kg])
    readings = np.array([point.readings for point in points], np.int64)
    as_points = RunMeans(
        y_kg=design @ np.array([calibration.level_kg, calibration.c1_1]),
        readings=readings,
        load=load,
        day=np.array([days.index(point.day) for point in points], np.int64),
        reference_kg=reference_kg,
        covariance_kg2=np.array(calibration.references_covariance_kg2),
        within=WithinRunVariance(0.0, int((readings - 1).sum())),
    )
    components = calibration.components
    value = np.array([one.variance_kg2 for one in components if one.estimated])
    names = tuple(one.name for one in components if one.estimated)
    known_days = (one.std_kg for one in components if one.name == DAY and not one.estimated)
    scatter = make_covariance_structure(as_points, names, next(known_days, None))
    slope, x_cov = calibration.c1_1, as_points.x_cov_kg2
    mean_squares: Floats = np.linalg.solve(scatter.squares, value).astype(np.float64)
    information = compute_expected_information(
        design,
        scatter.mean_square_covariances,
        scatter.known_covariance + slope**2 * x_cov,
        as_points.within,
        mean_squares,
    )
    covariance = np.asarray(np.linalg.pinv(information, hermitian=True), np.float64)
    variances = Variances(mean_squares, covariance).propagate_to_linear_combinations(
        scatter.squares
    )
    effects = scatter.describe_effects_on_line(variances, design, slope, x_cov)
    several_days = DAY in names and len(days) < LIMITS.enough_days
    return replace(
        calibration.inversion,
        on_line=np.array([effect.on_line for effect in effects]),
        covariance=variances.covariance,
        degrees_of_freedom_by_scarce_effect={DAY: len(days) - 1} if several_days else {},
        most_readings=int(readings.max()),
    )
