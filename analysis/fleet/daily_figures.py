"""Zero, scale and friction per machine and day, and tonnes per week."""

from collections.abc import Mapping
from typing import Final

import polars as pl

UNDATED: Final = "undated"


def summarise_results_by_day(results: pl.DataFrame, cycles: pl.LazyFrame) -> pl.DataFrame:
    """Summarise each machine and day, in order of time.

    Args:
        results: table `results`.
        cycles: table `cycles`.

    Returns:
        machine, day (Date), recordings, loads, payload_kg (sum), hours, and for the charts:
        zero_kg (mean mass of the empty passes), load_kg (mean payload), friction_N_s_m (mean by the
        recordings' joint fits), each null where there is none; calibration (of the day).
    """
    dated = results.filter(pl.col("day") != UNDATED)
    of_cycles = (
        cycles.filter(pl.col("day") != UNDATED)
        .group_by("machine", "day")
        .agg(
            pl.col("empty_after_kg").mean().alias("zero_kg"),
            pl.col("payload_kg").filter("counted").mean().alias("load_kg"),
        )
        .collect()
    )
    of_results = dated.group_by("machine", "day").agg(
        pl.len().cast(pl.Int64).alias("recordings"),
        pl.col("cycles_counted").sum().alias("loads"),
        pl.col("payload_kg").sum(),
        (pl.col("duration_s").sum() / 3600.0).alias("hours"),
        pl.col("friction_x_N_s_m").mean().alias("friction_N_s_m"),
        pl.col("calibration").max(),
    )
    return (
        of_results.join(of_cycles, on=["machine", "day"], how="left")
        .with_columns(pl.col("day").str.to_date())
        .sort("machine", "day")
    )


def sum_weekly_tonnes(results: pl.DataFrame) -> pl.DataFrame:
    """Tonnes per machine and week.

    Random errors of recordings add in squares. Systematic ones add linearly, since all recordings
    of a machine share its error of scale.

    Args:
        results: table `results`.

    Returns:
        machine, week (Date of its Monday), loads, payload_kg, payload_u_kg.
    """
    week = pl.col("day").str.to_date().dt.truncate("1w").alias("week")
    dated = results.filter(pl.col("day") != UNDATED)
    return sum_tonnes_by_group(dated.with_columns(week), ["machine", "week"])


def sum_tonnes_by_group(results: pl.DataFrame, group_columns: list[str]) -> pl.DataFrame:
    """Recordings, loads and tonnes grouped by some columns; see `weekly`."""
    return (
        results.group_by(group_columns)
        .agg(
            pl.len().cast(pl.Int64).alias("recordings"),
            pl.col("cycles_counted").sum().alias("loads"),
            pl.col("payload_kg").sum(),
            (pl.col("payload_u_random_kg") ** 2).sum().sqrt().alias("payload_u_random_kg"),
            pl.col("payload_u_common_kg").sum(),
            make_expression_counting_unknown_scales().alias("without_scale"),
        )
        .with_columns(
            (pl.col("payload_u_random_kg") ** 2 + pl.col("payload_u_common_kg") ** 2)
            .sqrt()
            .alias("payload_u_kg")
        )
        .sort(group_columns)
    )


def sum_daily_results_over_machines(machines: pl.DataFrame) -> Mapping[str, float]:
    """Sum over machines; errors of different machines are independent.

    Args:
        machines: sums per machine.
    """
    u_kg = float((machines["payload_u_kg"] ** 2).sum()) ** 0.5
    return {
        "payload_kg": float(machines["payload_kg"].sum()),
        "payload_u_kg": u_kg,
        "loads": int(machines["loads"].sum()),
        "recordings": int(machines["recordings"].sum()),
        "without_scale": int(machines["without_scale"].sum()),
    }


def make_expression_counting_unknown_scales() -> pl.Expr:
    """Expression: number of recordings whose tonnes have an unknown scale."""
    unknown = pl.col("scale_unknown").fill_null("") != ""
    return (unknown & (pl.col("cycles_counted") > 0)).sum().cast(pl.Int64)
