"""Instants, rates and clocks of the topics, and the order in which they are recorded."""

import numpy as np
import polars as pl
import pytest
from polars.testing import assert_frame_equal

from analysis.simulation import solve_motion
from analysis.simulation.sensors.recorder import compute_topic_phase_s
from tests.analysis.simulation.quiet import log, mean_speed, scenario

FREE = {"imu_phase_s": -1.0, "torque_phase_s": -1.0, "speed_phase_s": -1.0}
TOPICS = ("imu", "torque", "speed")
BEGIN_NS = 1_700_000_000 * 10**9


def test_phases_are_drawn_from_the_seed_uniformly_in_a_period_of_each_topic():
    drawn = np.array(
        [
            [
                compute_topic_phase_s(
                    scenario(sampling={**FREE, "speed_rate_hz": 20.0}, sensors={"seed": s}), t, 0
                )
                for t in TOPICS
            ]
            for s in range(300)
        ]
    )
    for phases, period_s in zip(drawn.T, (0.01, 0.01, 0.05), strict=True):
        assert phases.min() >= 0.0
        assert phases.max() < period_s
        counts, _ = np.histogram(phases, bins=5, range=(0.0, period_s))
        # χ² of 4 degrees of freedom: 18.5 in one of a thousand
        assert ((counts - 60.0) ** 2 / 60.0).sum() < 18.5
    assert np.abs(np.corrcoef(drawn.T) - np.eye(3)).max() < 0.2


def test_by_default_the_topics_of_a_log_are_sampled_at_different_instants_that_the_truth_names():
    made = log(sampling=FREE)
    first = {name: topic["header_stamp_ns"][0] - BEGIN_NS for name, topic in made.topics.items()}
    assert len(set(first.values())) == 3
    assert first == {name: round(phase * 1e9) for name, phase in made.phase_s.items()}


def test_a_topic_reports_the_motion_of_its_own_instants():
    made = log(sampling={"speed_phase_s": 0.0037, "speed_rate_hz": 40.0})
    stamps = made.topics["speed"]["header_stamp_ns"].to_numpy()
    motion = solve_motion(made.scenario, 0.0)
    truth = motion.sample_channels((stamps - BEGIN_NS) * 1e-9).speed_x_m_s
    np.testing.assert_allclose(mean_speed(made), truth, atol=1e-12)
    np.testing.assert_allclose(np.diff(stamps), 25_000_000, atol=1)


def test_rate_and_phase_of_one_topic_leave_the_others_as_they_were():
    plain = log(sensors={"force_noise_N": 60.0, "acc_noise_m_s2": 0.01})
    other = log(
        sensors={"force_noise_N": 60.0, "acc_noise_m_s2": 0.01},
        sampling={"torque_rate_hz": 10.0, "torque_phase_s": 0.03},
    )
    for name in ("imu", "speed"):
        assert_frame_equal(plain.topics[name], other.topics[name], check_exact=True)
    stamps = other.topics["torque"]["header_stamp_ns"]
    assert stamps[0] == BEGIN_NS + 30_000_000
    assert set(stamps.diff().drop_nulls()) == {100_000_000}


@pytest.mark.parametrize("ppm", [200.0, -1000.0, 10_000.0])
def test_a_clock_that_drifts_stamps_ahead_by_its_ppm_from_the_beginning_of_the_log_on(ppm):
    recorder = {"latency_s": 0.0, "latency_jitter_s": 0.0}
    made = log(sampling={"torque_clock_ppm": ppm}, log=recorder)
    torque = made.topics["torque"]
    since = torque["log_time_ns"].to_numpy() - BEGIN_NS
    ahead = (torque["header_stamp_ns"] - torque["log_time_ns"]).to_numpy()
    np.testing.assert_allclose(ahead, since * ppm * 1e-6, atol=1.0)
    plain = log(log=recorder)
    assert_frame_equal(made.topics["imu"], plain.topics["imu"])
    readings = pl.exclude("header_stamp_ns")
    assert_frame_equal(torque.select(readings), plain.topics["torque"].select(readings))


def test_jitter_of_the_stamps_is_uniform_and_leaves_readings_and_recording_alone():
    rest = [{"kind": "rest", "duration_s": 60.0}]
    jittered, plain = (
        log(sampling={"stamp_jitter_s": jitter_s}, campaign={"manoeuvres": rest})
        for jitter_s in (0.004, 0.0)
    )
    for name, topic in jittered.topics.items():
        off = (topic["header_stamp_ns"] - plain.topics[name]["header_stamp_ns"]).to_numpy() / 1e9
        assert np.abs(off).max() <= 0.004
        assert off.std() == pytest.approx(0.004 / np.sqrt(3.0), rel=0.03)
        others = pl.exclude("header_stamp_ns")
        assert_frame_equal(topic.select(others), plain.topics[name].select(others))


def test_swapped_messages_are_recorded_after_their_successors_and_none_is_lost():
    rest = [{"kind": "rest", "duration_s": 100.0}]
    made, plain = (
        log(log={"swapped_share": share}, campaign={"manoeuvres": rest}) for share in (0.1, 0.0)
    )
    for name, topic in made.topics.items():
        assert (topic["log_time_ns"].diff().drop_nulls() > 0).all()
        back = (topic["header_stamp_ns"].diff().drop_nulls() < 0).mean()
        # a message that changed places with the one before cannot with the next
        assert back == pytest.approx(0.1 / 1.1, abs=0.01)
        assert_frame_equal(
            topic.sort("header_stamp_ns").drop("log_time_ns"),
            plain.topics[name].drop("log_time_ns"),
        )


def test_blackouts_are_the_same_in_topics_of_other_rates():
    made = log(
        log={"blackout_every_s": 20.0, "blackout_s": 0.5},
        sampling={"torque_rate_hz": 50.0, "speed_rate_hz": 200.0},
        campaign={"manoeuvres": [{"kind": "rest", "duration_s": 300.0}]},
    )
    holes = []
    for topic in made.topics.values():
        stamps = topic["header_stamp_ns"].to_numpy()
        at = np.flatnonzero(np.diff(stamps) > 300_000_000)
        holes.append(stamps[at])
    assert len(holes[0]) > 5
    for other in holes[1:]:
        np.testing.assert_allclose(other, holes[0], atol=20_000_000)
