"""The hours of a shift: what each adds up to, by the clock at the machine."""

from typing import Final

import polars as pl

from analysis.cycles.shift_totals import sum_cycles
from recordings.report.shift_text import K, tonnes
from recordings.review.review_state import ReviewState
from recordings.review.shift_ledger import cycles_of

#: Nanoseconds of a second.
_NS: Final = 10**9
#: Heads of the table, behind the hour.
HEADS: Final = ("loads", "t ± U", "not counted", "look again", "kWh")


def hour_rows(ledger: pl.DataFrame, state: ReviewState) -> list[tuple[str, ...]]:
    """A row an hour in which a cycle ends, in time: loads, tonnes, what does not count, energy.

    What is common to all loads is in the ± of each hour: they do not add up in squares.

    Args:
        ledger: with energy.
        state: of the review.
    """
    clock, t0_ns = state.clock, state.t0_unix_ns
    hours = [clock.hour((ends_ns - t0_ns) / _NS) for ends_ns in ledger["end_unix_ns"]]
    named = ledger.with_columns(pl.Series("hour", hours, dtype=pl.String))
    found: list[tuple[str, ...]] = []
    for hour in dict.fromkeys(hours):
        rows = named.filter(hour=hour)
        rejected = rows.filter("rejected")["cycle"].to_list()
        sums = sum_cycles(cycles_of(rows, t0_ns), rejected)
        again = rows.filter("counted", pl.col("doubt") != "").height
        energies = rows["energy_kWh"].drop_nulls()
        found.append(
            (
                hour,
                f"{sums['cycles_counted']}",
                tonnes(sums["payload_kg"], K * sums["payload_u_kg"]),
                f"{rows.height - sums['cycles_counted']}",
                f"{again}",
                f"{energies.sum():.2f}" if energies.len() else "–",
            )
        )
    return found
