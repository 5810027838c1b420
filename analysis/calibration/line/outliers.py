"""Readings and runs that a test finds unlikely. They are named, and stay in the fit."""

from typing import NamedTuple

import numpy as np
from scipy.special import stdtr

from analysis.calibration.line.calibration import Outlier
from analysis.calibration.line.calibration_points import Campaign
from analysis.calibration.line.line_limits import LIMITS
from analysis.calibration.line.line_model import FittedLine
from estimators.arrays import Floats


class GrubbsTest(NamedTuple):
    """Farthest of some values, its distance in standard deviations, and bound of the p-value."""

    farthest_index: int
    distance_1: float
    p_1: float


def compute_grubbs_outlier_test(values: Floats) -> GrubbsTest:
    """Grubbs' test for one outlier on either side.

    Args:
        values: (n,) at least three values.

    Returns:
        Index of the farthest value, its distance from the mean over the standard deviation, and an
        upper bound of the p-value.

    Source:
        Grubbs (1969), Technometrics 11; ISO 5725-2, 7.3.4.
    """
    n = values.size
    deviation = np.abs(values - values.mean())
    farthest = int(deviation.argmax())
    std = float(values.std(ddof=1))
    if std == 0.0:
        return GrubbsTest(farthest, 0.0, 1.0)
    distance = float(deviation[farthest]) / std
    left = (n - 1) ** 2 - n * distance**2
    if left <= 0.0:
        return GrubbsTest(farthest, distance, 0.0)
    t = distance * np.sqrt(n * (n - 2) / left)
    return GrubbsTest(farthest, distance, min(2.0 * n * float(stdtr(n - 2, -t)), 1.0))


def compute_studentised_residuals(line: FittedLine) -> Floats:
    """(points,) residuals over their own standard deviations."""
    design = np.column_stack([np.ones_like(line.adjusted_kg), line.adjusted_kg - line.centre_kg])
    covariance = line.point_covariance_kg2
    fitted = design @ np.linalg.solve(design.T @ np.linalg.solve(covariance, design), design.T)
    variance = np.diag(covariance - fitted)
    # a point that alone decides the line has no residual
    alone = variance <= 1e-9 * np.diag(covariance)
    return np.where(alone, 0.0, line.residual_kg / np.sqrt(np.where(alone, 1.0, variance)))


def find_outlying_readings_and_runs(campaign: Campaign, line: FittedLine) -> tuple[Outlier, ...]:
    """Find outlying readings (Grubbs within a run) and runs (studentised residuals)."""
    found: list[Outlier] = []
    runs = campaign.runs["run_id"]
    tested = 0
    for (run_id,), part in campaign.readings.group_by("run_id", maintain_order=True):
        if part.height < LIMITS.outlier_min_readings:
            continue
        tested += 1
        place, distance, p = compute_grubbs_outlier_test(part["mass_kg"].to_numpy())
        number = part["reading"][place] if "reading" in part.columns else place
        found.append(Outlier("Grubbs", f"reading {number} of run '{run_id}'", distance, p))
    found = [Outlier(one.test, one.about, one.value_1, min(tested * one.p_1, 1.0)) for one in found]
    freedom = line.freedom
    if freedom > 1:
        for place, residual in zip(
            campaign.fitted, compute_studentised_residuals(line), strict=True
        ):
            left = freedom - residual**2
            t = abs(residual) * np.sqrt((freedom - 1) / left) if left > 0.0 else np.inf
            p = min(2.0 * line.residual_kg.size * float(stdtr(freedom - 1, -t)), 1.0)
            about = f"run '{runs[int(place)]}'"
            found.append(Outlier("studentised residual", about, float(residual), p))
    return tuple(one for one in found if one.p_1 < LIMITS.outlier_probability)
