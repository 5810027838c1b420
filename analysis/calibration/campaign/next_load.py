"""Choice of the next load: the one that reduces the line's uncertainty most (D-optimal)."""

from dataclasses import dataclass, replace

import numpy as np

from analysis.calibration.line.calibration import Calibration, Point
from analysis.calibration.line.line_inversion import Inversion
from analysis.calibration.line.line_model import DAY, DAYS_ENOUGH, Points, make_scatter
from analysis.calibration.line.variance_components import (
    Variances,
    WithinRunVariance,
    expected_information,
)
from estimators.arrays import Floats


@dataclass(frozen=True, slots=True)
class NextLoad:
    """A possible additional run, on a day of its own.

    Attributes:
        load_id: load on board.
        reference_kg: its reference.
        determinant_1: determinant of the covariance of level and slope, relative to the present
            one.
        half_width_kg: largest half interval of a later mass at the references, with the run.
        half_width_now_kg: the same without the run.
    """

    load_id: str
    reference_kg: float
    determinant_1: float
    half_width_kg: float
    half_width_now_kg: float


def rank_next_loads(calibration: Calibration, *, same_day: bool = False) -> tuple[NextLoad, ...]:
    """Rank the campaign's loads by the benefit of one more run, the best first.

    Variances stay as estimated. The run has the median number of readings, and its degrees of
    freedom count.

    Args:
        calibration: calibration of the campaign so far.
        same_day: whether the run is on the campaign's last day rather than on a new one.

    Source:
        D-optimality: Atkinson, Donev and Tobias, Optimum Experimental Designs, 10.
    """
    used = [point for point in calibration.points if point.mean_kg is not None]
    ends = [reference.reference_kg for reference in calibration.references]
    now = inversion_with_points(calibration, used)
    now_kg = _widest_half_interval_kg(calibration, now, ends)
    found: list[NextLoad] = []
    for reference in calibration.references:
        more = replace(
            used[-1],
            load_id=reference.load_id,
            day=used[-1].day if same_day else unused_day(used),
            reference_kg=reference.reference_kg,
            readings=calibration.budget_at[1],
        )
        then = inversion_with_points(calibration, [*used, more])
        found.append(
            NextLoad(
                load_id=reference.load_id,
                reference_kg=reference.reference_kg,
                # equal ones stay equal: by rounding alone one would be better
                determinant_1=round(
                    _covariance_determinant(then) / _covariance_determinant(now), 9
                ),
                half_width_kg=_widest_half_interval_kg(calibration, then, ends),
                half_width_now_kg=now_kg,
            )
        )
    return tuple(sorted(found, key=lambda one: (one.determinant_1, one.load_id)))


def unused_day(used: list[Point]) -> str:
    """Day label that no run uses."""
    return max((point.day for point in used), key=len) + "+"


def _covariance_determinant(inversion: Inversion) -> float:
    """Determinant of the covariance of level and slope of the line."""
    covariance = np.tensordot(inversion.variance_kg2, inversion.on_line, 1)
    return float(np.linalg.det(covariance))


def _widest_half_interval_kg(
    calibration: Calibration, inversion: Inversion, at_kg: list[float]
) -> float:
    """Largest half interval of a later mass at these masses."""
    confidence_1, readings = calibration.confidence_1, float(calibration.budget_at[1])
    return max(inversion.half_interval_kg(mass_kg, confidence_1, readings) for mass_kg in at_kg)


def inversion_with_points(calibration: Calibration, points: list[Point]) -> Inversion:
    """The calibration's line with its variances, as if fitted to these points."""
    loads = {one.load_id: k for k, one in enumerate(calibration.references)}
    days = list(dict.fromkeys(point.day for point in points))
    reference_kg = np.array([one.reference_kg for one in calibration.references])
    load = np.array([loads[point.load_id] for point in points], np.int64)
    design = np.column_stack([np.ones(load.size), reference_kg[load] - calibration.centre_kg])
    readings = np.array([point.readings for point in points], np.int64)
    as_points = Points(
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
    scatter = make_scatter(as_points, names, next(known_days, None))
    slope, x_cov = calibration.c1_1, as_points.x_cov_kg2
    mean_squares: Floats = np.linalg.solve(scatter.squares, value).astype(np.float64)
    information = expected_information(
        design,
        scatter.mean_square_covariances,
        scatter.known_covariance + slope**2 * x_cov,
        as_points.within,
        mean_squares,
    )
    covariance = np.asarray(np.linalg.pinv(information, hermitian=True), np.float64)
    variances = Variances(mean_squares, covariance).combine_linearly(scatter.squares)
    effects = scatter.effects_on_line(variances, design, slope, x_cov)
    several_days = DAY in names and len(days) < DAYS_ENOUGH
    return replace(
        calibration.inversion,
        on_line=np.array([effect.on_line for effect in effects]),
        covariance=variances.covariance,
        few_dof={DAY: len(days) - 1} if several_days else {},
        most_readings=int(readings.max()),
    )
