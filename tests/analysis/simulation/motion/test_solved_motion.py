"""The noise-free motion of one run, against closed forms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.simulation import Scenario, solve_motion

G = 9.80665


def scenario(**sections):
    return Scenario.model_validate(sections)


def sampled(made, load_kg=0.0, rate_hz=100.0):
    motion = solve_motion(made, load_kg)
    time = np.arange(0.0, motion.duration_s + 1.0, 1 / rate_hz)
    return time, motion.sample_channels(time)


def moving(channels, *phases):
    return np.isin(channels.phase, phases or ("accelerating", "cruising", "braking"))


def test_mass_and_friction_come_back_from_the_noise_free_moving_samples():
    _, run = sampled(Scenario(), load_kg=150.0)
    rows = moving(run)
    regressor = np.column_stack([run.acc_x_m_s2, run.speed_x_m_s])[rows]
    solution = np.linalg.lstsq(regressor, run.force_x_N[rows])[0]
    np.testing.assert_allclose(solution, [3764.0, 2891.0], rtol=1e-6)


def test_with_coulomb_friction_and_slope_four_numbers_explain_the_force_and_the_rest_is_zero():
    made = scenario(machine={"coulomb_N": 300.0}, terrain={"slope_deg": 2.0})
    _, run = sampled(made)
    rows = moving(run)
    constant = np.ones(rows.sum())
    regressor = np.column_stack([run.acc_x_m_s2[rows], run.speed_x_m_s[rows], constant])
    solution = np.linalg.lstsq(regressor, run.force_x_N[rows])[0]
    resistance = 300.0 + 3614.0 * G * np.sin(np.radians(2.0))
    np.testing.assert_allclose(solution, [3614.0, 2891.0, resistance], rtol=1e-6)


def test_the_acceleration_is_the_rate_of_the_speed():
    time, run = sampled(Scenario(), rate_hz=10_000.0)
    rate = np.gradient(run.speed_x_m_s, time)
    inside = moving(run) & np.roll(moving(run), 3) & np.roll(moving(run), -3)
    np.testing.assert_allclose(rate[inside], run.acc_x_m_s2[inside], atol=2e-3)


def test_full_throttle_follows_the_closed_form_of_two_first_order_lags():
    made = Scenario()
    time, run = sampled(made)
    m, b, u, lag = 3614.0, 2891.0, 6000.0, made.campaign.valve_lag_s
    since = time - made.campaign.standstill_s
    tau = m / b
    closed = u / b * (1 - (tau * np.exp(-since / tau) - lag * np.exp(-since / lag)) / (tau - lag))
    rows = moving(run, "accelerating")
    np.testing.assert_allclose(run.speed_x_m_s[rows], closed[rows], atol=1e-9)


@pytest.mark.heavy
@settings(max_examples=12, deadline=None)
@given(
    friction=st.floats(500, 5000),
    coulomb=st.floats(0, 800),
    slope=st.floats(-4, 4),
    lag=st.floats(0.01, 0.3),
    load=st.floats(0, 500),
)
def test_a_long_start_ends_at_the_speed_where_friction_and_slope_take_the_throttle(
    friction, coulomb, slope, lag, load
):
    made = scenario(
        machine={"friction_N_s_m": friction, "coulomb_N": coulomb},
        campaign={"start_s": 150.0, "valve_lag_s": lag, "loads_kg": [load]},
        terrain={"slope_deg": slope},
    )
    motion = solve_motion(made, load)
    end = made.campaign.standstill_s + 150.0
    run = motion.sample_channels(np.array([end - 1e-6]))
    resistance = coulomb + (3614.0 + load) * G * np.sin(np.radians(slope))
    assert run.speed_x_m_s[0] == pytest.approx((6000.0 - resistance) / friction, rel=1e-6)


@pytest.mark.heavy
@settings(max_examples=20, deadline=None)
@given(
    coulomb=st.floats(0, 800),
    slope=st.floats(-4, 4),
    lag=st.floats(0.005, 0.3),
    braking=st.floats(1.0, 5.0),
)
def test_the_work_of_all_forces_is_the_kinetic_energy_and_the_machine_never_rolls_back(
    coulomb, slope, lag, braking
):
    made = scenario(
        machine={"coulomb_N": coulomb},
        campaign={"valve_lag_s": lag, "braking_m_s2": braking},
        terrain={"slope_deg": slope},
    )
    time, run = sampled(made, rate_hz=5000.0)
    assert run.speed_x_m_s.min() > -1e-9
    gravity = 3614.0 * G * np.sin(np.radians(slope))
    net = run.force_x_N - 2891.0 * run.speed_x_m_s - gravity - coulomb
    for end in (6.0, 8.0, 10.0):
        before = time <= end
        work = np.trapezoid((net * run.speed_x_m_s)[before], time[before])
        kinetic = 3614.0 / 2 * run.speed_x_m_s[before][-1] ** 2
        assert work == pytest.approx(kinetic, rel=1e-3, abs=1.0)


def test_cruising_keeps_the_speed_with_the_force_that_friction_and_slope_ask_for():
    made = scenario(
        machine={"coulomb_N": 200.0}, terrain={"slope_deg": 1.0}, campaign={"valve_lag_s": 0.001}
    )
    _, run = sampled(made)
    rows = moving(run, "cruising")
    assert np.ptp(run.speed_x_m_s[rows]) < 1e-3
    resistance = 200.0 + 3614.0 * G * np.sin(np.radians(1.0))
    kept = 2891.0 * run.speed_x_m_s[rows][-1] + resistance
    assert run.force_x_N[rows][-1] == pytest.approx(kept, rel=1e-4)


def test_brakes_add_their_deceleration_to_that_of_friction():
    made = scenario(campaign={"valve_lag_s": 0.001, "braking_m_s2": 2.0})
    _, run = sampled(made)
    rows = moving(run, "braking")
    speed, acc = run.speed_x_m_s[rows][2:], run.acc_x_m_s2[rows][2:]
    np.testing.assert_allclose(acc, -2.0 - 2891.0 / 3614.0 * speed, rtol=1e-3)


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
def test_the_torque_sensors_see_their_share_of_the_braking_force(share):
    made = scenario(campaign={"brake_measured_share": share, "valve_lag_s": 0.001})
    _, run = sampled(made)
    late = np.flatnonzero(moving(run, "braking"))[-5:]
    np.testing.assert_allclose(
        run.measured_force_x_N[late], -share * 3614.0 * made.campaign.braking_m_s2, atol=1e-6
    )
    driven = moving(run, "accelerating", "cruising")
    np.testing.assert_array_equal(run.measured_force_x_N[driven], run.force_x_N[driven])


@pytest.mark.parametrize("slope", [-6.0, 0.0, 6.0])
def test_brakes_hold_the_standing_machine_on_a_slope(slope):
    made = scenario(terrain={"slope_deg": slope}, campaign={"braking_m_s2": 3.0})
    time, run = sampled(made)
    standing = (time < 5.0) | (time > solve_motion(made, 0.0).duration_s)
    assert not run.speed_x_m_s[standing].any()
    assert not run.acc_x_m_s2[standing].any()
    gravity = 3614.0 * G * np.sin(np.radians(slope))
    np.testing.assert_allclose(run.force_x_N[standing], gravity)


def test_against_slope_and_coulomb_friction_the_machine_stands_until_the_drive_overcomes_them():
    made = scenario(
        machine={"coulomb_N": 1000.0},
        terrain={"slope_deg": 4.0},
        campaign={"valve_lag_s": 0.5},
    )
    time, run = sampled(made)
    resistance = 1000.0 + 3614.0 * G * np.sin(np.radians(4.0))
    breakaway = 5.0 - 0.5 * np.log(1 - resistance / 6000.0)
    first = time[np.flatnonzero(run.speed_x_m_s > 0)[0]]
    assert first == pytest.approx(breakaway, abs=0.011)
    assert not run.speed_x_m_s[time < breakaway].any()
