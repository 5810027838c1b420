"""Springs that deflect under the load: the pitch and the accelerometer see it load by load."""

import numpy as np
import polars as pl
import pytest

from analysis.simulation import Scenario
from analysis.simulation.logs.shift_logs import ShiftSimulation
from tests.analysis.simulation.quiet import MASS_KG, G, drive, log

SAG_DEG_KG, SQUAT_DEG_KG = 0.002, 0.001
SPRINGS = {"pitch_deg_kg": SAG_DEG_KG, "squat_deg_s2_m_kg": SQUAT_DEG_KG}


def assert_pitch_and_gravity(made, pitch_rad):
    """The pitch channel has it, and the accelerometer reads gravity through it."""
    imu, truth = made.topics["imu"], made.noise_free_motion
    np.testing.assert_allclose(imu["pitch_rad"], pitch_rad, atol=1e-9)
    acc = truth["acc_x_m_s2"].to_numpy()
    expected = acc * np.cos(pitch_rad) + G * np.sin(pitch_rad)
    np.testing.assert_allclose(imu["specific_force_x_m_s2"], expected, atol=1e-9)


@pytest.mark.parametrize("load_kg", [0.0, 250.0, 1000.0])
def test_a_body_sags_and_squats_in_proportion_to_its_load(load_kg):
    chassis = {**SPRINGS, "squat_deg_s2_m": 0.3}
    made = log(chassis=chassis, campaign={"loads_kg": [load_kg]})
    acc = made.noise_free_motion["acc_x_m_s2"].to_numpy()
    degrees = SAG_DEG_KG * load_kg + (0.3 + SQUAT_DEG_KG * load_kg) * acc
    assert_pitch_and_gravity(made, np.radians(degrees))


def test_a_stand_sags_under_the_load_that_is_then_in_the_bucket():
    loading = {"change_kg": 300.0, "change_before_start": 2}
    made = log(chassis={"pitch_deg_kg": SAG_DEG_KG}, loading=loading, campaign={"runs": 4})
    changed_ns = made.trials["start_ns"][2]
    carried = np.where(made.noise_free_motion["time_ns"] >= changed_ns, 300.0, 0.0)
    assert_pitch_and_gravity(made, np.radians(SAG_DEG_KG * carried))
    np.testing.assert_array_equal(made.noise_free_motion["mass_kg"], MASS_KG + carried)


def test_the_pitch_rate_is_that_of_the_pitch_while_a_bucket_fills():
    made = log(
        chassis=SPRINGS,
        loading={"fill_kg_s": 100.0},
        sensors={"rate_hz": 500.0},
        log={"latency_jitter_s": 0.0},
    )
    imu, phase = made.topics["imu"], made.noise_free_motion["phase"]
    driven = (phase == "accelerating").to_numpy()
    rate = np.gradient(imu["pitch_rad"], 0.002)
    inside = np.flatnonzero(driven)[100:-2]
    assert rate[inside].min() > np.radians(0.1)
    np.testing.assert_allclose(-imu["pitch_rate_rad_s"].to_numpy()[inside], rate[inside], rtol=0.01)


def test_a_body_that_swings_begins_at_its_sag_and_settles_at_its_squat():
    chassis = {**SPRINGS, "squat_hz": 2.0, "squat_damping": 0.4}
    made = drive(500.0, chassis=chassis, machine={"friction_N_s_m": 0.0})
    standing, driving = (
        made.sample_channels(np.arange(0.0, 1.0, 0.1)),
        made.sample_channels(np.array([3.9])),
    )
    np.testing.assert_allclose(standing.squat_rad, np.radians(1.0))
    degrees = 1.0 + 0.5 * driving.acc_x_m_s2
    np.testing.assert_allclose(driving.squat_rad, np.radians(degrees), rtol=1e-4)


def shift(**sections):
    made = Scenario.model_validate({"shift": {"duration_h": 0.05}, **sections})
    assert made.shift is not None
    (whole,) = ShiftSimulation(made, made.shift).simulate_logs()
    return whole


def test_in_a_shift_the_pitch_tells_a_loaded_machine_from_an_empty_one():
    quiet = {"pitch_noise_rad": 0.0}
    made = shift(chassis={"pitch_deg_kg": SAG_DEG_KG}, sensors=quiet)
    truth = made.timeline.sample(made.topics["imu"]["header_stamp_ns"].to_numpy())
    load_kg = truth.mass_kg - MASS_KG
    assert load_kg.max() > 400.0
    np.testing.assert_allclose(
        made.topics["imu"]["pitch_rad"], np.radians(SAG_DEG_KG * load_kg), atol=1e-9
    )


@pytest.mark.parametrize(
    ("sections", "reads_m_s2"),
    [
        ({"sensors": {"acc_bias_m_s2": 0.1}}, 0.1),
        ({"defects": {"acc_tilt_deg": 1.0}}, G * np.sin(np.radians(1.0))),
    ],
)
def test_bias_and_tilt_are_in_every_reading_so_that_each_load_seems_pushed_by_its_mass(
    sections, reads_m_s2
):
    noise = {"acc_noise_m_s2": 0.0, **sections.pop("sensors", {})}
    made = shift(sensors=noise, **sections)
    imu = made.topics["imu"]
    truth = made.timeline.sample(imu["header_stamp_ns"].to_numpy())
    # the equation of motion with the reading in place of the specific force
    seeming_N = truth.mass_kg * imu["specific_force_x_m_s2"].to_numpy()
    pushed_N = seeming_N - truth.mass_kg * truth.specific_force_x_m_s2
    loaded = pl.Series(truth.mass_kg > MASS_KG + 300.0)
    assert loaded.sum() > 1000
    for which in (loaded, ~loaded):
        share = pushed_N[which] / truth.mass_kg[which]
        # a tilt takes the cosine off the acceleration
        np.testing.assert_allclose(share, reads_m_s2, atol=4e-4)
