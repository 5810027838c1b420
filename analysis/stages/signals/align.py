"""Align channels of different rates on one uniform grid, by equal interpolation without gaps."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.model.column_arrays import ColumnArrays
from analysis.model.machine import Machine
from analysis.model.schema import HINTS, build_frame
from analysis.stages.signals import filters, mounting, rates
from analysis.stages.signals.rates import ChannelSamples, ChannelSeries
from analysis.stages.signals.signal_limits import LIMITS
from estimators.arrays import Ints
from estimators.errors import DataError


class AlignedGrid(NamedTuple):
    """Frame `aligned`, and the Unix time of its first row."""

    aligned: pl.DataFrame
    t0_unix_ns: int


def align_channels_on_grid(channels: Mapping[str, ChannelSamples], machine: Machine) -> AlignedGrid:
    """Interpolate every channel linearly on one uniform grid.

    Two samples are interpolated if they are no further apart than `gap_periods` of their channel's
    median period (or of the grid's, if that is longer); rows between others are a gap. A topic
    faster than the grid is averaged over a grid step instead, and a regressor with a slow channel
    is first taken at that channel's stamps. The grid runs from the latest first sample to the
    earliest last one; if a channel lacks more than a minute at an end of the log that another has,
    the grid extends to that end, with a gap. The inside of gaps longer than 60 s is left out. Hints
    (boom, bucket, latitude, longitude) do not affect the grid; they are null where not known.

    With `filter.causal` a row holds the motion of `align.latency_s` earlier. If a channel of the
    regressor is not known yet for that instant, all are taken at the newest instant at which all
    are known; any other channel that is not known yet has its newest value.

    Args:
        channels: samples by channel.
        machine: machine file with channels, IMU mounting and rate.

    Returns:
        Frame `aligned`, and the Unix time of its first row.

    Raises:
        DataError: the channels do not overlap in time, or the grid would not fit into memory.
    """
    raw, series = _make_channel_and_regressor_series(channels, machine)
    common = find_common_span_ns(select_required_series(series))
    start, end = extend_to_ends_of_log_ns(common, select_required_series(raw))
    origin = GridOrigin(
        start, choose_grid_latency_ns(series, machine) if machine.settings.filter.causal else 0
    )
    grid = make_grid_without_long_gaps(
        select_required_series(series), start, end, 1e9 / machine.settings.align.rate_hz
    )
    aligned = align_channels_at_instants(raw, series, grid, origin, machine)
    return AlignedGrid(build_frame("aligned", aligned), start + origin.latency_ns)


class GridOrigin(NamedTuple):
    """Start of the grid, and delay of its rows.

    Attributes:
        start_ns: Unix time of the instant in the first row.
        latency_ns: delay of every row behind its instant; 0 unless the replay is causal.
    """

    start_ns: int
    latency_ns: int


def find_origin_of_causal_grid(
    channels: Mapping[str, ChannelSamples], machine: Machine
) -> GridOrigin:
    """Origin of the grid of a causal replay, from the first seconds of its channels.

    Raises:
        DataError: the channels do not overlap in time yet.
    """
    raw, series = _make_channel_and_regressor_series(channels, machine)
    common = find_common_span_ns(select_required_series(series))
    return GridOrigin(
        extend_to_ends_of_log_ns(common, select_required_series(raw))[0],
        choose_grid_latency_ns(series, machine),
    )


def align_known_rows_on_causal_grid(
    channels: Mapping[str, ChannelSamples],
    machine: Machine,
    origin: GridOrigin,
    after_ns: int,
    *,
    is_log_complete: bool,
) -> ColumnArrays:
    """Rows of a causal grid that are known by now, the same as in the frame of the whole log.

    Args:
        channels: newest part of each channel, as in `align`.
        machine: machine file with channels, IMU mounting and rate.
        origin: origin of the grid.
        after_ns: `t_ns` of the first row to return.
        is_log_complete: whether no further samples will come; otherwise a row is returned only once
            every channel has a sample that arrived at its time or later.

    Returns:
        Columns of `aligned`, rows from `after_ns` on.
    """
    raw, series = _make_channel_and_regressor_series(channels, machine)
    needed = select_required_series(series)
    if is_log_complete:
        last = min(int(each.t_ns[-1]) for each in needed.values())
        _, end = extend_to_ends_of_log_ns((origin.start_ns, last), select_required_series(raw))
    else:
        end = min(int(raw[name].known_ns[-1]) for name in needed) - origin.latency_ns
    step_ns = 1e9 / machine.settings.align.rate_hz
    first = max(0, math.ceil(after_ns / step_ns - 1e-9))
    if end < origin.start_ns + round(first * step_ns):
        grid = np.empty(0, np.int64)
    else:
        grid = make_grid_without_long_gaps(needed, origin.start_ns, end, step_ns, first)
    return align_channels_at_instants(raw, series, grid, origin, machine)


def _make_channel_and_regressor_series(
    channels: Mapping[str, ChannelSamples], machine: Machine
) -> tuple[dict[str, ChannelSeries], dict[str, ChannelSeries]]:
    """All channels at their own stamps, and again with each regressor's at its slowest stamps."""
    raw = rates.make_series_of_channels(channels, machine)
    return raw, _average_fast_channels_to_slowest(raw, machine)


def select_required_series(series: Mapping[str, ChannelSeries]) -> dict[str, ChannelSeries]:
    """Channels without the hints, which the grid does not depend on."""
    return {name: each for name, each in series.items() if name not in HINTS}


def align_channels_at_instants(
    full_rate_series: Mapping[str, ChannelSeries],
    series: Mapping[str, ChannelSeries],
    grid_instants_ns: Ints,
    origin: GridOrigin,
    machine: Machine,
) -> ColumnArrays:
    """Columns of `aligned` at the given instants (rows,) of the grid."""
    is_causal = machine.settings.filter.causal
    chosen = (
        KnownInstants(series, grid_instants_ns, origin.latency_ns, machine) if is_causal else None
    )
    gap = np.zeros(grid_instants_ns.size, np.bool_)
    columns: dict[str, NDArray[np.float64]] = {}
    for name, each in series.items():
        instants, stale = (
            chosen.find_newest_known_instants_and_staleness(name)
            if chosen
            else (grid_instants_ns, np.False_)
        )
        x = each.interpolate_values(instants)
        if each is not full_rate_series[name]:
            # between two stamps of the slowest channel, a faster one may have a gap
            stale = stale | np.isnan(full_rate_series[name].interpolate_values(instants))
        columns[name] = np.where(stale, np.nan, rates.wrap_angle_of_channel(name, x))
        if name not in HINTS:
            gap |= np.isnan(columns[name])
    columns = mounting.transfer_acceleration_to_origin(columns, machine.machine.imu)
    return ColumnArrays(t_ns=grid_instants_ns - origin.start_ns, **columns, gap=gap)


def list_alignment_notes(channels: Mapping[str, ChannelSamples], machine: Machine) -> list[str]:
    """Notes on what `align` does to these channels."""
    raw = rates.make_series_of_channels(channels, machine)
    said = _list_long_gap_notes(raw)
    said += [str(each) for each in rates.list_rate_limited_regressors(raw, machine)]
    if machine.settings.filter.causal:
        late_s = (
            choose_grid_latency_ns(_average_fast_channels_to_slowest(raw, machine), machine) / 1e9
        )
        said.append(f"causal: a row holds the motion {late_s:.4g} s before it (align.latency_s)")
    return said


def _average_fast_channels_to_slowest(
    raw: Mapping[str, ChannelSeries], machine: Machine
) -> dict[str, ChannelSeries]:
    """Average the channels of each regressor over the steps of its slowest channel."""
    series = dict(raw)
    for each in rates.list_rate_limited_regressors(raw, machine):
        series |= rates.resample_to_slowest_channel(raw, each)
    return series


def find_common_span_ns(required_channels: Mapping[str, ChannelSeries]) -> tuple[int, int]:
    """Latest first stamp and earliest last stamp of the channels, in Unix ns."""
    spans = {
        name: (int(s.t_ns[0]), int(s.t_ns[-1])) for name, s in sorted(required_channels.items())
    }
    start, end = max(first for first, _ in spans.values()), min(last for _, last in spans.values())
    if end <= start:
        shown = (f"{n} {first / 1e9:.3f}…{last / 1e9:.3f} s" for n, (first, last) in spans.items())
        raise DataError(
            "the channels do not overlap in time; check their topics and clocks: "
            f"{', '.join(shown)}"
        )
    return start, end


def extend_to_ends_of_log_ns(
    span_ns: tuple[int, int], required_channels: Mapping[str, ChannelSeries]
) -> tuple[int, int]:
    """Extend the common span to an end of the log if a channel lacks over a minute there.

    Args:
        span_ns: start and end of the span that all channels cover.
        required_channels: channels at their own stamps.
    """
    first = [int(each.t_ns[0]) for each in required_channels.values()]
    last = [int(each.t_ns[-1]) for each in required_channels.values()]
    start_ns, end_ns = span_ns
    return (
        min(first) if is_missing_end_of_log(max(first) - min(first)) else start_ns,
        max(last) if is_missing_end_of_log(max(last) - min(last)) else end_ns,
    )


def is_missing_end_of_log(missing_ns: int) -> bool:
    """Whether a channel that lacks `missing_ns` at an end of the log has a gap there."""
    return LIMITS.longest_gap_s * 1e9 < missing_ns <= LIMITS.missing_end_max_s * 1e9


def choose_grid_latency_ns(series: Mapping[str, ChannelSeries], machine: Machine) -> int:
    """Latency of the settings, or the period of the regressor's slowest channel."""
    given = machine.settings.align.latency_s
    if given is not None:
        return round(given * 1e9)
    names = frozenset[str]().union(*rates.list_channel_sets_of_equations(machine)) & set(series)
    return round(
        max(
            filters.compute_median_period_ns(series[n].t_ns) + series[n].typical_lag_ns
            for n in names
        )
    )


class KnownInstants:
    """Instants that the rows of a causal grid represent.

    A row at time t uses only samples that have arrived by t, and represents t - latency. If a
    channel of the regressor is not known for that instant, all are taken at the newest instant at
    which all are known.
    """

    def __init__(
        self, series: Mapping[str, ChannelSeries], grid: Ints, latency_ns: int, machine: Machine
    ) -> None:
        self.series, self.grid, self.latency_ns = series, grid, latency_ns
        self.names = frozenset[str]().union(*rates.list_channel_sets_of_equations(machine)) & set(
            series
        )
        self.newest = {
            name: each.find_newest_known_instant_ns(grid + latency_ns)
            for name, each in series.items()
        }
        self.shared = grid
        for name in self.names:
            self.shared = np.minimum(self.shared, self.newest[name])

    def find_newest_known_instants_and_staleness(self, name: str) -> tuple[Ints, NDArray[np.bool_]]:
        """Instants (rows,) to take a channel at, and whether its newest sample is too old."""
        each = self.series[name]
        newest = self.newest[name]
        usual = self.grid - max(0, round(each.typical_lag_ns) - self.latency_ns)
        instants = self.shared if name in self.names else np.minimum(self.grid, newest)
        return instants, usual - newest > each.longest_ns


def find_long_gaps_ns(
    required_channels: Mapping[str, ChannelSeries], longest_s: float, start_ns: int, end_ns: int
) -> list[tuple[int, int]]:
    """Start and end in ns of each channel's gaps that are longer than `longest_s`.

    `start_ns` and `end_ns` are the ends of the grid.
    """
    return sorted(
        # in integers: a float holds unix time to a quarter of a microsecond only
        (int(t_ns[i]) + round(each.longest_ns), int(t_ns[i + 1]))
        for each in required_channels.values()
        for least_ns in [each.longest_ns + longest_s * 1e9]
        if max(end_ns, each.t_ns[-1]) - min(start_ns, each.t_ns[0]) > least_ns
        for t_ns in [pad_stamps_to_span(each.t_ns, start_ns, end_ns)]
        for i in np.flatnonzero(np.diff(t_ns) > least_ns)
    )


def pad_stamps_to_span(t_ns: Ints, start_ns: int, end_ns: int) -> Ints:
    """Stamps, with the start and the end of the span added if they lie outside the stamps."""
    before = [start_ns] if start_ns < t_ns[0] else []
    after = [end_ns] if end_ns > t_ns[-1] else []
    if not before and not after:
        return t_ns
    return np.concatenate([np.array(before, np.int64), t_ns, np.array(after, np.int64)])


def _list_long_gap_notes(series: Mapping[str, ChannelSeries]) -> list[str]:
    """Notes on channels without readings at an end of the log, and in its longest gap between.

    A gap between counts from `LIMITS.reported_gap_s`; shorter ones are pauses.
    """
    required = select_required_series(series)
    start, end = find_common_span_ns(required)
    span = extend_to_ends_of_log_ns((start, end), required)
    within = find_long_gaps_ns(required, LIMITS.reported_gap_s, start, end)
    longest = [max(within, key=lambda gap: gap[1] - gap[0])] if within else []
    ends = [(int(each.t_ns[0]), int(each.t_ns[-1])) for each in required.values()]
    least_ns = LIMITS.longest_gap_s * 1e9
    at_start = [(span[0], t) for t in sorted({t for t, _ in ends})[::-1] if t - span[0] > least_ns]
    at_end = [(t, span[1]) for t in sorted({t for _, t in ends}) if span[1] - t > least_ns]
    said: dict[tuple[int, tuple[str, ...]], str] = {}
    for side, gaps in enumerate((at_start, longest, at_end)):
        for opened, closed in gaps:
            names = _list_channels_without_readings(required, opened, closed, span)
            minutes, from_s = (closed - opened) / 6e10, (opened - span[0]) / 1e9
            if names:  # of hardly more than a minute there may be none
                told = _describe_long_gap(names, len(required), minutes, from_s)
                said.setdefault((side, names), told)
    return list(said.values())


def _list_channels_without_readings(
    required: Mapping[str, ChannelSeries], opened_ns: int, closed_ns: int, span_ns: tuple[int, int]
) -> tuple[str, ...]:
    """Channels with a gap that covers nearly all of the time from `opened_ns` to `closed_ns`."""
    least_ns = LIMITS.same_gap_1 * (closed_ns - opened_ns)
    return tuple(
        name
        for name, each in required.items()
        if any(
            min(last, closed_ns) - max(first, opened_ns) >= least_ns
            for first, last in find_long_gaps_ns({name: each}, LIMITS.longest_gap_s, *span_ns)
        )
    )


def _describe_long_gap(
    names: Sequence[str], channel_count: int, minutes: float, from_s: float
) -> str:
    """Sentence on a gap: the channels without readings, its duration and its start."""
    are_all = len(names) == channel_count
    return (
        f"no readings{'' if are_all else ' of ' + ', '.join(names)} for "
        f"{f'{minutes / 60.0:.3g} h' if minutes > 60.0 else f'{minutes:.3g} min'} from "
        f"{from_s:,.0f} s on"
        + (": the load, the ground and the sensors may have changed there" if are_all else "")
    )


def make_grid_without_long_gaps(
    required_channels: Mapping[str, ChannelSeries],
    start_ns: int,
    end_ns: int,
    step_ns: float,
    first_point_number: int = 0,
) -> Ints:
    """Grid points (rows,) in ns from start to end, without those inside long gaps.

    Points are numbered from `start_ns`; none before `first_point_number` is returned.
    """
    pieces: list[tuple[int, int]] = []
    gaps = find_long_gaps_ns(required_channels, LIMITS.longest_gap_s, start_ns, end_ns)
    for opened, closed in gaps:
        # the first row after the last sample, and the last one before the next sample
        left = int((opened - start_ns) // step_ns) + 1
        right = int((closed - start_ns) // step_ns) - 1
        if right <= max(left, first_point_number):
            continue
        if left >= first_point_number:
            pieces.append((first_point_number, left + 1))
        first_point_number = max(first_point_number, right)
    # the slack keeps a last row that rounding would put just after the end
    pieces.append((first_point_number, int((end_ns - start_ns) / step_ns + 1e-9) + 1))
    count = sum(stop - start for start, stop in pieces)
    if count > LIMITS.grid_max_rows:
        raise DataError(
            f"{(end_ns - start_ns) / 1e9:,.0f} s at {1e9 / step_ns:g} Hz are {count:,} rows, more "
            f"than {LIMITS.grid_max_rows:,}: check the unit of the time, or lower "
            "settings.align.rate_hz"
        )
    rows = np.concatenate([np.arange(*piece) for piece in pieces])
    if step_ns.is_integer():
        return start_ns + rows * int(step_ns)
    return start_ns + np.round(rows * step_ns).astype(np.int64)
