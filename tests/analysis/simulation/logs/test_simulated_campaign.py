"""Campaigns: what the sensors report, the truth, and reproducible noise."""

import numpy as np
import polars as pl
import pytest
from polars.testing import assert_frame_equal

from analysis.model.schema import CHANNEL_COLUMNS
from analysis.simulation import Scenario, simulate_campaign
from tests.analysis.simulation.quiet import NO_NOISE as QUIET
from tests.analysis.simulation.quiet import TOGETHER, mean_speed, total_force


def logs(**sections):
    sections = {"sampling": TOGETHER, **sections}
    return list(simulate_campaign(Scenario.model_validate(sections)))


def first_log(runs=2, **sections):
    campaign = {"loads_kg": [0.0], "runs": runs, **sections.pop("campaign", {})}
    return logs(campaign=campaign, **sections)[0]


def test_without_noise_the_driven_samples_give_mass_and_friction_by_17_and_7():
    log = first_log(sensors=QUIET)
    driven = log.noise_free_motion["phase"].is_in(["accelerating", "cruising"]).to_numpy()
    acc = log.topics["imu"]["specific_force_x_m_s2"].to_numpy()
    regressor = np.column_stack([acc, mean_speed(log)])[driven]
    solution = np.linalg.lstsq(regressor, total_force(log)[driven])[0]
    np.testing.assert_allclose(solution, [3614.0, 2891.0], rtol=1e-6)


def test_on_a_slope_the_specific_force_carries_gravity_so_that_the_mass_still_comes_out():
    log = first_log(sensors=QUIET, terrain={"slope_deg": 3.0})
    driven = log.noise_free_motion["phase"].is_in(["accelerating", "cruising"]).to_numpy()
    imu = log.topics["imu"]
    regressor = np.column_stack([imu["specific_force_x_m_s2"], mean_speed(log)])[driven]
    solution = np.linalg.lstsq(regressor, total_force(log)[driven])[0]
    np.testing.assert_allclose(solution, [3614.0, 2891.0], rtol=1e-6)
    standing = (log.noise_free_motion["phase"] == "standstill").to_numpy()
    pitch = np.radians(3.0)
    np.testing.assert_allclose(
        imu["specific_force_x_m_s2"].to_numpy()[standing], 9.80665 * np.sin(pitch)
    )
    np.testing.assert_allclose(imu["specific_force_z_m_s2"], 9.80665 * np.cos(pitch))
    np.testing.assert_allclose(imu["pitch_rad"], pitch)


def test_the_noise_of_total_force_acceleration_and_speed_is_the_scenarios():
    log = first_log(runs=9)
    truth = log.noise_free_motion
    acc = log.topics["imu"]["specific_force_x_m_s2"].to_numpy()
    for residual, std in (
        (total_force(log) - truth["measured_force_x_N"].to_numpy(), 60.0),
        (acc - truth["acc_x_m_s2"].to_numpy(), 0.01),
        (mean_speed(log) - truth["speed_x_m_s"].to_numpy(), 0.005),
    ):
        assert residual.std() == pytest.approx(std, rel=0.03)
        assert abs(residual.mean()) < 4 * std / np.sqrt(residual.size)


def test_bias_is_on_the_accelerometer_along_x_alone():
    plain, biased = first_log(), first_log(sensors={"acc_bias_m_s2": 0.2})
    shift = biased.topics["imu"] - plain.topics["imu"]
    np.testing.assert_allclose(shift["specific_force_x_m_s2"], 0.2)
    assert not shift.drop("specific_force_x_m_s2").sum().to_numpy().any()


def test_a_delay_of_whole_samples_shifts_the_force_and_nothing_else():
    prompt = first_log(sensors=QUIET)
    late = first_log(sensors={**QUIET, "force_delay_s": 0.08})
    np.testing.assert_allclose(total_force(late)[8:], total_force(prompt)[:-8], atol=1e-6)
    assert not total_force(late)[:8].any()
    assert_frame_equal(late.topics["imu"], prompt.topics["imu"])


def test_a_delay_between_samples_shows_what_was_between_them():
    late = first_log(sensors={**QUIET, "force_delay_s": 0.004})
    fine = first_log(sensors={**QUIET, "rate_hz": 1000.0}, log={"latency_jitter_s": 0.0})
    np.testing.assert_allclose(
        total_force(late)[1:], total_force(fine)[6::10][: len(total_force(late)) - 1], atol=1e-6
    )


@pytest.mark.heavy
def test_the_same_seed_gives_the_same_log_bit_for_bit_and_another_seed_another():
    for mine, again in zip(logs(), logs(), strict=True):
        for name in mine.topics:
            assert mine.topics[name].equals(again.topics[name])
    other = first_log(sensors={"seed": 2}).topics["imu"]
    assert not other.equals(first_log().topics["imu"])


def test_more_runs_leave_those_before_as_they_were():
    few, many = first_log(runs=2), first_log(runs=5)
    end = few.trials["end_ns"][-1]
    for name, frame in few.topics.items():
        assert_frame_equal(
            frame.filter(pl.col("header_stamp_ns") < end),
            many.topics[name].filter(pl.col("header_stamp_ns") < end),
            check_exact=True,
        )
    assert_frame_equal(few.trials, many.trials[:2])


def test_one_more_load_leaves_the_logs_before_as_they_were():
    one = logs(campaign={"loads_kg": [0], "runs": 2})
    two = logs(campaign={"loads_kg": [0, 80], "runs": 2})
    assert_frame_equal(one[0].topics["torque"], two[0].topics["torque"], check_exact=True)


def test_noise_differs_between_runs_loads_and_channels():
    pair = logs(campaign={"loads_kg": [0, 50], "runs": 2, "standstill_s": 5})
    standing = [
        log.topics["torque"][column].to_numpy()[:400]
        for log in pair
        for column in ("torque_left_N_m", "torque_right_N_m")
    ]
    second = pair[0].trials["start_ns"][1]
    torque = pair[0].topics["torque"].filter(pl.col("header_stamp_ns") >= second)
    standing.append(torque["torque_left_N_m"].to_numpy()[:400])
    correlation = np.corrcoef(standing) - np.eye(len(standing))
    assert np.abs(correlation).max() < 0.25


def test_the_logs_of_a_campaign_make_one_time_line_of_strictly_increasing_stamps():
    made = logs(campaign={"runs": 2}, log={"load_change_s": 0.1})
    for name in made[0].topics:
        stamps = pl.concat([log.topics[name] for log in made])
        assert (stamps["header_stamp_ns"].diff().drop_nulls() > 0).all()
        assert (stamps["log_time_ns"].diff().drop_nulls() > 0).all()
        latency = (stamps["log_time_ns"] - stamps["header_stamp_ns"]) / 1e9
        assert latency.min() >= 0.002
        assert latency.max() <= 0.003


def test_the_truth_of_a_run_is_where_it_happens_in_the_log():
    log = logs(campaign={"loads_kg": [100], "runs": 3}, machine={"coulomb_N": 50})[0]
    assert log.trials["mass_kg"].to_list() == [3714.0] * 3
    assert log.trials["coulomb_N"].to_list() == [50.0] * 3
    for run in log.trials.iter_rows(named=True):
        inside = log.noise_free_motion.filter(
            pl.col("time_ns").is_between(run["throttle_ns"], run["end_ns"])
        )
        first_motion = inside.filter(pl.col("speed_x_m_s") > 0)["time_ns"][0]
        assert 0 <= first_motion - run["throttle_ns"] < 2e7
        braking = inside.filter(pl.col("phase") == "braking")["time_ns"]
        assert 0 <= braking[0] - run["braking_ns"] < 1e7
        assert 0 <= run["end_ns"] - braking[-1] <= 1e7


def test_channels_have_the_names_that_a_machine_file_knows():
    known = {column.name for column in CHANNEL_COLUMNS} | {"header_stamp_ns", "log_time_ns"}
    for frame in first_log().topics.values():
        assert set(frame.columns) <= known
        assert not any(frame.null_count().row(0))


def test_phases_shorter_than_a_sample_and_runs_without_a_standstill_are_simulated():
    log = first_log(runs=3, campaign={"standstill_s": 0, "cruise_s": 0.001, "rest_s": 0})
    assert log.noise_free_motion["speed_x_m_s"].max() > 1.8
    assert log.noise_free_motion["speed_x_m_s"].min() > -1e-9
