"""Figures of a fleet by machine and day, tonnes per week, and recordings that need attention."""

from collections.abc import Mapping
from typing import Final

import polars as pl

from analysis.fleet.fleet_limits import LIMITS
from analysis.model.physical_units import NS_PER_S
from analysis.model.uncertainty_sources import STD_OF_MAD

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

    Random errors of recordings are added in quadrature. Systematic ones are added linearly, since
    all recordings of a machine share the error of its scale.

    Args:
        results: table `results`.

    Returns:
        machine, week (Date of its Monday), loads, payload_kg, payload_u_kg.
    """
    week = pl.col("day").str.to_date().dt.truncate("1w").alias("week")
    dated = results.filter(pl.col("day") != UNDATED)
    return sum_tonnes_by_group(dated.with_columns(week), ["machine", "week"])


def sum_tonnes_by_group(results: pl.DataFrame, group_columns: list[str]) -> pl.DataFrame:
    """Sum recordings, loads and tonnes by groups; see `sum_weekly_tonnes`."""
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
    """Sum daily results over machines, whose errors are independent.

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
    """Make the polars expression that counts the recordings whose scale is unknown."""
    unknown = pl.col("scale_unknown").fill_null("") != ""
    return (unknown & (pl.col("cycles_counted") > 0)).sum().cast(pl.Int64)


def rank_recordings_by_concern(
    results: pl.DataFrame, cycles: pl.LazyFrame, findings: pl.LazyFrame
) -> pl.DataFrame:
    """Rank recordings by their problems.

    Args:
        results: table `results`.
        cycles: table `cycles`.
        findings: table `findings`.

    Returns:
        Recordings with a problem, largest weight first: key, machine, day, source, weight, why (all
        problems in one sentence) and at_s (moment of the weightiest).
    """
    without = (
        cycles.filter(pl.col("payload_kg").is_null())
        .group_by("key")
        .agg((pl.col("start_t_ns").min() / NS_PER_S).alias("without_at_s"))
        .collect()
    )
    placed = results.join(without, on="key", how="left")
    reasons = pl.concat(
        [
            *list_result_concerns(placed),
            list_payload_concerns(cycles),
            list_finding_concerns(findings),
        ]
    )
    ranked = (
        reasons.sort("weight", "why", descending=[True, False])
        .group_by("key", maintain_order=True)
        .agg(
            pl.col("weight").sum(),
            pl.col("why").str.join("; "),
            pl.col("at_s").drop_nulls().first(),
        )
    )
    of = results.select("key", "machine", "day", "source")
    return (
        ranked.join(of, on="key", how="inner")
        .select("key", "machine", "day", "source", "weight", "why", pl.col("at_s").fill_null(0.0))
        .sort(["weight", "machine", "day", "key"], descending=[True, False, False, False])
    )


def list_result_concerns(results: pl.DataFrame) -> list[pl.DataFrame]:
    """Frames of recordings with a problem in `results`, one frame per kind of problem."""
    missing, cycles = pl.col("cycles_without_mass"), pl.col("cycles")
    lost = pl.col("lost_cycles")
    failed = pl.col("failed_checks")
    reasons: tuple[tuple[float, pl.Expr, pl.Expr, str], ...] = (
        (100.0, pl.col("status") == "refused", pl.format("refused: {}", "reason"), ""),
        (50.0, ~pl.col("can_weigh"), pl.format("cannot weigh: {}", failed), ""),
        (
            30.0,
            pl.col("not_calibrated_for") != "",
            pl.format("not calibrated: {}", "not_calibrated_for"),
            "",
        ),
        (
            15.0,
            lost >= 1.0,
            pl.format("about {} cycles in gaps", lost.round(1)),
            "longest_gap_at_s",
        ),
        (
            15.0,
            (missing > 0) & (missing * LIMITS.cycles_per_missing_mass >= cycles),
            pl.format("{} of {} cycles without a mass", missing, cycles),
            "without_at_s",
        ),
        (10.0, pl.col("losses") > 0, pl.format("lost: {}", "first_loss"), ""),
        (
            8.0,
            pl.col("accepted_1") < LIMITS.accepted_min_fraction,
            pl.lit("the gate accepted less than 2 % of the time"),
            "",
        ),
        (5.0, pl.col("can_weigh") & (failed != ""), pl.format("checks failed: {}", failed), ""),
    )
    return [
        results.filter(when).select(
            "key",
            pl.lit(weight).alias("weight"),
            why.alias("why"),
            (pl.col(place) if place else pl.lit(None)).cast(pl.Float64).alias("at_s"),
        )
        for weight, when, why, place in reasons
    ]


def list_payload_concerns(cycles: pl.LazyFrame) -> pl.DataFrame:
    """Payloads far from the machine's others, by median and median absolute deviation."""
    payload = pl.col("payload_kg")
    apart = (payload - payload.median().over("machine")).abs().alias("apart")
    spread = (pl.col("apart").median().over("machine") * STD_OF_MAD).clip(1e-9)
    farthest = pl.all().sort_by("apart", "cycle").last()
    return (
        cycles.filter("counted")
        .select("key", "machine", "cycle", "start_t_ns", "payload_kg")
        .with_columns(apart)
        .filter(
            (pl.len().over("machine") > LIMITS.unlike_min_payloads)
            & (pl.col("apart") > LIMITS.unlike_payload_std * spread)
        )
        .group_by("key")
        .agg(pl.len().cast(pl.String).alias("number"), farthest)
        .select(
            "key",
            pl.lit(12.0).alias("weight"),
            pl.format(
                "{} payloads far from the others, the farthest {} kg",
                "number",
                payload.round(0).cast(pl.Int64),
            ).alias("why"),
            (pl.col("start_t_ns") / NS_PER_S).alias("at_s"),
        )
        .collect()
    )


def list_finding_concerns(findings: pl.LazyFrame) -> pl.DataFrame:
    """First finding of each recording, unless it is only informative."""
    change = pl.col("mass_change_kg").round(0).cast(pl.Int64, strict=False).cast(pl.String)
    return (
        findings.filter((pl.col("rank") == 1) & (pl.col("severity") != "tell"))
        # Polars 2.1 panics where text is chosen by row in a frame with empty chunks
        .collect()
        .rechunk()
        .select(
            "key",
            pl.when(pl.col("severity") == "withhold").then(20.0).otherwise(6.0).alias("weight"),
            pl.when(change.is_null())
            .then(pl.format("likely {}", "cause"))
            .otherwise(pl.format("likely {}, which changes the mass by {} kg", "cause", change))
            .alias("why"),
            (pl.col("start_t_ns") / NS_PER_S).alias("at_s"),
        )
    )
