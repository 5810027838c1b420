"""Comparison of two sets of results for the same logs: differences in tonnes."""

from typing import Final, NamedTuple

import polars as pl

_LOG: Final = ("machine", "log_sha256")


class FleetComparison(NamedTuple):
    """Comparison of the results A and B.

    Attributes:
        logs: a row per log in both, the largest change first: machine, day, source, key and key_b,
            payload_kg, payload_b_kg, change_kg, loads, loads_b, and whether A and B can weigh.
        machines: a row per machine: logs, payload_kg, payload_b_kg, change_kg, loads, loads_b.
        only_a: logs that only A has.
        only_b: logs that only B has.
    """

    logs: pl.DataFrame
    machines: pl.DataFrame
    only_a: int
    only_b: int

    @property
    def total_change(self) -> dict[str, float]:
        """Sums over all logs that A and B share."""
        return {
            "logs": self.logs.height,
            "changed": int((self.logs["change_kg"] != 0.0).sum()),
            **{name: float(self.logs[name].sum()) for name in _ADDED},
        }


_ADDED: Final = ("payload_kg", "payload_b_kg", "change_kg", "loads", "loads_b")


def compare_fleet_results(a: pl.DataFrame, b: pl.DataFrame) -> FleetComparison:
    """Compare two tables `results`, log by log."""
    columns = ("key", "payload_kg", "cycles_counted", "can_weigh")
    both = (
        a.select(*_LOG, "day", "source", *columns)
        .join(b.select(*_LOG, *columns), on=list(_LOG), how="inner", suffix="_b")
        .select(
            "machine",
            "day",
            "source",
            "key",
            "key_b",
            pl.col("payload_kg").fill_null(0.0),
            pl.col("payload_kg_b").fill_null(0.0).alias("payload_b_kg"),
            pl.col("cycles_counted").fill_null(0).alias("loads"),
            pl.col("cycles_counted_b").fill_null(0).alias("loads_b"),
            "can_weigh",
            "can_weigh_b",
        )
        .with_columns((pl.col("payload_b_kg") - pl.col("payload_kg")).alias("change_kg"))
    )
    by_change = [pl.col("change_kg").abs(), pl.col("machine"), pl.col("day"), pl.col("key")]
    return FleetComparison(
        both.sort(by_change, descending=[True, False, False, False]),
        both.group_by("machine")
        .agg(pl.len().cast(pl.Int64).alias("logs"), pl.col(_ADDED).sum())
        .sort("machine"),
        a.height - both.height,
        b.height - both.height,
    )
