"""Gentle brakes that no force sensor sees, from before the throttle shuts down to the stand."""

import numpy as np
import pytest

from analysis.simulation import Scenario
from analysis.simulation.logs.shift_logs import ShiftSimulation
from tests.analysis.simulation.quiet import FRICTION_N_S_M, MASS_KG, G, drive, log

GENTLE = {"gentle_m_s2": 0.1, "gentle_lead_s": 0.6}


def stop(made):
    """Times and channels of the last stop, from half a second after the brakes begin."""
    times = made.driven[-1].times
    time_s = np.arange(times.braking_s + 1.5, times.end_s - 0.01, 0.005)
    return time_s, made.sample_channels(time_s)


@pytest.mark.parametrize("direction", ["forward", "reverse"])
@pytest.mark.parametrize("slope_deg", [0.0, 2.0, -2.0])
def test_they_add_their_deceleration_to_friction_and_gravity_uphill(direction, slope_deg):
    start = {"kind": "start", "direction": direction}
    made = drive(
        500.0,
        brakes=GENTLE,
        machine={"friction_N_s_m": 500.0},
        terrain={"slope_deg": slope_deg},
        campaign={"manoeuvres": [{"kind": "rest"}, start], "start_s": 2.0},
    )
    _, run = stop(made)
    sign = np.sign(run.speed_x_m_s)
    uphill = np.maximum(0.0, sign * G * np.sin(np.radians(slope_deg)))
    expected = 0.1 + uphill + 500.0 * np.abs(run.speed_x_m_s) / (MASS_KG + 500.0)
    np.testing.assert_allclose(-sign * run.acc_x_m_s2, expected, atol=1e-3)
    assert made.sample_channels(np.array([made.driven[-1].times.end_s])).speed_x_m_s[0] == 0.0


def test_no_force_sensor_sees_them():
    _, run = stop(drive(brakes=GENTLE, campaign={"brake_measured_share": 1.0}))
    np.testing.assert_allclose(run.measured_force_x_N, 0.0, atol=1.0)
    assert np.abs(run.speed_x_m_s).max() > 0.3


def test_they_are_felt_while_the_drive_still_keeps_the_speed():
    made = drive(brakes=GENTLE)
    times = made.driven[-1].times
    assert times.braking_s == pytest.approx(6.0 - 0.6)
    run = made.sample_channels(np.array([times.braking_s + 0.4]))
    assert run.phase[0] == "braking"
    assert run.measured_force_x_N[0] > 0.9 * FRICTION_N_S_M * run.speed_x_m_s[0]
    slowed = run.measured_force_x_N - FRICTION_N_S_M * run.speed_x_m_s - MASS_KG * run.acc_x_m_s2
    assert slowed[0] == pytest.approx(0.1 * MASS_KG * (1.0 - np.exp(-0.4 / 0.08)), rel=1e-3)


def test_what_they_take_is_the_energy_that_friction_leaves():
    made = drive(brakes={"gentle_m_s2": 0.2, "gentle_lead_s": 0.0})
    times = made.driven[-1].times
    time_s = np.linspace(times.braking_s, times.end_s, 20_000)
    run = made.sample_channels(time_s)
    lag = 1.0 - np.exp(-(time_s - times.braking_s) / 0.08)
    braked = 0.2 * MASS_KG * lag + FRICTION_N_S_M * run.speed_x_m_s - run.force_x_N
    taken_J = np.trapezoid(braked * run.speed_x_m_s, time_s)
    assert taken_J == pytest.approx(0.5 * MASS_KG * run.speed_x_m_s[0] ** 2, rel=1e-4)


def test_the_truth_names_when_they_begin():
    made = log(brakes=GENTLE)
    start = made.manoeuvres.filter(kind="start").row(0, named=True)
    assert start["braking_ns"] - start["drive_ns"] == pytest.approx(4.4e9, abs=1e3)


def test_in_a_shift_the_machine_still_stops_about_where_it_is_to_stop():
    made = Scenario.model_validate(
        {
            "shift": {"duration_h": 0.08},
            "brakes": GENTLE,
            "terrain": {"slope_deg": 1.5},
            "machine": {"friction_N_s_m": 2000.0},
        }
    )
    assert made.shift is not None
    simulation = ShiftSimulation(made, made.shift)
    (whole,) = simulation.simulate_logs()
    sample_position_boom_and_bucket = whole.timeline.sample_position_boom_and_bucket
    assert sample_position_boom_and_bucket is not None
    for cycle in simulation.collect_truth().cycles.iter_rows(named=True):
        dig_m, dump_m = sample_position_boom_and_bucket(
            np.array([cycle["dig_ns"], cycle["dump_ns"]])
        ).position_m
        assert dig_m == pytest.approx(39.0, abs=6.0)
        assert dump_m == pytest.approx(1.0, abs=6.0)
