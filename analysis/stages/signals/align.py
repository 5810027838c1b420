"""Channels of different rates on one uniform grid: interpolated alike, never over a gap."""

from collections.abc import Mapping

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.model.machine import Machine
from analysis.model.schema import HINTS, build
from analysis.stages.signals import filters, mounting, rates
from analysis.stages.signals.rates import ChannelSeries
from estimators.errors import DataError

Ints = NDArray[np.int64]

#: Longer holes keep only their first and last row: a clock jump must not make a billion rows.
_LONGEST_HOLE_S = 60.0
#: Rows of the longest grid: eighty hours at 100 Hz, a quarter of a gigabyte a column.
_MOST_ROWS = 30_000_000


def align(channels: Mapping[str, pl.DataFrame], machine: Machine) -> tuple[pl.DataFrame, int]:
    """Put every channel on one grid: on the line between the samples before and after.

    Neighbours are no further apart than `gap_periods` of their channel's own median period (or of
    the grid's, if that is longer); a row between others is a gap. A topic faster than the grid is
    averaged over a grid step instead, and a regressor with a slow channel is taken at that one's
    stamps first. The grid runs from the latest first sample to the earliest last one; of a hole
    longer than 60 s only the ends are kept. Hints (boom, bucket, latitude, longitude) have no say
    in this; they are missing where they have no neighbours.

    With `filter.causal` a row holds the motion `align.latency_s` before it, or that of the newest
    instant that every channel of the regressor is known of by then, alike on all of them; another
    channel of which that is not known yet has its newest value.

    Args:
        channels: by name: unix_ns, strictly ascending, the channel's column, and with
            `filter.causal` known_ns, where that is another time.
        machine: channels of the regressor, IMU mounting, rate.

    Returns:
        `aligned`, and the unix time of its first row in ns.

    Raises:
        DataError: the channels share no time, or their grid would not fit into memory.
    """
    settings = machine.settings
    raw = {name: rates.series_of(name, frame, settings.align) for name, frame in channels.items()}
    series = _reduced(raw, machine)
    needed = {name: each for name, each in series.items() if name not in HINTS}
    start, end = _common(needed)
    grid = _grid(needed, start, end, 1e9 / settings.align.rate_hz)
    late_ns = _latency_ns(series, machine) if settings.filter.causal else 0
    chosen = _Chosen(series, grid, late_ns, machine) if settings.filter.causal else None
    gap = np.zeros(grid.size, np.bool_)
    columns: dict[str, NDArray[np.float64]] = {}
    for name, each in series.items():
        instants, stale = chosen.of(name) if chosen else (grid, np.False_)
        x = each.at(instants)
        if each is not raw[name]:
            # between two stamps of the slowest channel, a faster one may have a gap
            stale = stale | np.isnan(raw[name].at(instants))
        columns[name] = np.where(stale, np.nan, rates.wrapped(name, x))
        if name in needed:
            gap |= np.isnan(columns[name])
    columns = mounting.at_origin(columns, machine.machine.imu)
    return build("aligned", {"t_ns": grid - start, **columns, "gap": gap}), start + late_ns


def notes(channels: Mapping[str, pl.DataFrame], machine: Machine) -> list[str]:
    """Say what `align` does to these channels that a reader of the answer should know."""
    raw = {n: rates.series_of(n, frame, machine.settings.align) for n, frame in channels.items()}
    said = [str(each) for each in rates.reduced(raw, machine)]
    if machine.settings.filter.causal:
        late_s = _latency_ns(_reduced(raw, machine), machine) / 1e9
        said.append(f"causal: a row holds the motion {late_s:.4g} s before it (align.latency_s)")
    return said


def _reduced(raw: Mapping[str, ChannelSeries], machine: Machine) -> dict[str, ChannelSeries]:
    series = dict(raw)
    for each in rates.reduced(raw, machine):
        series |= rates.reduce(raw, each)
    return series


def _common(needed: Mapping[str, ChannelSeries]) -> tuple[int, int]:
    """The latest first stamp and the earliest last one."""
    spans = {name: (int(s.t_ns[0]), int(s.t_ns[-1])) for name, s in sorted(needed.items())}
    start, end = max(first for first, _ in spans.values()), min(last for _, last in spans.values())
    if end <= start:
        shown = (f"{n} {first / 1e9:.3f}…{last / 1e9:.3f} s" for n, (first, last) in spans.items())
        raise DataError(f"the channels share no stretch of time: {', '.join(shown)}")
    return start, end


def _latency_ns(series: Mapping[str, ChannelSeries], machine: Machine) -> int:
    """The setting's, or as long as the next sample of the regressor's slowest channel takes."""
    given = machine.settings.align.latency_s
    if given is not None:
        return round(given * 1e9)
    names = frozenset[str]().union(*rates.regressors(machine)) & set(series)
    return round(max(filters.period_ns(series[n].t_ns) + series[n].lag_ns for n in names))


class _Chosen:
    """The instants that rows hold where nothing may be known before it has come.

    A row at the time t stands for t - latency; where a channel of the regressor is not known of
    that yet, all of them are taken at the newest instant that is known of all.
    """

    def __init__(
        self, series: Mapping[str, ChannelSeries], grid: Ints, late_ns: int, machine: Machine
    ) -> None:
        self.series, self.grid, self.late_ns = series, grid, late_ns
        self.names = frozenset[str]().union(*rates.regressors(machine)) & set(series)
        self.shared = grid
        for name in self.names:
            self.shared = np.minimum(self.shared, series[name].newest(grid + late_ns))

    def of(self, name: str) -> tuple[Ints, NDArray[np.bool_]]:
        """The instants (rows,) of a channel, and where its newest sample is too old."""
        each = self.series[name]
        newest = each.newest(self.grid + self.late_ns)
        usual = self.grid - max(0, round(each.lag_ns) - self.late_ns)
        instants = self.shared if name in self.names else np.minimum(self.grid, newest)
        return instants, usual - newest > each.longest_ns


def _grid(needed: Mapping[str, ChannelSeries], start: int, end: int, step_ns: float) -> Ints:
    """Lattice points from start to end, without the inside of holes longer than the limit."""
    holes = [
        # in integers: a float holds unix time to a quarter of a microsecond only
        (int(each.t_ns[i]) + round(each.longest_ns), int(each.t_ns[i + 1]))
        for each in needed.values()
        for i in np.flatnonzero(np.diff(each.t_ns) > each.longest_ns + _LONGEST_HOLE_S * 1e9)
    ]
    pieces: list[tuple[int, int]] = []
    first = 0
    for opened, closed in sorted(holes):
        # a row behind the last sample, and the last one before the next
        left = int((opened - start) // step_ns) + 1
        right = int((closed - start) // step_ns) - 1
        if right <= max(left, first):
            continue
        if left >= first:
            pieces.append((first, left + 1))
        first = max(first, right)
    # the slack keeps a last row that rounding would put just after the end
    pieces.append((first, int((end - start) / step_ns + 1e-9) + 1))
    count = sum(stop - begin for begin, stop in pieces)
    if count > _MOST_ROWS:
        raise DataError(
            f"{(end - start) / 1e9:,.0f} s at {1e9 / step_ns:g} Hz are {count:,} rows, more than "
            f"{_MOST_ROWS:,}: check the unit of the time, or lower settings.align.rate_hz"
        )
    rows = np.concatenate([np.arange(*piece) for piece in pieces])
    if step_ns.is_integer():
        return start + rows * int(step_ns)
    return start + np.round(rows * step_ns).astype(np.int64)
