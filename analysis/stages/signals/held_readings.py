"""Readings that a logger holds: one of a slow sensor in several rows of a faster table.

Rows in between say nothing new, and a derivative over them is that of stairs. A coarse speed
repeats itself as well, and one of a machine that stands. While a channel changes by several steps
of its resolution at once, neither does: a run of equal readings is then one reading that was held.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Self

import numpy as np

from analysis.model.schema import HINTS
from analysis.stages.signals import filters, mounting
from estimators.arrays import Floats, Ints

#: The resolution is the change between runs that this share of the changes are below.
_RESOLUTION_QUANTILE: Final = 0.1
#: A channel changes fast where it does by so many steps of its resolution, before a run and after.
_FAST_STEPS: Final = 1.5
#: So many runs between fast changes tell how long a reading is held.
_FEWEST_RUNS: Final = 12
#: A reading is held if no more than this share of such runs are single rows: they are a half where
#: a topic is as much slower than its table as `OTHER_RATE` says, and nearly all where noise repeats
#: itself.
_MOST_SINGLE: Final = 0.4
#: Whatever jitters, readings are held for at least half as long as the median one and for less than
#: twice as long, but for this share of them; what reads pulses is held for any time.
_SHORTER: Final = 0.05
#: A run so many readings long repeats a reading, as at a stand; in shorter ones one was late, or
#: lost.
_REPEATED: Final = 2
#: A sensor slower than this weighs nothing, and a force that a program sets stays as long.
_LONGEST_S: Final = 1.25


@dataclass(frozen=True, slots=True)
class HeldReadings:
    """How a channel's readings are held.

    Attributes:
        rows: mean number of rows of a reading.
    """

    rows: float

    @classmethod
    def from_readings(cls, x: Floats, rate_hz: float) -> Self | None:
        """Find how long readings (n,) in rows at a rate are held; None if they are not."""
        first = first_rows_of_runs(x)
        changes = np.abs(np.diff(x[first]))
        if changes.size <= _FEWEST_RUNS or x.size < filters.OTHER_RATE * first.size:
            return None
        fast = changes > _FAST_STEPS * float(np.quantile(changes, _RESOLUTION_QUANTILE))
        length = np.diff(first)[1:][fast[:-1] & fast[1:]]
        if length.size < _FEWEST_RUNS or float((length == 1).mean()) > _MOST_SINGLE:
            return None
        shortest, median = np.quantile(length, (_SHORTER, 0.5), method="nearest").tolist()
        rows = float(length[length < 2 * median].mean())
        is_even = 2 * shortest >= median - 1
        is_slow = filters.OTHER_RATE < rows < _LONGEST_S * rate_hz
        return cls(rows) if is_even and is_slow else None

    def select_readings(self, x: Floats) -> Ints:
        """Rows (readings,) at which a reading was taken, of held readings (n,).

        The first row of each run, and of a long one those at multiples of the mean distance, or a
        stand would be a gap. None depends on what comes later.
        """
        first = first_rows_of_runs(x)
        since = np.arange(x.size) - np.repeat(first, np.diff(np.append(first, x.size)))
        number = since // self.rows
        repeats = (number >= _REPEATED) & (number > (since - 1) // self.rows)
        return np.flatnonzero((since == 0) | repeats)


def find_held_channels(read: Mapping[str, mounting.Series]) -> dict[str, HeldReadings]:
    """Find the force and motion channels whose readings are held.

    Args:
        read: channels from `read_measured_channels`.
    """
    found = {
        name: HeldReadings.from_readings(x, 1e9 / filters.period_ns(t))
        for name, (t, x) in read.items()
        if name not in HINTS
    }
    return {name: held for name, held in found.items() if held is not None}


def drop_repeated_rows(
    read: Mapping[str, mounting.Series], held: Mapping[str, HeldReadings]
) -> dict[str, mounting.Series]:
    """Drop the rows that repeat a held reading, so that a channel comes at its sensor's rate."""
    out = dict(read)
    for name, each in held.items():
        t, x = read[name]
        rows = each.select_readings(x)
        out[name] = t[rows], x[rows]
    return out


def held_reading_notes(
    read: Mapping[str, mounting.Series], held: Mapping[str, HeldReadings]
) -> list[str]:
    """Notes on channels that are held, as they were read."""
    rates_hz = {name: 1e9 / filters.period_ns(read[name][0]) for name in held}
    return [
        f"{name} holds each reading for {each.rows:.3g} rows of {rates_hz[name]:.4g} Hz: it is "
        f"taken at {rates_hz[name] / each.rows:.4g} Hz, without the rows that repeat a reading"
        for name, each in held.items()
    ]


def first_rows_of_runs(x: Floats) -> Ints:
    """First row of each run of equal readings, (runs,)."""
    return np.flatnonzero(np.append(True, np.diff(x) != 0.0))
