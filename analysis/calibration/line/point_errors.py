"""Errors of a calibration's points: on the line, on the line without their load, and on (19).

(19) is the paper's calibration as printed: references regressed on estimates.
"""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.calibration.line.calibration import Point
from analysis.calibration.line.calibration_points import CampaignPoints
from analysis.calibration.line.distance_regression import (
    StraightLine,
    fit_line_by_generalised_distance,
)
from analysis.calibration.line.line_limits import LIMITS
from analysis.calibration.line.line_model import FittedLine, RunMeans
from analysis.calibration.line.outliers import compute_studentised_residuals
from estimators.arrays import Floats

#: Abscissa and ordinate of (19).
_OF_19: Final = ("mass_kg", "reference_kg")


def make_point_rows(campaign: CampaignPoints, line: FittedLine) -> tuple[Point, ...]:
    """Points of all runs, including runs without a used reading."""
    reference = campaign.points.x_kg
    calibrated = (campaign.points.y_kg - line.level_kg) / line.slope_1 + line.centre_kg
    values = {
        "calibrated_kg": calibrated,
        "error_kg": calibrated - reference,
        "error_left_out_kg": compute_leave_one_load_out_mass_errors_kg(campaign, line),
        "studentised_1": compute_studentised_residuals(line),
    }
    place = {int(row): k for k, row in enumerate(campaign.fitted)}
    rows: list[Point] = []
    for row, run in enumerate(campaign.runs.iter_rows(named=True)):
        k = place.get(row)
        at: dict[str, Any] = {
            name: None if k is None or np.isnan(column[k]) else float(column[k])
            for name, column in values.items()
        }
        rows.append(Point(**{**run, **at}))
    return tuple(rows)


def compute_leave_one_load_out_mass_errors_kg(campaign: CampaignPoints, line: FittedLine) -> Floats:
    """(points,) error on the line through the other loads; NaN if there is none."""
    points = campaign.points
    errors = np.full(points.y_kg.size, np.nan)
    for load, other in fit_lines_without_each_load(points, line).items():
        left = points.load == load
        errors[left] = other.compute_x_at(points.y_kg[left]) - points.x_kg[left]
    return errors


def fit_lines_without_each_load(points: RunMeans, line: FittedLine) -> dict[int, StraightLine]:
    """Line through the other loads, by index of the load left out.

    A load is absent if the others determine no line.
    """
    x, x_cov = points.x_kg, points.x_cov_kg2
    y_cov = line.point_covariance_kg2 - line.slope_1**2 * x_cov
    found: dict[int, StraightLine] = {}
    for load in np.unique(points.load):
        rest = points.load != load
        if np.unique(x[rest]).size < 2:
            continue
        inner = np.ix_(rest, rest)
        other = fit_line_by_generalised_distance(
            x[rest], points.y_kg[rest], x_cov[inner], y_cov[inner]
        )
        if other.slope:
            found[int(load)] = other
    return found


def compute_rms_without_none(errors: Sequence[float | None]) -> float | None:
    """Root mean square of the errors that are not None; None without any."""
    known = [error for error in errors if error is not None]
    return float(np.sqrt(np.mean(np.square(known)))) if known else None


def estimate_slope_attenuation(campaign: CampaignPoints) -> float | None:
    """Slope of (19) fitted to single readings over that fitted to load means.

    Noise of the estimates attenuates a line from estimates to references, so the ratio is below 1.
    """
    of_run = campaign.runs.select("run_id", "reference_kg")
    single = campaign.readings.select("run_id", "load_id", "mass_kg").join(of_run, "run_id")
    means = single.group_by("load_id", maintain_order=True).agg(
        pl.col("mass_kg", "reference_kg").mean()
    )
    lines = [
        fit_error_slope_and_offset_kg(
            *(part[name].to_numpy().astype(np.float64) for name in _OF_19)
        )
        for part in (single, means)
    ]
    slopes = [line[0] if line else 0.0 for line in lines]
    return slopes[0] / slopes[1] if slopes[1] else None


def compute_scatter_to_stated_std_ratio(campaign: CampaignPoints) -> float | None:
    """Scatter of single readings within runs over their stated standard deviations."""
    if "std_kg" not in campaign.readings.columns:
        return None
    known = campaign.readings.filter(pl.col("std_kg") > 0.0).with_columns(
        weight=pl.col("std_kg") ** -2.0
    )
    mean = (pl.col("weight") * pl.col("mass_kg")).sum() / pl.col("weight").sum()
    by_run = known.group_by("run_id", maintain_order=True).agg(
        chi2=(pl.col("weight") * (pl.col("mass_kg") - mean) ** 2).sum(),
        degrees_of_freedom=pl.len() - 1,
    )
    degrees_of_freedom = int(by_run["degrees_of_freedom"].sum())
    if degrees_of_freedom < 1:
        return None
    ratio = float(np.sqrt(float(by_run["chi2"].sum()) / degrees_of_freedom))
    return ratio if np.isfinite(ratio) else None


def fit_error_slope_and_offset_kg(
    estimate_kg: NDArray[np.float64], reference_kg: NDArray[np.float64]
) -> tuple[float, float] | None:
    """Fit m_c = alpha m + beta by least squares.

    On load means it is nearly the line of `fit_calibration_line`; on single runs the noise of the
    estimates flattens it.

    Args:
        estimate_kg: (points,) estimates m.
        reference_kg: (points,) references m_c.

    Returns:
        alpha (dimensionless), and beta in kg; None if all estimates are equal.

    Source:
        Equation (19).
    """
    x0, y0 = estimate_kg.mean(), reference_kg.mean()
    x, y = estimate_kg - x0, reference_kg - y0
    if np.abs(x).max() <= LIMITS.min_spread_fraction * np.abs(estimate_kg).max():
        return None
    alpha = float(x @ y / (x @ x))
    return alpha, float(y0 - alpha * x0)
