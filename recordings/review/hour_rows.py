"""The hours of a shift: what each adds up to, by the clock at the machine."""

from collections.abc import Iterator
from typing import Final

import polars as pl

from analysis.cycles.shift_totals import sum_cycles
from analysis.model.physical_units import NS
from recordings.report.clock_text import ShiftClock
from recordings.report.shift_text import K, tonnes
from recordings.review.review_state import ReviewState
from recordings.review.shift_ledger import cycles_of

#: Seconds of an hour.
_HOUR_S: Final = 3600.0
#: A rate of less recorded time than this, in s, says nothing.
_SHORTEST_RATE_S: Final = 300.0
#: Heads of the table, behind the hour.
HEADS: Final = ("loads", "t ± U", "t/h", "recorded", "not counted", "look again", "kWh")


def hour_rows(ledger: pl.DataFrame, state: ReviewState) -> list[tuple[str, ...]]:
    """A row an hour of the shift: recorded time, loads, tonnes, what does not count, energy.

    A load is of the hour in which it is dumped. What is common to all loads is in the ± of each
    hour: they do not add up in squares.

    Args:
        ledger: with energy.
        state: of the review.
    """
    clock, t0_ns = state.clock, state.t0_unix_ns
    hours = [clock.hour((ends_ns - t0_ns) / NS) for ends_ns in ledger["end_unix_ns"]]
    named = ledger.with_columns(pl.Series("hour", hours, dtype=pl.String))
    recorded = dict(_recorded_hours(clock, state.gaps_s))
    return [
        (hour, *_cells(named.filter(hour=hour), t0_ns, recorded.get(hour, 0.0)))
        for hour in dict.fromkeys([*recorded, *hours])
    ]


def _cells(rows: pl.DataFrame, t0_ns: int, recorded_s: float) -> Iterator[str]:
    """The cells of an hour, by `HEADS`."""
    rejected = rows.filter("rejected")["cycle"].to_list()
    sums = sum_cycles(cycles_of(rows, t0_ns), rejected)
    energies = rows["energy_kWh"].drop_nulls()
    rate = sums["payload_kg"] / 1e3 / (recorded_s / _HOUR_S) if recorded_s else 0.0
    yield f"{sums['cycles_counted']}"
    yield tonnes(sums["payload_kg"], K * sums["payload_u_kg"])
    yield f"{rate:.1f}" if recorded_s >= _SHORTEST_RATE_S else "–"
    yield f"{recorded_s / 60.0:.0f} min"
    yield f"{rows.height - sums['cycles_counted']}"
    yield f"{rows.filter('counted', pl.col('doubt') != '').height}"
    yield f"{energies.sum():.2f}" if energies.len() else "–"


def _recorded_hours(
    clock: ShiftClock, gaps_s: tuple[tuple[float, float], ...]
) -> Iterator[tuple[str, float]]:
    """Each hour of the clock that the shift touches, and how much of it was recorded, in s."""
    begin_s = 0.0
    while begin_s < clock.duration_s:
        end_s = min(clock.next_hour(begin_s), clock.duration_s)
        hidden_s = sum(max(min(e, end_s) - max(s, begin_s), 0.0) for s, e in gaps_s)
        yield clock.hour(begin_s), end_s - begin_s - hidden_s
        begin_s = end_s
