"""Valid readings, low-pass and derivative at a topic's own rate, within gap-free stretches."""

from collections import defaultdict
from collections.abc import Sequence
from functools import reduce
from typing import cast

import numpy as np
import polars as pl

from analysis.model.loss import Loss
from analysis.model.machine import Channel
from analysis.model.settings import AlignSettings
from analysis.stages.signals.resample import interpolate_in_stretches
from analysis.stages.signals.signal_limits import LIMITS
from estimators.arrays import Bools, Floats, Ints
from estimators.errors import NoReadingError


def drop_readings_outside_range(
    name: str, channel: Channel, frame: pl.DataFrame, losses: list[Loss]
) -> pl.DataFrame:
    """Drop the rows whose reading lies outside the channel's `valid_range`, such as error codes.

    Args:
        name: of the channel.
        channel: the channel.
        frame: samples of its topic.
        losses: the number of dropped samples is added.

    Raises:
        NoReadingError: no reading is within the range.
    """
    if channel.valid_range is None:
        return frame
    low, high = channel.valid_range
    field = str(channel.field)
    if not frame[field].dtype.is_numeric():
        return frame
    reading = pl.col(field).cast(pl.Float64)
    inside = (reading.is_between(low, high) | reading.is_nan()).fill_null(value=True)
    left = frame.filter(inside)
    if left.is_empty() and not frame.is_empty():
        raise NoReadingError(
            f"{name}: {field} of {channel.topic or 'the table'} has no reading in valid_range, "
            f"{low:g} to {high:g}; correct valid_range, or choose another field"
        )
    if left.height < frame.height:
        losses.append(
            Loss(
                source=name,
                topic=channel.topic or "",
                what=f"{frame.height - left.height} of {frame.height} samples of {field} are "
                f"outside valid_range, {low:g} to {high:g}; they were excluded",
            )
        )
    return left


def compute_median_period_ns(t_ns: Ints) -> float:
    """Median period of ascending stamps in ns; NaN with fewer than two samples."""
    if t_ns.size < 2:
        return float("nan")
    steps = np.diff(t_ns)
    # for mostly equal steps, as of a grid, `np.median` takes fifteen times as long
    few = np.sort(steps[: LIMITS.common_step_steps])
    usual = few[few.size // 2]
    below, equal = np.count_nonzero(steps < usual), np.count_nonzero(steps == usual)
    is_median = below <= (steps.size - 1) // 2 and steps.size // 2 < below + equal
    return float(usual if is_median else np.median(steps))


def compute_gap_threshold_ns(t_ns: Ints, settings: AlignSettings) -> float:
    """Longest step in ns that is not a gap: `gap_periods` times the topic's or the grid's period.

    The longer of the two counts: log times come in bursts, and by the topic's own short period
    every pause would be a gap.
    """
    return settings.gap_periods * float(
        np.fmax(compute_median_period_ns(t_ns), 1e9 / settings.rate_hz)
    )


def find_slices_between_gaps(t_ns: Ints, max_gap_ns: float) -> list[slice]:
    """Slices without steps longer than `max_gap_ns`."""
    edges = np.flatnonzero(np.diff(t_ns) > max_gap_ns) + 1
    return [slice(a, b) for a, b in zip([0, *edges], [*edges, t_ns.size], strict=True)]


def apply_low_pass(
    t_ns: Ints, signal: Floats, cutoff_hz: float, max_gap_ns: float, *, causal: bool
) -> tuple[Ints, Floats]:
    """Butterworth low-pass of fourth order, forwards and backwards unless `causal`.

    Irregular stamps are first resampled at their median period. A stretch too short for the filter
    to settle is left out.

    Args:
        t_ns: (n,) ascending stamps.
        signal: (n,) samples.
        cutoff_hz: half-power frequency of one pass, below half the rate.
        max_gap_ns: longest step within a stretch.
        causal: whether to filter forwards only.

    Returns:
        Stamps and filtered samples.
    """
    # imported late: it takes as long as all other imports of a run, and few logs need it
    from scipy.signal import butter

    period = compute_median_period_ns(t_ns)
    sos = cast("Floats", butter(LIMITS.low_pass_order, cutoff_hz, fs=1e9 / period, output="sos"))
    settle = 3 * (2 * sos.shape[0] + 1)
    stretches = [
        _resample_uniformly(t_ns[part], signal[part], period)
        for part in find_slices_between_gaps(t_ns, max_gap_ns)
    ]
    stretches = [stretch for stretch in stretches if stretch[0].size > settle]
    if not stretches:
        return t_ns[:0], signal[:0]
    # filter all stretches of one length at once: bursts have thousands of them, and a call costs
    # as much as 20 samples
    indices_by_length: defaultdict[int, list[int]] = defaultdict(list)
    for index, (t, _) in enumerate(stretches):
        indices_by_length[t.size].append(index)
    filtered = [signal[:0]] * len(stretches)
    for indices in indices_by_length.values():
        rows = np.stack([stretches[index][1] for index in indices])
        outputs = _filter_rows(sos, rows, 0 if causal else settle)
        for index, output in zip(indices, outputs, strict=True):
            filtered[index] = output
    return np.concatenate([t for t, _ in stretches]), np.concatenate(filtered)


def _filter_rows(sos: Floats, rows: Floats, padding: int) -> Floats:
    """Filter each row of (stretches, samples) forwards, and also backwards if `padding` is not 0.

    Each row is padded by its point reflection at either end, as by `scipy.signal.sosfiltfilt`,
    which is not used since it solves for the filter's steady state in every call.
    """
    from scipy.signal import sosfilt, sosfilt_zi

    steady = np.asarray(sosfilt_zi(sos), np.float64)[:, None, :]

    def filter_forwards(signals: Floats) -> Floats:
        return np.asarray(sosfilt(sos, signals, zi=steady * signals[:, :1])[0], np.float64)

    if not padding:
        return filter_forwards(rows)
    before = 2 * rows[:, :1] - rows[:, padding:0:-1]
    after = 2 * rows[:, -1:] - rows[:, -2 : -(padding + 2) : -1]
    forwards = filter_forwards(np.concatenate([before, rows, after], axis=1))
    return filter_forwards(forwards[:, ::-1])[:, ::-1][:, padding:-padding]


def compute_low_pass_power_gain(frequency_over_cutoff_1: Floats, *, causal: bool) -> Floats:
    """Fraction of power that the low-pass passes, at frequencies over its cutoff.

    Valid for frequencies well below half the sampling rate.
    """
    one_pass = 1.0 / (1.0 + frequency_over_cutoff_1 ** (2 * LIMITS.low_pass_order))
    return one_pass if causal else one_pass**2


def differentiate_signal(
    t_ns: Ints, signal: Floats, max_gap_ns: float, *, causal: bool
) -> tuple[Ints, Floats]:
    """Derivative at each sample: the slope between its two neighbours in the same stretch.

    It has no delay if the stamps are even or scatter, and one of up to half an interval beside a
    missing sample. The slope of a parabola through three samples has no delay, but weights the
    shorter interval more: for even readings at 20 Hz whose stamps scatter by 10 ms, it is 5 % too
    large.

    If `causal`, the ends of a stretch have no derivative: it would be one-sided, and on board the
    end is not known yet. Otherwise the ends have one-sided slopes. As only neighbours are used, the
    result does not depend on where the log begins.
    """
    times: list[Ints] = []
    rates: list[Floats] = []
    for part in find_slices_between_gaps(t_ns, max_gap_ns):
        t, y = t_ns[part], signal[part]
        if t.size < 3:
            continue
        times.append(t[1:-1] if causal else t)
        slopes = (y[2:] - y[:-2]) / ((t[2:] - t[:-2]) / 1e9)
        if not causal:
            first, last = np.diff(y)[[0, -1]] / (np.diff(t)[[0, -1]] / 1e9)
            slopes = np.concatenate([[first], slopes, [last]])
        rates.append(slopes)
    if not times:
        return t_ns[:0], signal[:0]
    return np.concatenate(times), np.concatenate(rates)


def interpolate_linearly(
    t_ns: Ints, signal: Floats, at_ns: Ints, max_gap_ns: float
) -> tuple[Ints, Floats]:
    """Interpolate linearly at ascending instants, except across steps longer than `max_gap_ns`.

    Returns:
        Instants that have a value, and the values.
    """
    if np.array_equal(t_ns, at_ns):
        return at_ns, signal
    values = interpolate_in_stretches(t_ns, signal, at_ns, max_gap_ns)
    found = ~np.isnan(values)
    return at_ns[found], values[found]


def compute_interpolation_ready_ns(t_ns: Ints, known_ns: Ints, at_ns: Ints) -> Ints:
    """Time in ns at which the interpolation at each instant is known: arrival of the later sample.

    Args:
        t_ns: (n,) stamps, ascending.
        known_ns: (n,) arrival time of each sample.
        at_ns: (rows,) instants.
    """
    if at_ns is t_ns:
        return known_ns
    return known_ns[np.minimum(np.searchsorted(t_ns, at_ns), t_ns.size - 1)]


def find_latest_times_ns(times_ns: Sequence[Ints]) -> Ints:
    """Latest of several times in each row, (n,)."""
    return reduce(lambda one, other: one if one is other else np.maximum(one, other), times_ns)


def _resample_uniformly(t_ns: Ints, signal: Floats, period_ns: float) -> tuple[Ints, Floats]:
    if (
        t_ns.size < 2
        or np.abs(np.diff(t_ns) - period_ns).max() <= LIMITS.uniform_step_fraction * period_ns
    ):
        return t_ns, signal
    count = int((t_ns[-1] - t_ns[0]) // period_ns) + 1
    t = t_ns[0] + np.round(np.arange(count) * period_ns).astype(np.int64)
    # relative to the first stamp: float64 holds 2**53 ns, not the nanoseconds since 1970
    return t, np.interp((t - t_ns[0]).astype(float), (t_ns - t_ns[0]).astype(float), signal)


def count_lost_readings(t_ns: Ints, is_reading: Bools) -> int:
    """Count the lost readings of a table's column: empty cells in gaps between its readings.

    A table that merges channels of several rates has empty cells where a channel was not measured.

    Args:
        t_ns: (n,) stamps in ns.
        is_reading: (n,) whether each row has a reading; at least one has.
    """
    missing, kept = int((~is_reading).sum()), t_ns[is_reading]
    if not missing or kept.size < 2:
        return missing
    # at least a quarter of the steps lack no reading, whatever was lost
    usual_ns = float(np.quantile(np.diff(kept), 0.25))
    if not usual_ns > 0.0:
        return missing
    inner = np.ceil(np.diff(kept) / usual_ns - LIMITS.reading_gap_periods)
    ends = np.floor(np.array([kept[0] - t_ns[0], t_ns[-1] - kept[-1]]) / usual_ns)
    return min(missing, int(np.maximum(inner, 0.0).sum() + ends.sum()))
