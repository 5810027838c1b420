"""Recorder of simulated topics: sample times, stamps and losses."""

import math
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.simulation.motion.timeline import Timeline
from analysis.simulation.scenario.instruments import TopicName
from analysis.simulation.scenario.scenario import Scenario
from analysis.simulation.sensors.random_streams import RandomStreams, make_random_generator
from estimators.arrays import Floats

TOPICS: Final[tuple[TopicName, ...]] = ("imu", "torque", "speed")


def list_recorded_topics(scenario: Scenario) -> tuple[TopicName, ...]:
    """Names of the recorded topics."""
    return TOPICS if scenario.shift is None else (*TOPICS, *scenario.shift.topics)


def get_topic_rate_hz(scenario: Scenario, topic: TopicName) -> float:
    """Rate of a topic in Hz."""
    if topic == "gnss" and scenario.shift is not None:
        return scenario.shift.gnss_rate_hz
    return scenario.sampling.rate_hz(topic, scenario.sensors.rate_hz)


def compute_topic_phase_s(scenario: Scenario, topic: TopicName, load_index: int) -> float:
    """Time of a topic's first sample after the start of a log, in s."""
    asked_s = scenario.sampling.phase_s(topic)
    if asked_s >= 0.0:
        return asked_s
    drawn = make_random_generator(scenario.sensors.seed, load_index, 0, f"{topic}_phase").random()
    return float(drawn) / get_topic_rate_hz(scenario, topic)


def make_sample_times_ns(timeline: Timeline, rate_hz: float, phase_s: float) -> NDArray[np.int64]:
    """Unix times (n,) of a topic's samples, from `phase_s` to the end of the log."""
    first_ns = timeline.start_ns + round(phase_s * 1e9)
    period_ns = 1e9 / rate_hz
    samples = max(math.ceil((timeline.end_ns - first_ns) / period_ns), 0)
    return first_ns + np.rint(np.arange(samples) * period_ns).astype(np.int64)


def record_topic(
    scenario: Scenario,
    topic: TopicName,
    at_ns: NDArray[np.int64],
    random_streams: RandomStreams,
    timeline: Timeline,
    readings: dict[str, Floats],
) -> pl.DataFrame:
    """Record the readings of a topic, with stamps, losses and swapped messages.

    Args:
        scenario: scenario with clocks and losses.
        topic: name of the topic.
        at_ns: (n,) Unix times of the measurements.
        random_streams: random numbers for these samples.
        timeline: time line of the log.
        readings: columns of readings, (n,) each.
    """
    log = scenario.log
    latency_s = (
        log.latency_s
        + log.latency_jitter_s * random_streams.draw_uniform_0_to_1_per_sample(f"{topic}_latency")
    )
    log_time_ns = at_ns + np.rint(latency_s * 1e9).astype(np.int64)
    keeps = ~mark_dropped_samples(scenario, at_ns, random_streams, timeline)
    if log.dropout_share:
        keeps &= (
            random_streams.draw_uniform_0_to_1_per_sample(f"{topic}_dropout") >= log.dropout_share
        )
    frame = pl.DataFrame(
        {
            "header_stamp_ns": stamp_samples_ns(
                scenario, topic, at_ns, random_streams, timeline.start_ns
            ),
            "log_time_ns": log_time_ns,
            **readings,
        }
    ).filter(keeps)
    if not log.swapped_share:
        return frame
    late = swap_messages_with_next(
        log_time_ns,
        random_streams.draw_uniform_0_to_1_per_sample(f"{topic}_swap") < log.swapped_share,
    )
    return frame.with_columns(log_time_ns=late[keeps]).sort("log_time_ns")


def stamp_samples_ns(
    scenario: Scenario,
    topic: TopicName,
    at_ns: NDArray[np.int64],
    random_streams: RandomStreams,
    start_ns: int,
) -> NDArray[np.int64]:
    """Stamp of each measurement by the topic's clock, (n,) in Unix ns."""
    sampling = scenario.sampling
    ahead_ns = (at_ns - start_ns) * (sampling.clock_rate_error_ppm(topic) * 1e-6)
    if sampling.stamp_jitter_s:
        part = 2.0 * random_streams.draw_uniform_0_to_1_per_sample(f"{topic}_stamp") - 1.0
        ahead_ns = ahead_ns + part * (sampling.stamp_jitter_s * 1e9)
    return at_ns + np.rint(ahead_ns).astype(np.int64)


def swap_messages_with_next(
    time_ns: NDArray[np.int64], is_swapped: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Times (n,) with the selected messages swapped with their successors."""
    swapped = time_ns.copy()
    for index in np.flatnonzero(is_swapped[:-1]):
        # a message that was moved back already is not moved again
        if swapped[index] == time_ns[index]:
            swapped[[index, index + 1]] = time_ns[[index + 1, index]]
    return swapped


def mark_dropped_samples(
    scenario: Scenario, at_ns: NDArray[np.int64], random_streams: RandomStreams, timeline: Timeline
) -> NDArray[np.bool_]:
    """Mark lost samples (n,): dropouts begin at any sample with equal probability."""
    log, rate = scenario.log, scenario.sensors.rate_hz
    if not log.blackout_every_s:
        return np.zeros(at_ns.shape, np.bool_)
    # the same stretches in all topics, independent of their rates
    grid_ns = make_sample_times_ns(timeline, rate, 0.0)
    common = RandomStreams(
        random_streams.seed, random_streams.load_index, timeline.assign_trial_numbers(grid_ns)
    )
    starts = common.draw_uniform_0_to_1_per_sample("blackout") < -math.expm1(
        -1.0 / rate / log.blackout_every_s
    )
    starts_ns = np.concatenate([[np.int64(-(2**62))], grid_ns[starts]])
    last_ns = starts_ns[np.searchsorted(starts_ns, at_ns, side="right") - 1]
    return at_ns - last_ns < round(log.blackout_s * 1e9)
