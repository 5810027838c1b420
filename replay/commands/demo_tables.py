"""The demo's result for a terminal."""

import polars as pl
from rich.console import Group, RenderableType

from replay.commands.printing import plain_table
from replay.demo import Demo


def render(result: Demo) -> RenderableType:
    """Lay the result out for a terminal."""
    loads = plain_table(
        "load kg", "runs", "estimate kg", "± kg a run", "calibrated kg", "error kg", "left out kg"
    )
    loads.title = "Pooled least squares, means of nine runs, calibrated by (19)"
    for row in result.calibration.filter(pl.col("method") == "pooled").iter_rows(named=True):
        numbers = (
            row["estimate_kg"],
            row["estimate_std_kg"],
            row["calibrated_kg"],
            row["error_kg"],
            row["error_left_out_kg"],
        )
        loads.add_row(f"{row['load_kg']:.0f}", str(row["runs"]), *map(_kg, numbers))
    methods = plain_table("method", "in-sample kg", "one load left out kg", "of the load range")
    methods.title = "Root mean square errors of the load means"
    for table in (loads, methods):
        table.title_justify = "left"
    for row in result.errors.iter_rows(named=True):
        left_out = row["rmse_left_out_kg"]
        share = None if left_out is None else left_out / row["load_range_kg"]
        methods.add_row(
            row["method"],
            _kg(row["rmse_kg"]),
            _kg(left_out),
            "–" if share is None else f"{share:.1%}",
        )
    constant = result.errors["rmse_constant_kg"].drop_nulls()
    notes = [f"A constant predictor scores {constant[0]:.1f} kg."] if constant.len() else []
    made = [f"  {path}" for path in result.files]
    return Group(loads, "", methods, *notes, "", "Files:", *made)


def _kg(value: float | None) -> str:
    return "–" if value is None else f"{value:,.1f}"
