"""Channels of different rates on one uniform grid, without looking into the future or over gaps."""

from collections.abc import Mapping

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis import filters, mounting
from analysis.machine import Machine
from analysis.schema import HINTS, build
from estimators.errors import DataError

Ints = NDArray[np.int64]

#: Longer holes keep only their first and last row: a clock jump must not make a billion rows.
_LONGEST_HOLE_S = 60.0


def align(channels: Mapping[str, pl.DataFrame], machine: Machine) -> tuple[pl.DataFrame, int]:
    """Put every channel on one grid: the last value at or before, as long as it is fresh.

    A value is fresh for `gap_periods` of its channel's own median period (or of the grid's, if
    that is longer). The grid runs from the latest first sample to the earliest last one. A row in
    which any channel is stale is a gap; of a hole longer than 60 s only the ends are kept. Hints
    (boom, latitude, longitude) have no say in this; they are missing where they are stale.

    Args:
        channels: by name: unix_ns, ascending, and the channel's column.
        machine: IMU mounting, rate.

    Returns:
        `aligned`, and the unix time of its first row in ns.

    Raises:
        DataError: the channels share no time.
    """
    settings = machine.settings.align
    step_ns = 1e9 / settings.rate_hz
    series = {name: frame["unix_ns"].to_numpy() for name, frame in channels.items()}
    needed = {name: t for name, t in series.items() if name not in HINTS}
    start = max(int(t[0]) for t in needed.values())
    end = min(int(t[-1]) for t in needed.values())
    if end <= start:
        spans = ", ".join(
            f"{n} {t[0] / 1e9:.3f}…{t[-1] / 1e9:.3f} s" for n, t in sorted(needed.items())
        )
        raise DataError(f"the channels share no stretch of time: {spans}")
    fresh_ns = {name: filters.longest_step_ns(t, settings) for name, t in series.items()}
    grid = _grid(needed, fresh_ns, start, end, step_ns)
    gap = np.zeros(grid.size, np.bool_)
    columns: dict[str, NDArray[np.float64]] = {}
    for name, t in series.items():
        at = np.searchsorted(t, grid, side="right") - 1
        held = channels[name][name].to_numpy()[at]
        stale = (at < 0) | (grid - t[at] > fresh_ns[name])
        columns[name] = np.where(stale, np.nan, held)
        if name in needed:
            gap |= stale
    columns = mounting.at_origin(columns, machine.machine.imu)
    return build("aligned", {"t_ns": grid - start, **columns, "gap": gap}), start


def _grid(
    series: Mapping[str, Ints], fresh_ns: Mapping[str, float], start: int, end: int, step_ns: float
) -> Ints:
    """Lattice points from start to end, without the inside of holes longer than the limit."""
    holes = [
        # in integers: a float holds unix time to a quarter of a microsecond only
        (int(t[i]) + round(fresh_ns[name]), int(t[i + 1]))
        for name, t in series.items()
        for i in np.flatnonzero(np.diff(t) > fresh_ns[name] + _LONGEST_HOLE_S * 1e9)
    ]
    pieces: list[Ints] = []
    first = 0
    for opened, closed in sorted(holes):
        # the first row that is stale, and the last one
        left = int((opened - start) // step_ns) + 1
        right = int((closed - start) // step_ns) - 1
        if right <= max(left, first):
            continue
        if left >= first:
            pieces.append(np.arange(first, left + 1))
        first = max(first, right)
    # the slack keeps a last row that rounding would put just after the end
    pieces.append(np.arange(first, int((end - start) / step_ns + 1e-9) + 1))
    rows = np.concatenate(pieces)
    if step_ns.is_integer():
        return start + rows * int(step_ns)
    return start + np.round(rows * step_ns).astype(np.int64)
