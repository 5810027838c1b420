"""Held readings: a reading of a slow sensor that a logger repeats in rows of a faster table.

Repeated rows add no information, and the derivative over them is that of a staircase. A coarsely
quantised speed repeats as well, and so does that of a standing machine. While a channel changes by
several steps of its resolution at once, neither happens: a run of equal readings is then one
reading that was held.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np

from analysis.model.schema import HINTS
from analysis.stages.signals import filters, mounting
from analysis.stages.signals.signal_limits import LIMITS
from estimators.arrays import Floats, Ints


@dataclass(frozen=True, slots=True)
class HeldReadings:
    """Repetition of a channel's held readings.

    Attributes:
        rows: mean number of rows that repeat one reading.
    """

    rows: float

    @classmethod
    def from_readings(cls, readings: Floats, rate_hz: float) -> Self | None:
        """Find for how many rows, at `rate_hz`, readings (n,) are held; None if they are not."""
        first = find_first_rows_of_runs(readings)
        changes = np.abs(np.diff(readings[first]))
        if (
            changes.size <= LIMITS.held_min_runs
            or readings.size < LIMITS.other_rate_ratio * first.size
        ):
            return None
        fast = changes > LIMITS.fast_change_steps * float(
            np.quantile(changes, LIMITS.resolution_quantile)
        )
        length = np.diff(first)[1:][fast[:-1] & fast[1:]]
        if (
            length.size < LIMITS.held_min_runs
            or float((length == 1).mean()) > LIMITS.held_max_single_fraction
        ):
            return None
        shortest, median = np.quantile(
            length, (LIMITS.held_shorter_fraction, 0.5), method="nearest"
        ).tolist()
        rows = float(length[length < 2 * median].mean())
        is_even = 2 * shortest >= median - 1
        is_slow = LIMITS.other_rate_ratio < rows < LIMITS.held_max_s * rate_hz
        return cls(rows) if is_even and is_slow else None

    def find_rows_of_new_readings(self, held_values: Floats) -> Ints:
        """Rows (readings,) of held readings (n,) at which the sensor took a new one.

        These are the first row of each run of equal readings and, in a long run, rows at multiples
        of the mean distance, since a standstill would otherwise be a gap. No row depends on later
        ones.
        """
        first = find_first_rows_of_runs(held_values)
        since = np.arange(held_values.size) - np.repeat(
            first, np.diff(np.append(first, held_values.size))
        )
        number = since // self.rows
        repeats = (number >= LIMITS.repeated_min_readings) & (number > (since - 1) // self.rows)
        return np.flatnonzero((since == 0) | repeats)


def find_held_channels(channels: Mapping[str, mounting.Series]) -> dict[str, HeldReadings]:
    """Find the force and motion channels whose readings are held.

    Args:
        channels: channels from `read_measured_channels`.
    """
    found = {
        name: HeldReadings.from_readings(x, 1e9 / filters.compute_median_period_ns(t))
        for name, (t, x) in channels.items()
        if name not in HINTS
    }
    return {name: held for name, held in found.items() if held is not None}


def drop_rows_with_held_readings(
    channels: Mapping[str, mounting.Series], held_channels: Mapping[str, HeldReadings]
) -> dict[str, mounting.Series]:
    """Drop the rows that repeat a held reading, so that a channel comes at its sensor's rate."""
    out = dict(channels)
    for name, each in held_channels.items():
        t, x = channels[name]
        rows = each.find_rows_of_new_readings(x)
        out[name] = t[rows], x[rows]
    return out


def list_held_reading_notes(
    channels: Mapping[str, mounting.Series], held_channels: Mapping[str, HeldReadings]
) -> list[str]:
    """Notes on channels with held readings."""
    rates_hz = {
        name: 1e9 / filters.compute_median_period_ns(channels[name][0]) for name in held_channels
    }
    return [
        f"{name} holds each reading for {each.rows:.3g} rows of {rates_hz[name]:.4g} Hz: it is "
        f"taken at {rates_hz[name] / each.rows:.4g} Hz, without the rows that repeat a reading"
        for name, each in held_channels.items()
    ]


def find_first_rows_of_runs(readings: Floats) -> Ints:
    """First row of each run of equal readings, (runs,)."""
    return np.flatnonzero(np.append(True, np.diff(readings) != 0.0))
