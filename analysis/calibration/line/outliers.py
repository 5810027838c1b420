"""Readings and runs that a test finds improbable. They are reported, but stay in the fit.

Two runs with each other's load, as if their file names were swapped, deviate from the line in
opposite directions by the difference of their loads. Leaving out one run at a time does not show
this, since the other one still biases the line.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import fdtrc, stdtr

from analysis.calibration.line.calibration import Calibration, Outlier, Point
from analysis.calibration.line.calibration_points import CampaignPoints
from analysis.calibration.line.line_limits import LIMITS
from analysis.calibration.line.line_model import FittedLine
from estimators.arrays import Floats


class GrubbsTest(NamedTuple):
    """Index of the farthest value, its distance in standard deviations, and bound of its p."""

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
    # a point that alone determines a parameter of the line has no residual
    alone = variance <= 1e-9 * np.diag(covariance)
    return np.where(alone, 0.0, line.residual_kg / np.sqrt(np.where(alone, 1.0, variance)))


def find_outlying_readings_and_runs(
    campaign: CampaignPoints, line: FittedLine
) -> tuple[Outlier, ...]:
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
    degrees_of_freedom = line.degrees_of_freedom
    if degrees_of_freedom > 1:
        for place, residual in zip(
            campaign.fitted, compute_studentised_residuals(line), strict=True
        ):
            left = degrees_of_freedom - residual**2
            t = abs(residual) * np.sqrt((degrees_of_freedom - 1) / left) if left > 0.0 else np.inf
            p = min(2.0 * line.residual_kg.size * float(stdtr(degrees_of_freedom - 1, -t)), 1.0)
            about = f"run '{runs[int(place)]}'"
            found.append(Outlier("studentised residual", about, float(residual), p))
    return tuple(one for one in found if one.p_1 < LIMITS.outlier_probability)


@dataclass(frozen=True, slots=True)
class RunsWithSwappedLoads:
    """Two runs that fit the line with each other's load.

    Attributes:
        runs: ids of the two runs.
        scatter_ratio_1: scatter about the line as stated over that with the loads exchanged.
        p_1: bound of the probability that any two runs of a campaign look swapped by chance.
    """

    runs: tuple[str, str]
    scatter_ratio_1: float
    p_1: float

    def __str__(self) -> str:
        first, second = self.runs
        return (
            f"runs '{first}' and '{second}' may be exchanged: with each other's load, the runs "
            f"scatter {self.scatter_ratio_1:.1f} times less about the line (p = {self.p_1:.1g}). "
            "The numbers are those of the loads as stated; compare the logs of both runs with the "
            "notes of the day"
        )


def find_runs_with_swapped_loads(calibration: Calibration) -> RunsWithSwappedLoads | None:
    """Find the two runs that most likely have each other's load; None if none stand out.

    The difference of two runs is fitted as an additional column, like an outlier. It must be
    significant (t test, Bonferroni over the pairs), equal the difference of the loads, and explain
    the runs better than leaving out any single run.
    """
    points = [each for each in calibration.points if each.mean_kg is not None and each.readings]
    degrees_of_freedom = len(points) - 2
    if degrees_of_freedom < 2:
        return None
    whiten = _compute_whitening_matrix(calibration, points)
    x_kg = np.array([point.reference_kg for point in points])
    y = whiten @ np.array([point.mean_kg for point in points])
    project = _compute_residual_projector(whiten, x_kg)
    residual = project @ y
    squares = float(residual @ residual)
    unit = project @ whiten
    along, gram = residual @ unit, unit.T @ unit
    least = squares - float(_compute_squares_removed_by_columns(along, np.diagonal(gram)).max())
    # reduction of the sum of squares by the difference of each pair
    first, second = np.triu_indices(len(points), 1)
    unlike = x_kg[first] != x_kg[second]
    first, second = first[unlike], second[unlike]
    size = gram[first, first] + gram[second, second] - 2.0 * gram[first, second]
    taken = _compute_squares_removed_by_columns(along[first] - along[second], size)
    # readings that scatter by rounding alone show nothing
    floor = np.finfo(float).eps * float(y @ y)
    variance = np.maximum(squares - taken, floor) / (degrees_of_freedom - 1)
    p = first.size * stdtr(degrees_of_freedom - 1, -np.sqrt(taken / variance))
    best: int | None = None
    for n in np.flatnonzero(p < LIMITS.swap_probability).tolist():
        swapped_kg = x_kg.copy()
        swapped_kg[[first[n], second[n]]] = x_kg[[second[n], first[n]]]
        rest = _compute_residual_projector(whiten, swapped_kg) @ y
        if float(rest @ rest) < least:
            best, least = n, float(rest @ rest)
    if best is None:
        return None
    n, exchanged = best, least
    beyond = max(exchanged - float(squares - taken[n]), 0.0) / float(variance[n])
    if float(fdtrc(1, degrees_of_freedom - 1, beyond)) <= LIMITS.swap_size_probability:
        return None
    return RunsWithSwappedLoads(
        (points[first[n]].run_id, points[second[n]].run_id),
        float(np.sqrt(squares / max(exchanged, floor))),
        float(p[n]),
    )


def _compute_whitening_matrix(calibration: Calibration, points: list[Point]) -> Floats:
    """(points, points) matrix that gives all points unit variance, up to a common factor."""
    day = np.array([point.day for point in points])
    readings = np.array([point.readings for point in points])
    run_kg, day_kg = calibration.run_kg or 0.0, calibration.day_kg or 0.0
    own = run_kg**2 + (calibration.repeatability_kg or 0.0) ** 2 / readings
    covariance = np.diag(own) + day_kg**2 * (day[:, None] == day[None, :])
    if not own.min() > 0.0:
        return np.eye(len(points))
    root = np.linalg.cholesky(covariance)
    return solve_triangular(root, np.eye(len(points)), lower=True)


def _compute_residual_projector(whitening_matrix: Floats, x_kg: Floats) -> Floats:
    """(points, points) projector of whitened points onto their residuals about a line."""
    q = np.linalg.qr(whitening_matrix @ np.column_stack([np.ones_like(x_kg), x_kg - x_kg.mean()]))[
        0
    ]
    return np.eye(x_kg.size) - q @ q.T


def _compute_squares_removed_by_columns(
    products_with_residual: Floats, squared_norms: Floats
) -> Floats:
    """(columns,) decrease of a residual's sum of squares by each column alone.

    Args:
        products_with_residual: (columns,) scalar product of each column with the residual.
        squared_norms: (columns,) sum of squares of each column.
    """
    return products_with_residual**2 / np.where(
        squared_norms > 1e-9 * squared_norms.max(initial=0.0), squared_norms, np.inf
    )
