"""Causes in the sampling of topics and in the resolution of readings.

Gaps, rows written twice, uneven sampling, clock steps and drift, a coarse resolution.
"""

from typing import NamedTuple

import numpy as np

from analysis.findings.cause import Symptom, list_only_strongest_symptom
from analysis.findings.channel_limits import LIMITS
from analysis.findings.finding_inputs import FindingInputs
from analysis.model.physical_units import NS_PER_S
from analysis.model.uncertainty_sources import STD_OF_MAD
from analysis.stages.signals.filters import compute_median_period_ns
from analysis.stages.signals.signal_limits import LIMITS as SIGNAL_LIMITS
from analysis.stages.signals.timestamps import FIRST_DATE_NS, measure_relative_sampling_jitter
from estimators.arrays import Bools, Floats, Ints
from estimators.errors import format_count


class LatencyStep(NamedTuple):
    """A step of the latency: index, height, and standard deviation about the levels beside it."""

    step_index: int
    height_s: float
    std_s: float


def find_topic_gaps(inputs: FindingInputs) -> list[Symptom]:
    """Find steps of a topic longer than `gap_periods` of its period."""
    found: list[Symptom] = []
    settings = inputs.machine.settings.align
    topics = select_one_series_per_topic(inputs)
    others = {name: [t for n, (t, _) in topics.items() if n != name] for name in topics}
    for name, (t, _) in topics.items():
        period = float(compute_median_period_ns(t))
        steps = np.diff(t)
        holes = np.flatnonzero(steps > settings.gap_periods * period)
        holes = holes[~mark_gaps_of_whole_recorder(t[holes], t[holes + 1], others[name])]
        if not holes.size:
            continue
        missing = float(steps[holes].sum()) / float(t[-1] - t[0])
        longest = int(holes[np.argmax(steps[holes])])
        found.append(
            Symptom(
                1.0 + missing / LIMITS.missing_step_fraction,
                f"{format_count(holes.size, 'gap')}, the longest {steps[longest] / 1e9:.2f} s, "
                f"together {missing:.1%} of the log",
                channel=name,
                span_ns=inputs.convert_unix_to_aligned_ns(t[longest], t[longest + 1]),
            )
        )
    return list_only_strongest_symptom(found)


def mark_gaps_of_whole_recorder(
    gap_start_ns: Ints, gap_end_ns: Ints, other_topics_ns: list[Ints]
) -> Bools:
    """Mark gaps (gaps,) that are pauses of the recorder, in which no topic has a sample."""
    alone = np.zeros(gap_start_ns.size, np.bool_)
    for t in other_topics_ns:
        inside = np.searchsorted(t, gap_end_ns - LIMITS.recorder_pause_edge_ns) - np.searchsorted(
            t, gap_start_ns + LIMITS.recorder_pause_edge_ns
        )
        alone |= inside > 0
    return ~alone & (gap_end_ns - gap_start_ns > LIMITS.recorder_pause_ns) & bool(other_topics_ns)


def find_copied_row_stretches(inputs: FindingInputs) -> list[Symptom]:
    """Find stretches of a topic that repeat an earlier one exactly."""
    found: list[Symptom] = []
    for topic, copies in inputs.copied_rows_by_topic.items():
        t = inputs.raw_frames_by_topic[topic]["log_time_ns"].to_numpy()
        start, end, source = max(copies, key=lambda each: t[each[1]] - t[each[0]])
        total_s = sum(float(t[e] - t[b]) for b, e, _ in copies) / NS_PER_S
        start_s, again_s = (
            (int(t[at]) - inputs.check_inputs.t0_unix_ns) / NS_PER_S for at in (source, start)
        )
        times = "" if len(copies) == 1 else f"; {len(copies)} stretches, {total_s:,.1f} s in all"
        found.append(
            Symptom(
                total_s / SIGNAL_LIMITS.copy_min_s,
                f"{end - start + 1:,} rows from {again_s:,.1f} s on repeat those from "
                f"{start_s:,.1f} s on to the last digit{times}: they are excluded; the motion "
                "during that time was not recorded",
                channel=inputs.find_channel_of_topic(topic),
                span_ns=inputs.convert_unix_to_aligned_ns(int(t[start]), int(t[end])),
            )
        )
    return list_only_strongest_symptom(found)


def find_irregular_sampling(inputs: FindingInputs) -> list[Symptom]:
    """Find topics whose time steps scatter, apart from gaps."""
    found: list[Symptom] = []
    for name, (t, _) in select_one_series_per_topic(inputs).items():
        uneven = measure_relative_sampling_jitter(
            inputs.raw_frames_by_topic[inputs.machine.channels[name].topic or "table"]
        )
        if uneven is not None:
            found.append(
                Symptom(
                    uneven[0] / LIMITS.uneven_steps_wrong_stamps,
                    f"the intervals of its header stamps scatter by {uneven[0]:.0%} of the "
                    f"period, those of log time by {uneven[1]:.0%}: log time is used instead",
                    channel=name,
                )
            )
            continue
        period = float(compute_median_period_ns(t))
        steps = np.diff(t) / period
        steps = steps[steps < inputs.machine.settings.align.gap_periods]
        if steps.size < 100:
            continue
        scatter = float(np.std(steps))
        least, says = choose_sampling_jitter_limit_and_verdict(inputs, name)
        found.append(
            Symptom(
                scatter / least,
                f"the intervals between its samples scatter by {scatter:.0%} of the period of "
                f"{period / 1e6:.1f} ms{says}",
                channel=name,
            )
        )
    return list_only_strongest_symptom(found)


def choose_sampling_jitter_limit_and_verdict(
    inputs: FindingInputs, channel_name: str
) -> tuple[float, str]:
    """Limit of the scatter of a topic's time steps, by whether its readings confirm the stamps.

    Returns:
        The limit relative to the period, and the conclusion on the stamps in words.
    """
    topic = inputs.machine.channels[channel_name].topic
    weight, weighted = 0.0, 0.0
    for channel in inputs.equation_channels_in_log:
        if inputs.machine.channels[channel].topic == topic:
            share, std = estimate_stamp_over_even_timing_weight_and_std(
                *inputs.unfiltered_readings[channel]
            )
            if np.isfinite([share, std]).all() and std > 0.0:
                weight, weighted = weight + std**-2, weighted + share * std**-2
    if not weight:
        return LIMITS.uneven_steps, ""
    share, std = weighted / weight, weight**-0.5
    if share - LIMITS.stamp_fidelity_std * std > 0.5:
        return (
            LIMITS.uneven_steps_right_stamps,
            "; the readings were taken at the times of their stamps",
        )
    if share + LIMITS.stamp_fidelity_std * std < 0.5:
        return (
            LIMITS.uneven_steps_wrong_stamps,
            "; the readings were taken at even intervals: the stamps are wrong",
        )
    return LIMITS.uneven_steps, ""


def estimate_stamp_over_even_timing_weight_and_std(
    stamps_ns: Ints, readings: Floats
) -> tuple[float, float]:
    """Estimate whether readings were taken at their stamps (1) or evenly spaced (0).

    A reading taken at its stamp differs from the mean of its neighbours by the slope times the
    stamp's distance from their middle. The slopes before and after serve as instruments of each
    other, since the noise of one slope alone would bias the estimate towards 0.

    Returns:
        The estimate and its standard deviation.
    """
    n = LIMITS.slope_rows
    if readings.size < 10 * n:
        return np.nan, np.nan
    t_s = (stamps_ns - stamps_ns[0]) * 1e-9
    beside = readings[1:-1] - (readings[2:] + readings[:-2]) / 2.0
    off_s = t_s[1:-1] - (t_s[2:] + t_s[:-2]) / 2.0
    # means, since a vibration is no slope; row k is the mean of n samples from row k on
    x_mean, t_mean = (np.convolve(each, np.full(n, 1.0 / n), "valid") for each in (readings, t_s))
    slopes = (x_mean[n:] - x_mean[:-n]) / (t_mean[n:] - t_mean[:-n])
    # 2 n rows that end before the neighbours, and 2 n that begin after them
    rows = np.arange(2 * n + 2, readings.size - 2 * n - 2)
    beside, off_s = beside[rows - 1], off_s[rows - 1]
    before, after = off_s * slopes[rows - 2 * n - 1], off_s * slopes[rows + 2]
    power = before * after
    share = float((before @ beside) / power.sum())
    left = before * (beside - share * after)
    std = float(np.sqrt(left @ left) / abs(power.sum()))
    # if the two slopes do not agree, there is nothing to decide by
    agree = power.sum() > LIMITS.stamp_fidelity_std * float(np.sqrt(power @ power))
    return (share, std) if agree else (np.nan, np.nan)


def find_header_clock_step(inputs: FindingInputs) -> list[Symptom]:
    """Find a step in the latency between header stamps and log times, beyond drift."""
    found: list[Symptom] = []
    for topic, (log, latency_s) in measure_stamp_latencies_by_topic(inputs).items():
        level, std_s = estimate_typical_latencies_and_std_s(latency_s)
        if level is None:
            continue
        at, jump_s, left_s = find_largest_latency_step(level)
        # a drifting clock has no single step
        if left_s > compute_latency_std_about_line_s(level):
            continue
        strength = abs(jump_s) / max(LIMITS.clock_jump_std * std_s, LIMITS.clock_jump_s)
        place = at * log.size // LIMITS.latency_parts
        when = int(log[min(place, log.size - 1)])
        found.append(
            Symptom(
                strength,
                f"header stamps of {topic} jump by {-1e3 * jump_s:.1f} ± {1e3 * std_s:.1f} ms "
                "against log time",
                channel=inputs.find_channel_of_topic(topic),
                span_ns=inputs.convert_unix_to_aligned_ns(when, when),
            )
        )
    return list_only_strongest_symptom(found)


def find_header_clock_drift(inputs: FindingInputs) -> list[Symptom]:
    """Find two topics whose header clocks drift apart, measured against log times."""
    signals = inputs.check_inputs.signals
    if signals is None or signals.drift is None:
        return []
    drift, span_s = signals.drift, signals.span_s
    apart_s = drift.drift_ppm * 1e-6 * span_s
    strength = min(
        drift.drift_ppm / (LIMITS.clock_drift_std * drift.drift_std_ppm),
        apart_s / LIMITS.clock_drift_s,
    )
    fit = inputs.fit_without_learnt_priors
    # the wrong clock is attributed by the force: either it becomes late or the other one does
    wrong = attribute_clock_drift_to_channel(inputs, drift.faster, drift.slower)
    explains = "" if fit is None else f", {1e3 * apart_s:.1f} ms over the log"
    return [
        Symptom(
            float(np.nan_to_num(strength)),
            f"the clock of {drift.faster} runs {drift.drift_ppm:.0f} ± {drift.drift_std_ppm:.0f} "
            f"ppm faster than that of {drift.slower}{explains}",
            channel=inputs.find_channel_of_topic(wrong),
        )
    ]


def attribute_clock_drift_to_channel(
    inputs: FindingInputs, faster_topic: str, slower_topic: str
) -> str:
    """Topic that the drift of two clocks is attributed to: the force's, or else the faster one."""
    force = inputs.force_channel
    topic = None if force is None else inputs.machine.channels[force].topic
    return slower_topic if slower_topic == topic else faster_topic


def select_one_series_per_topic(inputs: FindingInputs) -> dict[str, tuple[Ints, Floats]]:
    """Stamps and readings of one equation channel of each topic."""
    topics: dict[str | None, str] = {}
    for name in inputs.equation_channels_in_log:
        topics.setdefault(inputs.machine.channels[name].topic, name)
    return {name: inputs.unfiltered_readings[name] for name in topics.values()}


def measure_stamp_latencies_by_topic(inputs: FindingInputs) -> dict[str, tuple[Ints, Floats]]:
    """Log times in ns and latency of the header stamps above its minimum in s, by topic."""
    out: dict[str, tuple[Ints, Floats]] = {}
    for topic, frame in inputs.raw_frames_by_topic.items():
        if "header_stamp_ns" not in frame.columns or frame.height < 10 * LIMITS.latency_parts:
            continue
        stamps, log = frame["header_stamp_ns"], frame["log_time_ns"].to_numpy()
        if stamps.null_count() or int(stamps.min() or 0) < FIRST_DATE_NS:  # type: ignore[arg-type]
            continue
        latency = log - stamps.to_numpy()
        out[topic] = log, (latency - latency.min()) / 1e9
    return out


def estimate_typical_latencies_and_std_s(latency_s: Floats) -> tuple[Floats | None, float]:
    """Median latency of each part, (parts,) in s, and the standard deviation of such a median."""
    parts = np.array_split(latency_s, LIMITS.latency_parts)
    level = np.array([float(np.median(part)) for part in parts])
    changes = np.abs(np.diff(level))
    return level, max(float(np.median(changes)) * STD_OF_MAD, 1e-5)


def find_largest_latency_step(latency_s: Floats) -> LatencyStep:
    """Find the step that splits the latencies best into two levels."""
    count = np.arange(1, latency_s.size)
    before = np.cumsum(latency_s)[:-1] / count
    after = (latency_s.sum() - np.cumsum(latency_s)[:-1]) / (latency_s.size - count)
    gain = count * (latency_s.size - count) * (after - before) ** 2
    at = int(np.argmax(gain)) + 1
    left = np.concatenate(
        [latency_s[:at] - latency_s[:at].mean(), latency_s[at:] - latency_s[at:].mean()]
    )
    return LatencyStep(at, float(after[at - 1] - before[at - 1]), float(np.std(left)))


def compute_latency_std_about_line_s(latency_s: Floats) -> float:
    """Standard deviation of the latencies about a fitted line, in s."""
    x = np.arange(latency_s.size, dtype=np.float64)
    return float(np.std(latency_s - np.polyval(np.polyfit(x, latency_s, 1), x)))


def find_coarse_channel_resolution(inputs: FindingInputs) -> list[Symptom]:
    """Find a channel whose resolution is coarser than its noise."""
    found: list[Symptom] = []
    for name in inputs.equation_channels_in_log:
        repeats, lsb = measure_repeat_fraction_and_resolution(inputs, name)
        if not lsb:
            continue
        found.append(
            Symptom(
                repeats / LIMITS.repeated_fraction,
                f"{repeats:.0%} of its readings in motion repeat the one before; its resolution is "
                f"{lsb:.3g}",
                channel=name,
            )
        )
    return list_only_strongest_symptom(found)


def measure_repeat_fraction_and_resolution(
    inputs: FindingInputs, channel: str
) -> tuple[float, float]:
    """Fraction of repeated readings in motion, and the channel's resolution in SI units.

    The resolution is 0 if the steps have no common divisor.
    """
    key = f"steps {channel}"
    if key not in inputs.cache:
        t, x = inputs.unfiltered_readings[channel]
        steps = np.diff(x)[inputs.mark_moving_stamps(t)[1:] & (x[1:] != 0.0)]
        sizes = np.abs(steps[steps != 0.0])
        inputs.cache[key] = 0.0, 0.0
        if steps.size >= LIMITS.resolution_min_steps and sizes.size:
            lsb = float(np.min(sizes))
            whole = float(np.mean(np.abs(sizes / lsb - np.rint(sizes / lsb)) < 0.05))
            repeats = float((steps == 0.0).mean())
            inputs.cache[key] = repeats, lsb if whole > LIMITS.whole_step_fraction else 0.0
    return inputs.cache[key]  # type: ignore[return-value]
