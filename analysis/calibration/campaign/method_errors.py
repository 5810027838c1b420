"""Errors of the methods' calibrated masses, by load and by start."""

import numpy as np
import polars as pl

from analysis.calibration.campaign.by_method import MethodReadings, iter_readings_by_method
from analysis.calibration.line.calibration_points import average_used_readings_by_run
from analysis.calibration.line.line_fit import fit_line_and_test_lack_of_fit
from analysis.calibration.line.point_errors import fit_lines_without_each_load
from estimators.arrays import Floats
from estimators.errors import DataError


def compute_rms_mass_errors_by_method(calibration: pl.DataFrame) -> pl.DataFrame:
    """Root mean square errors of a calibration over its loads, a row per method.

    Args:
        calibration: the frame `calibration`.

    Returns:
        `method`, `loads` (number with an estimate), `rmse_kg` (of the fit to all loads),
        `rmse_left_out_kg` (each load predicted by the fit to the others), and for comparison
        `rmse_constant_kg` (of the mean reference as prediction, which ignores the estimates) and
        `load_range_kg`. Null where undefined.
    """
    estimated = pl.col("estimate_kg").is_not_null()
    reference = pl.col("reference_kg").filter(estimated)

    def compute_rms_of_column(column: str) -> pl.Expr:
        return (pl.col(column) ** 2).mean().sqrt()

    return calibration.group_by("method", maintain_order=True).agg(
        loads=estimated.sum().cast(pl.Int64),
        rmse_kg=compute_rms_of_column("error_kg"),
        rmse_left_out_kg=compute_rms_of_column("error_left_out_kg"),
        rmse_constant_kg=reference.std(ddof=0),
        load_range_kg=reference.max() - reference.min(),
    )


def add_calibrated_mass_error_columns(estimates: pl.DataFrame) -> pl.DataFrame:
    """Add the errors of single starts on the line through all loads, and without their own load.

    Args:
        estimates: as in `fit_calibration_line_by_method`, with the same line.

    Returns:
        The estimates' rows with `error_kg` and `error_left_out_kg`: calibrated mass minus
        reference. Null if the start gave no mass, or the loads determine no line.
    """
    columns = {"error_kg": pl.Float64, "error_left_out_kg": pl.Float64}
    numbered = estimates.with_row_index("row")
    rows = numbered.group_by("method", maintain_order=True).agg("row")["row"].to_list()
    frames = [
        pl.DataFrame({"row": of, "error_kg": within, "error_left_out_kg": without}).with_columns(
            pl.col("row").cast(pl.UInt32), pl.col(*columns).fill_nan(None)
        )
        for of, (_, found) in zip(rows, iter_readings_by_method(estimates), strict=True)
        for within, without in (compute_mass_errors_with_and_without_own_load(found),)
    ]
    empty = pl.DataFrame(schema={"row": pl.UInt32, **columns})
    return numbered.join(pl.concat([empty, *frames]), "row", "left", maintain_order="left").select(
        *estimates.columns, *columns
    )


def compute_mass_errors_with_and_without_own_load(
    estimates_of_method: MethodReadings,
) -> tuple[Floats, Floats]:
    """Errors (starts,) on the line, and on that without the start's load; NaN without a line."""
    mass = estimates_of_method.readings["mass_kg"].to_numpy().astype(np.float64)
    loads = {load: k for k, load in enumerate(estimates_of_method.references["load_id"])}
    load = np.array([loads[each] for each in estimates_of_method.readings["load_id"]], np.int64)
    reference = estimates_of_method.references["reference_kg"].to_numpy().astype(np.float64)[load]
    within, without = np.full(mass.size, np.nan), np.full(mass.size, np.nan)
    try:
        points = average_used_readings_by_run(
            estimates_of_method.readings,
            estimates_of_method.references,
            estimates_of_method.covariance_kg2,
        ).points
        line, _ = fit_line_and_test_lack_of_fit(points, None)
    except DataError:
        return within, without
    within = (mass - line.level_kg) / line.slope_1 + line.centre_kg - reference
    for number, other in fit_lines_without_each_load(points, line).items():
        left = load == number
        without[left] = other.compute_x_at(mass[left]) - reference[left]
    return within, without
