"""Points of a campaign: the mean of each run's readings."""

from dataclasses import dataclass

import numpy as np
import polars as pl

from analysis.calibration.line.line_limits import LIMITS
from analysis.calibration.line.line_model import RunMeans
from analysis.calibration.line.variance_components import WithinRunVariance
from estimators.arrays import Floats
from estimators.errors import DataError, format_count


@dataclass(frozen=True, eq=False)
class CampaignPoints:
    """Runs of a campaign, and the points of the runs that have used readings.

    Attributes:
        runs: a row per run: run_id, load_id, day, reference_kg, readings, rejected, mean_kg,
            std_kg.
        fitted: (points,) index of each point's row in `runs`.
        points: points for the fit.
        readings: the used readings.
        references: load_id and reference_kg of every load.
    """

    runs: pl.DataFrame
    fitted: np.ndarray
    points: RunMeans
    readings: pl.DataFrame
    references: pl.DataFrame


def average_used_readings_by_run(
    readings: pl.DataFrame, references: pl.DataFrame, covariance_kg2: Floats
) -> CampaignPoints:
    """Take the mean of the used readings of each run.

    Args:
        readings: a row per reading: run_id, load_id, day, mass_kg, used; unused ones are ignored.
        references: a row per load: load_id, reference_kg.
        covariance_kg2: (loads, loads) covariance of the references, in their order.

    Raises:
        DataError: no line can be fitted to the readings.
    """
    _refuse_inconsistent_references(readings, references, covariance_kg2)
    references = references.select("load_id", pl.col("reference_kg").cast(pl.Float64))
    mass = pl.col("mass_kg").cast(pl.Float64)
    used = pl.col("used") & mass.is_finite().fill_null(value=False)
    known = mass.filter(used)
    runs = (
        readings.group_by("run_id", maintain_order=True)
        .agg(
            pl.col("load_id").first(),
            pl.col("day").first(),
            readings=used.sum().cast(pl.Int64),
            rejected=(~used).sum().cast(pl.Int64),
            mean_kg=known.mean(),
            std_kg=known.std(),
            squares=((known - known.mean()) ** 2).sum(),
            loads=pl.col("load_id").n_unique(),
            days=pl.col("day").n_unique(),
        )
        .join(references, "load_id", "left", maintain_order="left")
    )
    for run_id in runs.filter((pl.col("loads") > 1) | (pl.col("days") > 1))["run_id"]:
        raise DataError(
            f"calibration: run '{run_id}' has several loads or days; split it into several runs"
        )
    fitted = np.flatnonzero(runs["readings"].to_numpy() > 0)
    part = runs[fitted.tolist()]
    order = {load: k for k, load in enumerate(references["load_id"])}
    days = {day: k for k, day in enumerate(part["day"].unique(maintain_order=True))}
    points = RunMeans(
        y_kg=part["mean_kg"].to_numpy().astype(np.float64),
        readings=part["readings"].to_numpy().astype(np.int64),
        load=np.array([order[load] for load in part["load_id"]], np.int64),
        day=np.array([days[day] for day in part["day"]], np.int64),
        reference_kg=references["reference_kg"].to_numpy().astype(np.float64),
        covariance_kg2=covariance_kg2,
        within=WithinRunVariance(float(part["squares"].sum()), int((part["readings"] - 1).sum())),
    )
    _refuse_points_without_line(points)
    return CampaignPoints(
        runs.drop("loads", "days", "squares"), fitted, points, readings.filter(used), references
    )


def _refuse_inconsistent_references(
    readings: pl.DataFrame, references: pl.DataFrame, covariance_kg2: Floats
) -> None:
    """Raise an error if references or their covariance are inconsistent."""
    loads = references.height
    repeated = references["load_id"].filter(references["load_id"].is_duplicated())
    if repeated.len():
        raise DataError(
            f"calibration: load_id '{repeated[0]}' has several references; give each load one "
            "reference"
        )
    if covariance_kg2.shape != (loads, loads) or not np.isfinite(covariance_kg2).all():
        raise DataError(
            f"calibration: the references' covariance must be {loads} by {loads} finite numbers"
        )
    largest = float(np.abs(covariance_kg2).max(initial=0.0))
    if not np.allclose(covariance_kg2, covariance_kg2.T, rtol=0.0, atol=1e-9 * largest):
        raise DataError(
            "calibration: the references' covariance is not symmetric; give a symmetric matrix"
        )
    if loads and np.linalg.eigvalsh(covariance_kg2).min() < -1e-9 * largest:
        raise DataError(
            "calibration: the references' covariance is not positive semidefinite; check the "
            "correlations"
        )
    unknown = set(readings["load_id"]) - set(references["load_id"])
    if unknown:
        raise DataError(
            f"calibration: load '{min(unknown)}' has readings but no reference mass; add one"
        )


def _refuse_points_without_line(points: RunMeans) -> None:
    """Raise an error if the points cannot determine a line."""
    loads = np.unique(points.x_kg).size
    if loads < LIMITS.min_loads:
        raise DataError(
            f"calibration: the readings are of only {format_count(loads, 'different load')}; at "
            f"least {LIMITS.min_loads} are needed to check that the line is straight; add runs "
            "with other loads"
        )
    if np.ptp(points.y_kg) <= 1e-9 * np.abs(points.y_kg).max():
        raise DataError(
            "calibration: the estimates are equal for all loads; use reference masses that differ"
        )
