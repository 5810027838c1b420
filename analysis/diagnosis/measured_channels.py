"""The raw channels before any filter: clock drift, frozen readings and clipped readings."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
import polars as pl

from analysis.diagnosis.diagnosis_limits import LIMITS
from analysis.model.machine import FORCES, Machine
from analysis.model.physical_units import split_unit_from_name
from analysis.model.windows import find_flagged_runs, flag_rows_near_flagged_rows
from analysis.stages.signals.filters import compute_median_period_ns
from analysis.stages.signals.speed_threshold import SPEEDS, estimate_zero_speed_threshold_m_s
from analysis.stages.signals.timestamps import (
    RelativeDrift,
    find_largest_relative_clock_drift,
    measure_clock_drifts_by_topic,
)
from estimators.arrays import Floats, Ints

Series = tuple[Ints, Floats]
Spans = list[tuple[int, int]]

#: Channels that may freeze, besides forces.
_MOTION: Final = (*SPEEDS, "specific_force_x_m_s2")
#: Further channels that show that something changes; a position is constant at standstill.
_BESIDE: Final = ("position_x_m", "acc_x_m_s2")


class RepeatedReading(NamedTuple):
    """A stretch that repeats one reading: start and end in Unix ns, and the value."""

    start_ns: int
    end_ns: int
    value: float


@dataclass(frozen=True)
class RawSignals:
    """Raw channels.

    Attributes:
        channels: Unix stamps in ns and unfiltered readings in SI units, by channel.
        drift: the two clocks whose drift is most significant; None if undetermined.
        span_s: duration of the log.
        force_channels: channels that the force is computed from
            (`Machine.recorded_force_channels`).
    """

    channels: Mapping[str, Series]
    drift: RelativeDrift | None
    span_s: float
    force_channels: tuple[str, ...] = FORCES

    @property
    def clock_drift_over_log_s(self) -> float:
        """Drift between the clocks over the log in s; 0 if it may be noise."""
        if self.drift is None or self.drift.drift_ppm < 5.0 * self.drift.drift_std_ppm:
            return 0.0
        return self.drift.drift_ppm * 1e-6 * self.span_s

    @cached_property
    def _repeated_readings_by_channel(self) -> dict[str, list[RepeatedReading]]:
        """Stretches in which a force or motion channel repeats itself while another changes."""
        names = (*self.force_channels, *_MOTION, *_BESIDE)
        looked = {name: series for name, series in self.channels.items() if name in names}
        return {
            name: find_repeated_readings(name, looked, self.force_channels)
            for name in looked
            if name not in _BESIDE
        }

    @cached_property
    def fraction_by_clipping_level_of_channel(self) -> dict[str, dict[float, float]]:
        """Limits of each force channel, and the fraction of its readings at each.

        Readings that accumulate at an extreme, or return to one value for a long time, indicate a
        clipping sensor or an engine at its maximum.
        """
        found = {
            name: {
                **find_fraction_at_repeated_extremes(x),
                **find_fraction_at_clipping_levels(self._repeated_readings_by_channel[name], x),
            }
            for name, (_, x) in self.channels.items()
            if name in self.force_channels
        }
        # the lower of two pressures stays at the feed pressure, far below the working pressures
        unit = {name: split_unit_from_name(name)[1] for name in found}
        largest = {
            name: max(
                float(np.abs(self.channels[each][1]).max())
                for each in found
                if unit[each] == unit[name]
            )
            for name in {*found} - {*FORCES}
        }
        return {
            name: {
                at: share for at, share in levels.items() if 2.0 * abs(at) > largest.get(name, 0.0)
            }
            for name, levels in found.items()
        }

    @cached_property
    def frozen_spans(self) -> dict[str, Spans]:
        """Spans in ns in which a force or motion channel is frozen, limits excluded, by channel.

        If several pressures or currents give the force, one may be constant while others change.
        """
        rests = set(self.force_channels) - {*FORCES} if len(self.force_channels) > 1 else set()
        return {
            name: [
                (run.start_ns, run.end_ns)
                for run in runs
                if run.value not in self.fraction_by_clipping_level_of_channel.get(name, {})
            ]
            for name, runs in self._repeated_readings_by_channel.items()
            if name not in rests
        }

    @cached_property
    def standstill_spans(self) -> Spans:
        """Spans in ns in which every speed reads exactly 0, so that no channel has to change."""
        by_speed = [
            find_zero_speed_spans(*self.channels[name]) for name in SPEEDS if name in self.channels
        ]
        common = by_speed[0] if by_speed else []
        for spans in by_speed[1:]:
            common = intersect_spans(common, spans)
        return common

    @property
    def longest_frozen_duration_s(self) -> float:
        """Total frozen duration in s of the channel that is frozen for longest."""
        spans = self.frozen_spans.values()
        return max((sum(end - start for start, end in each) / 1e9 for each in spans), default=0.0)

    @cached_property
    def clipped_fraction_and_limit_by_channel(self) -> dict[str, tuple[float, float]]:
        """Largest fraction of readings at one limit, and that limit, by force channel."""
        nothing = (0.0, float("nan"))
        return {
            name: max(((share, at) for at, share in found.items()), default=nothing)
            for name, found in self.fraction_by_clipping_level_of_channel.items()
        }

    @cached_property
    def clipped_spans(self) -> dict[str, Spans]:
        """Spans in ns in which a force channel stays at a limit, by channel."""
        return {
            name: find_spans_at_limits(list(found), *self.channels[name])
            for name, found in self.fraction_by_clipping_level_of_channel.items()
            if found
        }

    @property
    def largest_clipped_fraction(self) -> float:
        """Largest fraction of a force channel's readings at its limit."""
        return max(
            (share for share, _ in self.clipped_fraction_and_limit_by_channel.values()), default=0.0
        )

    def interpolate_force(self, unix_ns: Ints) -> Floats | None:
        """Unfiltered force or sum of both torques at the stamps, (n,); None if it is derived."""
        names = [name for name in FORCES if name in self.channels]
        if not names:
            return None
        return np.sum(
            [_interpolate_reading_at_stamps(*self.channels[name], unix_ns) for name in names],
            axis=0,
        )


def collect_raw_signals(
    raw_frames: Mapping[str, pl.DataFrame],
    clocks: Mapping[str, str],
    channels: Mapping[str, Series],
    machine: Machine,
) -> RawSignals:
    """Collect the raw channels of a log.

    Args:
        raw_frames: frames by topic, with log times and header stamps.
        clocks: clock that places the samples of each topic: "header", "log" or "table".
        channels: readings by `analysis.stages.signals.derive.read_measured_channels`.
        machine: machine file.
    """
    span_ns = max((int(t[-1] - t[0]) for t, _ in channels.values()), default=0)
    return RawSignals(
        channels,
        find_largest_relative_clock_drift(measure_clock_drifts_by_topic(raw_frames, clocks)),
        span_ns / 1e9,
        machine.recorded_force_channels,
    )


def _interpolate_reading_at_stamps(t_ns: Ints, readings: Floats, at_ns: Ints) -> Floats:
    origin = t_ns[0]
    return np.interp((at_ns - origin).astype(float), (t_ns - origin).astype(float), readings)


def find_runs_of_equal_readings(readings: Floats) -> tuple[Ints, Ints]:
    """First and last index of each run of equal readings, (runs,) each."""
    first = np.flatnonzero(np.append(True, np.diff(readings) != 0.0))
    return first, np.append(first[1:], readings.size) - 1


def find_unexplained_repeats(unix_ns: Ints, readings: Floats) -> tuple[list[RepeatedReading], bool]:
    """Find long runs of one reading that the channel's resolution does not explain.

    Returns:
        The runs, and whether the channel hardly ever repeats a reading elsewhere.
    """
    first, last = find_runs_of_equal_readings(readings)
    long = ((unix_ns[last] - unix_ns[first]) > LIMITS.frozen_s * 1e9) & (
        last - first >= LIMITS.run_min_readings - 1
    )
    others = int((last - first + 1)[~long].sum())
    never = (
        others > LIMITS.repeating_min_fraction * readings.size
        and int((last - first)[~long].sum()) <= LIMITS.repeating_max_fraction * others
    )
    return [
        RepeatedReading(int(unix_ns[start]), int(unix_ns[end]), float(readings[start]))
        for start, end in zip(first[long], last[long], strict=True)
        if not does_signal_stay_within_resolution(readings, int(start), int(end))
    ], never


def does_signal_stay_within_resolution(readings: Floats, first_row: int, last_row: int) -> bool:
    """Whether a run of equal readings is a smooth signal that changes by less than its resolution.

    Such a signal, at rest or at an extremum, is slow before and after the run, leaves it by a step
    of its resolution or at the rate that follows, and shows no noise. After a frozen sensor the
    signal jumps, and before a clipped one it changes fast.
    """
    half = (last_row - first_row + 1) // 2
    reach = max(LIMITS.smooth_readings, half)
    steps = [
        np.diff(readings[max(first_row - reach, 0) : first_row + 1][::-1]),
        np.diff(readings[last_row : last_row + reach + 1]),
    ]
    sizes = np.abs(np.concatenate(steps))
    if min(side.size for side in steps) < LIMITS.run_min_readings or not sizes.any():
        return False  # too few readings before and after the run
    # the decimals of a table round the steps, which differ slightly
    one_step = LIMITS.single_step_ratio * float(sizes[sizes > 0.0].min())
    # a signal that stays within a step for so long changes little for half as long, at least on
    # one side: twice as far from its top a parabola is three steps lower
    if min(np.abs(side[:half]).sum() for side in steps) > LIMITS.slow_max_steps * one_step:
        return False
    for side in np.abs(steps[0]), np.abs(steps[1]):
        if side[0] > max(side[1] + one_step, LIMITS.single_step_ratio * side[1]):
            return False
    # noise reverses by more than a step
    turns = [
        (side[1:] * side[:-1] < 0.0) & (np.minimum(abs(side[1:]), abs(side[:-1])) > one_step)
        for side in steps
    ]
    return float(np.mean(np.concatenate(turns))) <= LIMITS.smooth_max_turns


def find_zero_speed_spans(unix_ns: Ints, speed: Floats) -> Spans:
    """Long spans, in ns, in which a speed reads 0 after falling and before rising gradually."""
    first, last = find_runs_of_equal_readings(speed)
    before, after = (
        np.abs(speed[np.maximum(first - 1, 0)]),
        np.abs(speed[np.minimum(last + 1, speed.size - 1)]),
    )
    # next to a 0, an averaged speed falls by half of a loss of the sensor
    moves = ~flag_rows_near_flagged_rows(speed == 0.0, LIMITS.stand_edge_readings)
    steps = np.abs(np.diff(speed))[moves[1:] & moves[:-1]]
    small = max(
        LIMITS.stand_edge_range_fraction * float(np.quantile(np.abs(speed), 0.98)),
        LIMITS.stand_edge_threshold_ratio * estimate_zero_speed_threshold_m_s(speed),
        float(np.quantile(steps, LIMITS.stand_edge_step_quantile)) if steps.size else 0.0,
    )
    stands = (speed[first] == 0.0) & (before <= small) & (after <= small)
    stands &= (unix_ns[last] - unix_ns[first]) > LIMITS.frozen_s * 1e9
    return [
        (int(b), int(e)) for b, e in zip(unix_ns[first[stands]], unix_ns[last[stands]], strict=True)
    ]


def intersect_spans(spans_a: Spans, spans_b: Spans) -> Spans:
    """Intersection of two lists of spans in ns."""
    pairs = ((max(b, c), min(e, d)) for b, e in spans_a for c, d in spans_b)
    return [(start, end) for start, end in pairs if start < end]


def find_repeated_readings(
    channel: str, channels: Mapping[str, Series], force_channels: Sequence[str]
) -> list[RepeatedReading]:
    """Stretches in which a channel repeats itself while others change."""
    t, x = channels[channel]
    runs, never = find_unexplained_repeats(t, x)
    if runs and float(np.ptp(x)) == 0.0:
        changes = should_constant_channel_have_changed(channel, channels, force_channels)
        return runs if changes else []
    # at standstill the speed is 0, and while coasting the force
    runs = [run for run in runs if run.value != 0.0 or channel == "specific_force_x_m_s2"]
    if not runs:
        return []
    changes = LIMITS.frozen_noisy_change_fraction if never else LIMITS.frozen_change_fraction
    others = [
        (*series, changes * float(np.quantile(series[1], 0.98) - np.quantile(series[1], 0.02)))
        for key, series in channels.items()
        # a coarse position may not show a change
        if key != channel and (never or key not in _BESIDE)
    ]
    surely = [
        run
        for run in runs
        if any(does_channel_change(*each, run.start_ns, run.end_ns) for each in others)
    ]
    # a channel that froze once and has noise elsewhere is frozen wherever it repeats
    return runs if surely and never else surely


def should_constant_channel_have_changed(
    channel: str, channels: Mapping[str, Series], force_channels: Sequence[str]
) -> bool:
    """Whether a channel that is constant throughout should have changed, as other channels do."""
    of_motion = channel in _MOTION
    speeds = [x for key, (_, x) in channels.items() if key in SPEEDS and key != channel]
    forces = [x for key, (_, x) in channels.items() if key in force_channels and key != channel]
    # at standstill the speed is 0, whatever force and accelerometer read
    beside = speeds if of_motion else [*speeds, *forces]
    return any(float(np.ptp(x)) > 0.0 for x in beside)


def does_channel_change(
    unix_ns: Ints, readings: Floats, min_change: float, start_ns: int, end_ns: int
) -> bool:
    """Whether a channel changes by more than `min_change` between the halves of a stretch."""
    part = readings[
        np.searchsorted(unix_ns, start_ns) : np.searchsorted(unix_ns, end_ns, side="right")
    ]
    if part.size < 4:
        return False
    half = part.size // 2
    return abs(float(part[:half].mean() - part[half:].mean())) > min_change > 0.0


def find_fraction_at_repeated_extremes(readings: Floats) -> dict[float, float]:
    """Extremes at which readings accumulate, with the fraction of readings at each."""
    values, counts = np.unique(readings, return_counts=True)
    if values.size < 10:
        return {}
    return {
        float(values[end]): int(counts[end]) / readings.size
        for end, next_one in ((0, 1), (-1, -2))
        if counts[end]
        >= max(LIMITS.clipped_min_readings, LIMITS.clipped_count_ratio * counts[next_one])
        and values[end] != 0.0
    }


def find_fraction_at_clipping_levels(
    runs: list[RepeatedReading], readings: Floats
) -> dict[float, float]:
    """Levels at which readings are clipped, with the fraction of readings at each.

    Several long runs have the same level, and few readings exceed it.
    """
    often = Counter(run.value for run in runs)
    return {
        value: float((readings == value).mean())
        for value, times in often.items()
        if times >= LIMITS.limit_min_runs
        and (np.abs(readings) > abs(value)).mean() <= LIMITS.limit_max_beyond_fraction
    }


def find_spans_at_limits(limits: list[float], unix_ns: Ints, readings: Floats) -> Spans:
    """Spans in ns in which most readings are at a limit."""
    from scipy.ndimage import uniform_filter1d  # slow to import

    near = max(
        round(LIMITS.limit_window_s * 1e9 / compute_median_period_ns(unix_ns)),
        LIMITS.run_min_readings,
    )
    at = np.isin(readings, limits).astype(np.float64)
    first, last = find_flagged_runs(
        uniform_filter1d(at, near, mode="nearest") >= LIMITS.limit_min_fraction
    )
    return [(int(b), int(e)) for b, e in zip(unix_ns[first], unix_ns[last], strict=True)]
