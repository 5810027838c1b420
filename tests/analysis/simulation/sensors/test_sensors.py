"""What the instruments make of a planar motion, fault by fault."""

import numpy as np
import polars as pl
import pytest
from polars.testing import assert_frame_equal

from analysis.model.machine_body import Body as MachineBody
from analysis.model.machine_body import ImuMounting
from analysis.simulation import Scenario, simulate_campaign
from analysis.stages.motion.forces import compute_longitudinal_force, compute_yaw_torque
from analysis.stages.signals.mounting import transfer_acceleration_to_origin
from estimators.errors import ScenarioError
from tests.analysis.simulation.quiet import NO_NOISE as QUIET
from tests.analysis.simulation.quiet import TOGETHER
from tests.twins import mark_heavy_after

WHEELS = MachineBody(name="as simulated", wheel_radius_m=0.42, track_width_m=1.5, force_share=0.5)
PLANAR = (
    {"kind": "start"},
    {"kind": "start", "direction": "reverse"},
    {"kind": "spin", "direction": "right"},
    {"kind": "arc", "speed_m_s": 0.7, "yaw_rate_rad_s": 0.2, "duration_s": 3.0},
)


def log(sensors=QUIET, manoeuvres=PLANAR, **sections):
    campaign = {
        "manoeuvres": manoeuvres,
        "loads_kg": [0],
        "runs": 1,
        **sections.pop("campaign", {}),
    }
    sections = {"sampling": TOGETHER, **sections}
    made = Scenario.model_validate({"sensors": sensors, "campaign": campaign, **sections})
    return next(simulate_campaign(made))


def standing(sensors, runs=1, duration_s=200.0, **sections):
    """A log of a machine that stands: what is in it is the sensors' own."""
    campaign = {"runs": runs, "rest_s": 0}
    rest = ({"kind": "rest", "duration_s": duration_s},)
    return log({**QUIET, **sensors}, rest, campaign=campaign, **sections)


def total_force(made):
    return compute_longitudinal_force(made.topics["torque"], WHEELS)


def test_wheel_torques_and_speeds_tell_force_torque_speed_and_yaw_rate_of_any_planar_motion():
    made = log(machine={"com_x_m": -0.2, "com_y_m": 0.05})
    truth, torque, speed = (
        made.noise_free_motion,
        made.topics["torque"],
        made.topics["speed"],
    )
    np.testing.assert_allclose(
        compute_longitudinal_force(torque, WHEELS), truth["measured_force_x_N"], atol=1e-6
    )
    np.testing.assert_allclose(
        compute_yaw_torque(torque, WHEELS), truth["measured_torque_z_N_m"], atol=1e-6
    )
    left, right = speed["speed_left_m_s"], speed["speed_right_m_s"]
    np.testing.assert_allclose((left + right) / 2, truth["speed_x_m_s"], atol=1e-12)
    np.testing.assert_allclose((right - left) / 1.5, truth["yaw_rate_rad_s"], atol=1e-12)
    assert truth["yaw_rate_rad_s"].abs().max() > 0.5


def test_an_imu_beside_the_origin_is_what_the_machine_files_mounting_undoes():
    made = log({**QUIET, "imu_x_m": 0.8, "imu_y_m": -0.3}, terrain={"slope_deg": 2.0})
    columns = {
        name: made.topics["imu"][name].to_numpy()
        for name in ("specific_force_x_m_s2", "specific_force_y_m_s2", "yaw_rate_rad_s")
    }
    columns["yaw_acc_rad_s2"] = made.noise_free_motion["yaw_acc_rad_s2"].to_numpy()
    moved = transfer_acceleration_to_origin(columns, ImuMounting(position_m=(0.8, -0.3, 0.0)))
    for axis in "xy":
        name = f"specific_force_{axis}_m_s2"
        np.testing.assert_allclose(moved[name], made.noise_free_motion[name], atol=1e-12)
        assert np.abs(columns[name] - moved[name]).max() > 0.05


def test_a_machine_across_the_slope_rolls_and_one_that_looks_down_it_pitches_down():
    turn = {"kind": "arc", "speed_m_s": 0.3, "yaw_rate_rad_s": np.pi / 28, "duration_s": 10.0}
    made = log(manoeuvres=(turn, turn), terrain={"slope_deg": 5.0}, campaign={"rest_s": 0})
    imu, heading = made.topics["imu"], made.noise_free_motion["heading_rad"].to_numpy()
    across = np.argmin(np.abs(heading - np.pi / 2))
    # turned left, uphill is to the right: the right side is up
    assert np.degrees(imu["roll_rad"][int(across)]) == pytest.approx(-5.0, abs=0.05)
    assert np.degrees(imu["pitch_rad"][int(across)]) == pytest.approx(0.0, abs=0.05)
    assert np.degrees(imu["pitch_rad"][0]) == pytest.approx(5.0)
    assert np.degrees(imu["pitch_rad"][-1]) == pytest.approx(-5.0)
    force = imu.select("^specific_force_._m_s2$").to_numpy()
    np.testing.assert_allclose(np.linalg.norm(force[[0, -1]], axis=1), 9.80665, rtol=1e-5)


def test_slipping_wheels_read_more_by_the_share_that_their_force_is_of_the_slip_stiffness():
    made = log(machine={"slip_stiffness_N": 60_000.0}, manoeuvres=({"kind": "start"},))
    truth = made.noise_free_motion
    speed = made.topics["speed"]["speed_left_m_s"].to_numpy()
    expected = truth["speed_x_m_s"] * (1 + truth["force_x_N"] / 60_000.0)
    np.testing.assert_allclose(speed, expected, atol=1e-12)
    driven = (truth["phase"] == "accelerating").to_numpy()
    assert np.all(speed[driven][5:] > 1.04 * truth["speed_x_m_s"].to_numpy()[driven][5:])
    braked = (truth["phase"] == "braking").to_numpy()
    assert np.all(speed[braked][30:] < truth["speed_x_m_s"].to_numpy()[braked][30:])


def test_gain_and_bias_of_the_torque_sensors_are_on_the_total_force():
    plain = log()
    made = log({**QUIET, "force_gain": 1.1, "force_bias_N": 250.0})
    np.testing.assert_allclose(total_force(made), 1.1 * total_force(plain) + 250.0, atol=1e-6)


def test_the_gyroscopes_bias_is_on_its_three_axes_and_nowhere_else():
    change = log({**QUIET, "gyro_bias_rad_s": 0.01}).topics["imu"] - log().topics["imu"]
    for axis in ("roll", "pitch", "yaw"):
        np.testing.assert_allclose(change[f"{axis}_rate_rad_s"], 0.01)
    others = change.select(pl.exclude("^.*_rate_rad_s$"))
    assert not others.to_numpy().any()


@pytest.mark.parametrize(
    ("key", "topic", "pattern", "lsb"),
    mark_heavy_after(
        1,
        [
            ("torque_lsb_N_m", "torque", "^torque_.*$", 5.0),
            ("acc_lsb_m_s2", "imu", "^specific_force_.*$", 0.02),
            ("gyro_lsb_rad_s", "imu", "^.*_rate_rad_s$", 0.003),
            ("speed_lsb_m_s", "speed", "^speed_.*$", 0.01),
            ("angle_lsb_rad", "imu", "^(pitch|roll)_rad$", 0.001),
        ],
    ),
)
def test_quantised_channels_are_whole_steps_within_half_a_step_of_what_they_were(
    key, topic, pattern, lsb
):
    fine, coarse = (log(s).topics[topic].select(pattern) for s in ({}, {key: lsb}))
    steps = coarse.to_numpy() / lsb
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-9)
    assert np.abs(coarse.to_numpy() - fine.to_numpy()).max() <= lsb / 2 * (1 + 1e-9)


def test_coloured_noise_of_the_force_has_its_deviation_and_correlation_time():
    made = standing({"force_drift_N": 100.0, "force_drift_s": 0.5}, duration_s=3000.0)
    force = total_force(made)
    assert force.std() == pytest.approx(100.0, rel=0.06)
    lags = np.array([10, 25, 50, 100])
    correlation = [np.corrcoef(force[:-lag], force[lag:])[0, 1] for lag in lags]
    np.testing.assert_allclose(correlation, np.exp(-lags / 50.0), atol=0.06)


def test_coloured_noise_leaves_the_runs_before_one_more_as_they_were():
    few, many = (
        standing({"force_drift_N": 100.0}, runs=runs, duration_s=10.0).topics["torque"]
        for runs in (2, 3)
    )
    assert_frame_equal(few, many[: few.height], check_exact=True)


@pytest.mark.parametrize(
    ("key", "topic"),
    [("force_delay_s", "torque"), ("speed_delay_s", "speed"), ("imu_delay_s", "imu")],
)
def test_a_delay_shifts_its_own_topic_alone(key, topic):
    prompt, late = log().topics, log({**QUIET, key: 0.05}).topics
    for name in prompt:
        values = [each[name][:, 2:].to_numpy() for each in (prompt, late)]
        shift = 5 if name == topic else 0
        np.testing.assert_allclose(
            values[1][shift:], values[0][: values[0].shape[0] - shift], atol=1e-6
        )


def test_dropouts_lose_their_share_of_each_topic_and_leave_the_rest_as_it_was():
    whole, holed = (standing({}, log={"dropout_share": share}).topics for share in (0.0, 0.1))
    kept = []
    for name, frame in holed.items():
        assert frame.height == pytest.approx(0.9 * whole[name].height, rel=0.01)
        same = whole[name].join(frame.select("header_stamp_ns"), on="header_stamp_ns", how="semi")
        assert_frame_equal(frame, same, check_exact=True)
        kept.append(whole[name]["header_stamp_ns"].is_in(frame["header_stamp_ns"].implode()))
    # not the same messages of each topic
    assert (kept[0] & kept[1]).sum() == pytest.approx(0.81 * len(kept[0]), rel=0.01)


def test_blackouts_leave_holes_of_their_length_in_all_topics_at_once():
    made = standing({}, log={"blackout_every_s": 20.0, "blackout_s": 0.5}, duration_s=1000.0)
    stamps = [frame["header_stamp_ns"] for frame in made.topics.values()]
    for other in stamps[1:]:
        assert (stamps[0] == other).all()
    gaps = np.diff(stamps[0].to_numpy()) / 1e9
    holes = gaps[gaps > 0.015]
    assert holes.min() == pytest.approx(0.51, abs=1e-6)
    assert holes.size == pytest.approx(1000 / 20, rel=0.35)


def test_slip_stiffness_below_full_throttle_is_refused():
    with pytest.raises(ScenarioError, match="slip more than 100 %"):
        log(machine={"slip_stiffness_N": 5000.0})
