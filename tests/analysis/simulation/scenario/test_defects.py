"""Defects of instruments and mounting, each against what it should make of the truth."""

import numpy as np
import polars as pl
import pytest

from tests.analysis.simulation.quiet import G, log, mean_speed, total_force


def seconds(made):
    stamps = made.noise_free_motion["time_ns"]
    return (stamps - stamps[0]).to_numpy() * 1e-9


def test_a_low_passed_force_is_two_first_order_lags_behind_the_throttle():
    made = log(defects={"force_lag_s": 0.2})
    since_s = seconds(made) - 1.0
    opening = (since_s > 0.0) & (since_s < 2.99)
    valve = 0.08 * np.exp(-since_s / 0.08)
    closed = 6000.0 * (1.0 - (valve - 0.2 * np.exp(-since_s / 0.2)) / (0.08 - 0.2))
    np.testing.assert_allclose(total_force(made)[opening], closed[opening], atol=0.5)


def test_a_low_passed_speed_is_late_by_its_lag_while_the_speed_is_a_ramp():
    made = log(defects={"speed_lag_s": 0.05}, machine={"friction_N_s_m": 0.0})
    late = made.noise_free_motion["speed_x_m_s"].to_numpy() - mean_speed(made)
    ramp = (seconds(made) > 2.5) & (seconds(made) < 3.99)
    np.testing.assert_allclose(late[ramp], 0.05 * 6000.0 / 3614.0, rtol=1e-3)


def test_the_low_pass_of_the_imu_is_on_its_channels_alone():
    made, plain = log(defects={"imu_lag_s": 0.1}), log()
    for name in ("torque", "speed"):
        assert made.topics[name].equals(plain.topics[name])
    change = made.topics["imu"] - plain.topics["imu"]
    assert change["specific_force_x_m_s2"].abs().max() > 0.5
    # without a change there is nothing to smooth
    np.testing.assert_allclose(change["specific_force_z_m_s2"], 0.0, atol=1e-12)


def test_a_tilted_accelerometer_reads_gravity_and_the_pitch_does_not_say_so():
    made = log(defects={"acc_tilt_deg": 3.0})
    imu, acc = made.topics["imu"], made.noise_free_motion["acc_x_m_s2"].to_numpy()
    sine, cosine = np.sin(np.radians(3.0)), np.cos(np.radians(3.0))
    np.testing.assert_allclose(imu["specific_force_x_m_s2"], acc * cosine + G * sine)
    np.testing.assert_allclose(imu["specific_force_z_m_s2"], G * cosine - acc * sine)
    np.testing.assert_array_equal(imu["pitch_rad"], 0.0)


def test_an_accelerometer_without_gravity_reads_the_rate_of_the_speed_on_any_slope():
    made = log(defects={"acc_without_gravity": True}, terrain={"slope_deg": 2.0})
    imu = made.topics["imu"]
    np.testing.assert_allclose(imu["specific_force_x_m_s2"], made.noise_free_motion["acc_x_m_s2"])
    np.testing.assert_array_equal(imu["specific_force_z_m_s2"], 0.0)
    np.testing.assert_allclose(imu["pitch_rad"], np.radians(2.0))


def test_vibration_has_its_rms_and_its_frequency_and_only_where_the_wheels_turn():
    made = log(
        defects={"vibration_m_s2": 0.3, "vibration_hz": 18.0, "vibration_bandwidth_hz": 2.0},
        campaign={"start_s": 100.0},
    )
    truth = made.noise_free_motion
    added = (made.topics["imu"]["specific_force_x_m_s2"] - truth["acc_x_m_s2"]).to_numpy()
    moving = (truth["speed_x_m_s"] != 0.0).to_numpy()
    np.testing.assert_array_equal(added[~moving], 0.0)
    driven = added[moving]
    assert driven.std() == pytest.approx(0.3, rel=0.15)
    power = np.abs(np.fft.rfft(driven)) ** 2
    frequency_hz = np.fft.rfftfreq(driven.size, 0.01)
    # a half-power band holds half the power of a first-order process
    inside = np.abs(frequency_hz - 18.0) <= 1.0
    assert power[inside].sum() / power.sum() == pytest.approx(0.5, abs=0.15)


def test_load_transfer_takes_from_the_measured_share_its_part_for_each_m_s2():
    made = log(defects={"force_share_s2_m": 0.02})
    truth = made.noise_free_motion
    kept = 1.0 - 0.02 * truth["acc_x_m_s2"].to_numpy()
    expected = truth["measured_force_x_N"].to_numpy() * kept
    np.testing.assert_allclose(total_force(made), expected, atol=1e-6)
    assert kept.min() < 0.98


def test_a_share_that_grows_with_the_load_reads_more_of_the_force_by_its_part_a_kg():
    made = log(defects={"force_share_1_kg": 2e-4}, campaign={"loads_kg": [250]})
    expected = 1.05 * made.noise_free_motion["measured_force_x_N"].to_numpy()
    np.testing.assert_allclose(total_force(made), expected, atol=1e-6)


def test_a_gain_that_drifts_grows_linearly_over_the_log():
    made = log(defects={"force_gain_drift": 0.05}, campaign={"runs": 3})
    true_N = made.noise_free_motion["measured_force_x_N"].to_numpy()
    part = seconds(made) / (seconds(made)[-1] + 0.01)
    expected = true_N * (1.0 + 0.05 * part)
    np.testing.assert_allclose(total_force(made), expected, atol=0.1)


def test_a_clipped_force_reads_no_more_than_its_limit():
    made = log(defects={"force_clip_N": 4000.0})
    true_N = made.noise_free_motion["measured_force_x_N"].to_numpy()
    np.testing.assert_allclose(total_force(made), np.clip(true_N, -4000.0, 4000.0), atol=1e-6)
    assert true_N.max() > 5900.0


def test_a_sensor_with_play_reads_less_while_the_force_rises_and_more_while_it_falls():
    made = log(defects={"force_play_N": 200.0})
    true_N = made.noise_free_motion["measured_force_x_N"].to_numpy()
    away_N = total_force(made) - true_N
    changes = np.diff(true_N, prepend=0.0)
    np.testing.assert_allclose(away_N[np.cumsum(changes > 0.0) == changes.size], -200.0)
    assert away_N[np.argmax(true_N)] == pytest.approx(-200.0)
    assert away_N.min() == pytest.approx(-200.0)
    assert away_N.max() == pytest.approx(200.0)


def test_larger_wheels_turn_slower_and_take_more_torque_than_their_nominal_radius_says():
    made = log(machine={"wheel_radius_excess": 0.05})
    truth = made.noise_free_motion
    np.testing.assert_allclose(mean_speed(made), truth["speed_x_m_s"] / 1.05, atol=1e-12)
    expected = 1.05 * truth["measured_force_x_N"].to_numpy()
    np.testing.assert_allclose(total_force(made), expected, atol=1e-6)


@pytest.mark.parametrize("topic", ["imu", "torque", "speed"])
def test_a_frozen_topic_repeats_its_last_values_again_and_again_while_its_stamps_go_on(topic):
    noisy = {"force_noise_N": 60.0, "acc_noise_m_s2": 0.01, "speed_noise_m_s": 0.005}
    frozen = {"frozen_topic": topic, "frozen_s": 0.5, "frozen_every_s": 2.0}
    made, plain = log(sensors=noisy, defects=frozen), log(sensors=noisy)
    stamps = made.topics[topic]["header_stamp_ns"]
    assert stamps.equals(plain.topics[topic]["header_stamp_ns"])
    since_s = (stamps - stamps[0]).to_numpy() * 1e-9
    stuck = (since_s >= 2.0) & (since_s % 2.0 < 0.5 - 1e-9)
    mine, theirs = (each.topics[topic][:, 2].to_numpy() for each in (made, plain))
    np.testing.assert_array_equal(mine[~stuck], theirs[~stuck])
    before = np.flatnonzero(stuck & ~np.roll(stuck, 1)) - 1
    assert len(before) >= 2
    for index in before:
        np.testing.assert_array_equal(mine[index : index + 51], theirs[index])
    for other in {"imu", "torque", "speed"} - {topic}:
        assert made.topics[other].equals(plain.topics[other])


def test_one_sides_sign_and_swapped_sides_are_on_their_columns_alone():
    spin = {"manoeuvres": [{"kind": "spin"}]}
    plain, signed, swapped = (
        log(campaign=spin, defects=defects)
        for defects in ({}, {"left_torque_gain": -1.0}, {"sides_swapped": True})
    )
    torque = plain.topics["torque"]
    flipped = torque.with_columns(-pl.col("torque_left_N_m"))
    assert signed.topics["torque"].equals(flipped)
    for name, column in (("torque", "torque_{}_N_m"), ("speed", "speed_{}_m_s")):
        left, right = column.format("left"), column.format("right")
        assert swapped.topics[name][left].equals(plain.topics[name][right].alias(left))
        assert swapped.topics[name][right].equals(plain.topics[name][left].alias(right))
    assert torque["torque_left_N_m"].min() < -100.0
