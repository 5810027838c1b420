"""Fit of a calibration to a campaign's readings: line, test of its fit, and notes."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import polars as pl
from scipy.special import fdtrc

from analysis.calibration.line.calibration import (
    Calibration,
    CalibrationOptions,
    Component,
    LackOfFit,
    Reference,
    sum_variance_not_in_scatter_of_points_kg2,
)
from analysis.calibration.line.calibration_budget import make_calibration_budget
from analysis.calibration.line.calibration_points import (
    CampaignPoints,
    average_used_readings_by_run,
)
from analysis.calibration.line.distance_regression import fit_line_by_generalised_distance
from analysis.calibration.line.line_inversion import LineInversion
from analysis.calibration.line.line_limits import LIMITS
from analysis.calibration.line.line_model import (
    DAY,
    REPEATABILITY,
    RUN,
    FittedLine,
    RunMeans,
    choose_estimable_random_effects,
    fit_line_and_variances,
    make_covariance_structure,
)
from analysis.calibration.line.outliers import find_outlying_readings_and_runs
from analysis.calibration.line.point_errors import (
    compute_rms_without_none,
    compute_scatter_to_stated_std_ratio,
    estimate_slope_attenuation,
    make_point_rows,
)
from analysis.calibration.line.shared_errors import (
    RunResponse,
    compute_line_changes_per_learnt_mean_u,
)
from analysis.calibration.line.variance_components import estimate_variances_by_reml
from estimators.arrays import Floats
from estimators.errors import DataError

_NEEDED: Final = ("run_id", "load_id", "day", "mass_kg", "used")


def compute_lack_of_fit_test(points: RunMeans, known_day_std_kg: float | None) -> LackOfFit:
    """Test the means of the loads against the line.

    Args:
        points: means of runs.
        known_day_std_kg: known standard deviation between days, in kg of m̂; None if unknown.

    Returns:
        The F test: its ratio, probability and degrees of freedom, all None if the points allow no
        test, and what the loads' deviations are compared with.
    """
    design = (points.load[:, None] == np.unique(points.load)[None, :]).astype(np.float64)
    loads, count = design.shape[1], points.y_kg.size
    names = choose_estimable_random_effects(
        points, loads, is_day_variance_known=known_day_std_kg is not None
    )
    above = loads - 2
    below = count - loads - (points.day_count - 1 if DAY in names else 0)
    against = "run to run, at the same load"
    if RUN not in names:
        below, against = (
            points.within.degrees_of_freedom,
            "repeatability; run to run would look the same",
        )
    if above < 1 or below < 1 or not names:
        return LackOfFit(
            None,
            None,
            None,
            "nothing: no load has two runs, nor a run two readings",
            separate=False,
        )
    scatter = make_covariance_structure(points, names, known_day_std_kg)
    found = estimate_variances_by_reml(
        points.y_kg,
        design,
        scatter.mean_square_covariances,
        scatter.known_covariance,
        points.within,
    )
    y_cov = scatter.combine_effect_covariances(
        found.propagate_to_linear_combinations(scatter.squares).value
    )
    x_cov = points.x_cov_kg2
    fitted = fit_line_by_generalised_distance(points.x_kg, points.y_kg, x_cov, y_cov)
    weight = np.linalg.inv(y_cov + fitted.slope**2 * x_cov)
    means = np.linalg.solve(design.T @ weight @ design, design.T @ weight @ points.y_kg)
    left = points.y_kg - design @ means
    ratio = max(fitted.chi2 - float(left @ weight @ left), 0.0) / above
    p = float(fdtrc(above, below, ratio))
    return LackOfFit(ratio, p, (above, below), against, separate=RUN in names)


def fit_calibration_line(
    readings: pl.DataFrame,
    references: pl.DataFrame,
    covariance_kg2: Floats,
    options: CalibrationOptions,
    responses: Sequence[RunResponse] = (),
) -> Calibration:
    """Fit m̂ = c0 + c1 m to the means of runs, and all numbers that later masses need.

    The covariance of the line contains errors of the references, including shared sources, and the
    scatter of readings, runs and days. An error common to all points shifts the line without a
    residual, so it is not part of the noise of a point.

    Args:
        readings: a row per reading: run_id, load_id, day, mass_kg, used; std_kg, common_u_kg and
            reading if known. Unused readings stay listed.
        references: a row per load: load_id, reference_kg.
        covariance_kg2: (loads, loads) covariance of the references, in their order.
        options: method, confidence and known components.
        responses: responses of runs to errors of learnt means.

    Raises:
        DataError: fewer than three loads, no slope, or references that do not match the readings.

    Source:
        ISO/TS 28037:2010 (line), Patterson and Thompson (1971) (variances), Fieller (1954)
        (intervals), JCGM 100:2008 (budget).
    """
    missing = [name for name in _NEEDED if name not in readings.columns]
    if missing:
        raise DataError(f"calibration: the readings have no column '{missing[0]}'; add it")
    campaign = average_used_readings_by_run(readings, references, covariance_kg2)
    points = campaign.points
    line, test = fit_line_and_test_lack_of_fit(points, options.day_known_kg)
    day_unknown = options.day_known_kg is None and points.day_count == 1
    common_kg = find_largest_common_u_kg(campaign.readings)
    counted_kg = common_kg if day_unknown else 0.0
    inversion = LineInversion.from_line(
        line, sum_variance_not_in_scatter_of_points_kg2(options.stated, counted_kg)
    )
    components = list_variance_components(line, campaign)
    low, high = float(points.x_kg.min()), float(points.x_kg.max())
    margin = options.margin_1 * (high - low)
    at = (high + margin, int(np.median(points.readings)))
    u_kg = inversion.compute_later_mass_u_kg(*at)
    half_kg = inversion.compute_half_interval_kg(at[0], options.confidence_1, at[1])
    rows = make_point_rows(campaign, line)
    left_out = [row.error_left_out_kg for row in rows]
    c0 = line.level_kg - line.slope_1 * line.centre_kg
    shift = np.array([[1.0, -line.centre_kg], [0.0, 1.0]])
    covariance = shift @ np.tensordot(inversion.variance_kg2, inversion.on_line, 1) @ shift.T
    by_name = {component.name: component for component in components}
    day = by_name.get(DAY)
    calibration = Calibration(
        method=options.method,
        confidence_1=options.confidence_1,
        alpha_1=1.0 / line.slope_1,
        alpha_interval_1=compute_alpha_confidence_interval(inversion, options.confidence_1),
        beta_kg=-c0 / line.slope_1,
        beta_interval_kg=compute_beta_confidence_interval_kg(inversion, options.confidence_1),
        c0_kg=c0,
        c1_1=line.slope_1,
        covariance=_list_level_variance_covariance_slope_variance(covariance),
        centre_kg=line.centre_kg,
        level_kg=line.level_kg,
        chi2_1=line.chi2,
        freedom=line.degrees_of_freedom,
        repeatability_kg=by_name[REPEATABILITY].std_kg if REPEATABILITY in by_name else None,
        repeatability_freedom=points.within.degrees_of_freedom,
        run_kg=by_name[RUN].std_kg if RUN in by_name else None,
        run_freedom=line.degrees_of_freedom
        - (points.day_count - 1 if day and day.estimated else 0),
        day_kg=day.std_kg if day else None,
        day_freedom=points.day_count - 1 if day and day.estimated else None,
        components=components,
        few_days=line.day_degrees_of_freedom,
        most_readings=line.most_readings,
        variance_covariance=tuple(tuple(map(float, row)) for row in line.variances.covariance),
        stated=options.stated,
        common_kg=common_kg,
        common_counts=day_unknown,
        lack_of_fit=test,
        references=tuple(Reference(*row) for row in campaign.references.iter_rows()),
        references_covariance_kg2=tuple(tuple(map(float, row)) for row in points.covariance_kg2),
        points=rows,
        outliers=find_outlying_readings_and_runs(campaign, line),
        rms_error_kg=compute_rms_without_none([row.error_kg for row in rows]) or 0.0,
        rms_error_left_out_kg=compute_rms_without_none(left_out),
        attenuation_1=estimate_slope_attenuation(campaign),
        stated_ratio_1=compute_scatter_to_stated_std_ratio(campaign),
        range_kg=(low - margin, high + margin),
        budget=make_calibration_budget(
            inversion, components, options.stated, at, common_kg if day_unknown else None
        ),
        budget_at=at,
        coverage_k_1=half_kg / u_kg,
        u_kg=u_kg,
        says=(),
        responses=compute_line_changes_per_learnt_mean_u(
            responses,
            {row.run_id: row.reference_kg for row in rows if row.readings},
            line.centre_kg,
        ),
    )
    return replace(calibration, says=list_calibration_notes(calibration))


def fit_line_and_test_lack_of_fit(
    points: RunMeans, known_day_std_kg: float | None
) -> tuple[FittedLine, LackOfFit]:
    """Fit the line, with an extra deviation of each load if the points show one.

    Args:
        points: means of runs.
        known_day_std_kg: known standard deviation between days, in kg of m̂; None if unknown.
    """
    test = compute_lack_of_fit_test(points, known_day_std_kg)
    lacking = test.separate and test.p_1 is not None and test.p_1 < LIMITS.lack_of_fit_probability
    line = fit_line_and_variances(
        points, known_day_std_kg=known_day_std_kg, has_lack_of_fit=lacking
    )
    if line.slope_1 == 0.0:
        raise DataError(
            "calibration: the estimates do not change with the reference masses; check the mass "
            "of each log"
        )
    return line, test


def list_variance_components(line: FittedLine, campaign: CampaignPoints) -> tuple[Component, ...]:
    """Effects of the line as components of the calibration, in plain numbers."""
    found: list[Component] = []
    place = 0
    for effect in line.effects:
        degrees_of_freedom: float | None = None
        if effect.estimated:
            degrees_of_freedom = count_degrees_of_freedom_of_variance(
                effect.name, effect.variance_kg2, line, campaign, place
            )
            place += 1
        found.append(
            Component(
                name=effect.name,
                variance_kg2=effect.variance_kg2,
                freedom=degrees_of_freedom,
                on_line=_list_level_variance_covariance_slope_variance(effect.on_line),
                estimated=effect.estimated,
                scatters=effect.scatters,
            )
        )
    return tuple(found)


def count_degrees_of_freedom_of_variance(
    effect_name: str,
    variance_kg2: float,
    line: FittedLine,
    campaign: CampaignPoints,
    effect_index: int,
) -> float:
    """Degrees of freedom of an estimated variance; for readings they are counted exactly."""
    if effect_name == REPEATABILITY:
        return float(campaign.points.within.degrees_of_freedom)
    uncertain = float(line.variances.covariance[effect_index, effect_index])
    return 2.0 * variance_kg2**2 / uncertain if min(variance_kg2, uncertain) > 0.0 else 0.0


def _list_level_variance_covariance_slope_variance(
    covariance: Floats,
) -> tuple[float, float, float]:
    """Variance of the level, covariance, variance of the slope."""
    return float(covariance[0, 0]), float(covariance[0, 1]), float(covariance[1, 1])


def find_largest_common_u_kg(readings: pl.DataFrame) -> float:
    """Largest common uncertainty of a run; 0 if none is stated."""
    if "common_u_kg" not in readings.columns:
        return 0.0
    largest = readings["common_u_kg"].cast(pl.Float64).max()
    return float(largest) if isinstance(largest, float) and np.isfinite(largest) else 0.0


def compute_alpha_confidence_interval(
    inversion: LineInversion, confidence_1: float
) -> tuple[float | None, float | None]:
    """Confidence interval of α = 1/c1, dimensionless; (None, None) if that of c1 contains 0."""
    low, high = inversion.compute_slope_interval(confidence_1)
    return (1.0 / high, 1.0 / low) if low * high > 0.0 else (None, None)


def compute_beta_confidence_interval_kg(
    inversion: LineInversion, confidence_1: float
) -> tuple[float | None, float | None]:
    """Confidence interval of β, the mass in kg where m̂ is 0; (None, None) if unbounded."""
    found = inversion.invert_with_line_uncertainty_only(0.0, confidence_1)
    low, high = float(found.low_kg[0]), float(found.high_kg[0])
    return (low, high) if np.isfinite(low) and np.isfinite(high) else (None, None)


def list_calibration_notes(calibration: Calibration) -> tuple[str, ...]:
    """Notes on the calibration, a sentence each, the most important first."""
    found = [*_list_notes_on_days(calibration), *_list_notes_on_line(calibration)]
    found += [
        f"{one.test}: {one.about} stands out (p = {one.p_1:.2g}); it is in the fit"
        for one in calibration.outliers
    ]
    return tuple(found)


def _list_notes_on_days(calibration: Calibration) -> list[str]:
    """Notes on how well the runs determine the scatter from day to day."""
    days = len({point.day for point in calibration.points if point.readings})
    if calibration.day_freedom is None and calibration.day_kg is not None:
        return []
    if days == 1:
        common = (
            f"; the {calibration.common_kg / abs(calibration.c1_1):.3g} kg that priors and scale "
            "leave open count once instead"
            if calibration.common_kg
            else "; the intervals hold for that day"
        )
        return [f"day to day: unknown, all runs are of one day{common}"]
    if calibration.day_kg is None:
        return ["day to day: the runs do not tell it apart, so that run to run has it in it"]
    if calibration.day_freedom is not None and calibration.day_freedom < 4:
        return [
            f"day to day: {days} days tell it with {calibration.day_freedom} degrees of freedom; "
            "more days would narrow every interval"
        ]
    return []


def _list_notes_on_line(calibration: Calibration) -> list[str]:
    """Notes on a large offset, an undetermined slope, lack of fit and attenuation."""
    found: list[str] = []
    middle_kg = sum(calibration.range_kg) / 2.0
    share = calibration.beta_kg / middle_kg if middle_kg else 0.0
    if abs(share) > 0.5:
        found.append(
            f"{share:.0%} of a calibrated mass is the offset beta: the estimate moves it "
            "by little, an error of beta stays whole, and outside the references the line "
            "says nothing"
        )
    if None in calibration.alpha_interval_1:
        found.append("the slope cannot be told from 0: no mass has an interval")
    test = calibration.lack_of_fit
    if test.p_1 is not None and test.p_1 < LIMITS.lack_of_fit_probability:
        found.append(
            f"lack of fit: the loads' means are not on a line within their scatter (p = "
            f"{test.p_1:.2g}, against {test.against})"
        )
    if calibration.attenuation_1 is not None:
        found.append(
            "(19) fitted to single readings instead of load means would have alpha at "
            f"{calibration.attenuation_1:.3f} of its size"
        )
    return found
