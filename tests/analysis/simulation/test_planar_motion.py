"""Manoeuvres in the plane obey the two equations that the estimators fit, and nothing else."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.simulation import Scenario, solve_motion
from estimators.planar import planar_rows
from estimators.planar.identifiability import find_identifiable_parameters

MACHINE = {
    "com_x_m": -0.2,
    "com_y_m": 0.05,
    "inertia_z_kg_m2": 4200.0,
    "friction_z_N_m_s": 5200.0,
    "load_x_m": 1.4,
    "load_y_m": -0.1,
}
START = {"kind": "start"}
REVERSE = {"kind": "start", "direction": "reverse", "throttle": 0.8}
SPIN = {"kind": "spin"}
RIGHT = {"kind": "spin", "direction": "right", "throttle": 0.7}
ARC = {"kind": "arc", "speed_m_s": 0.8, "yaw_rate_rad_s": 0.3, "duration_s": 4.0}
FORCE = {"lowest_N": -3000.0, "highest_N": 3000.0, "period_s": 6.0}
TORQUE = {"lowest_N_m": -2000.0, "highest_N_m": 2000.0, "period_s": 4.7}
SWING = {"kind": "excite", "force": FORCE, "duration_s": 14.0}
TWIST = {"kind": "excite", "torque": TORQUE, "duration_s": 10.0}
JOINT = {"kind": "excite", "force": FORCE, "torque": TORQUE, "duration_s": 14.0}
ALL = (START, REVERSE, SPIN, RIGHT, ARC, SWING, TWIST, JOINT)


def scenario(*manoeuvres, load_kg=150.0, machine=MACHINE, **sections):
    campaign = {
        "manoeuvres": manoeuvres,
        "loads_kg": [load_kg],
        "throttle_force_N": 9000.0,
        **sections.pop("campaign", {}),
    }
    return Scenario.model_validate({"machine": machine, "campaign": campaign, **sections})


def solved(*manoeuvres, **sections):
    made = scenario(*manoeuvres, **sections)
    return solve_motion(made, made.campaign.loads_kg[0])


def sampled(motion, rate_hz=100.0):
    time = np.arange(0.0, motion.duration_s, 1 / rate_hz)
    return time, motion.sample_channels(time)


def regressor(run):
    return planar_rows.make_planar_regressor(
        run.specific_force_x_m_s2,
        run.specific_force_y_m_s2,
        run.speed_x_m_s,
        run.yaw_rate_rad_s,
        run.yaw_acc_rad_s2,
    )


def parameters(body):
    return np.array(
        [
            body.mass_kg,
            body.inertia_z_kg_m2,
            body.first_moment_x_kg_m,
            body.first_moment_y_kg_m,
            body.friction_x_N_s_m,
            body.friction_z_N_m_s,
        ]
    )


@pytest.mark.heavy
@pytest.mark.parametrize("slope_deg", [0.0, 3.0])
def test_every_moving_sample_is_the_regressor_times_the_true_parameters(slope_deg):
    motion = solved(*ALL, terrain={"slope_deg": slope_deg})
    _, run = sampled(motion)
    forces = np.stack([run.force_x_N, run.torque_z_N_m], -1)
    expected = regressor(run) @ parameters(motion.body)
    np.testing.assert_allclose(forces, expected, atol=1e-6)


def test_with_coulomb_friction_the_rest_is_its_force_along_the_motion():
    motion = solved(*ALL, machine={**MACHINE, "coulomb_N": 400.0, "coulomb_z_N_m": 500.0})
    _, run = sampled(motion)
    forces = np.stack([run.force_x_N, run.torque_z_N_m], -1)
    rest = forces - regressor(run) @ parameters(motion.body)
    slides, turns = run.speed_x_m_s != 0.0, run.yaw_rate_rad_s != 0.0
    np.testing.assert_allclose(rest[slides, 0], 400.0 * np.sign(run.speed_x_m_s[slides]), atol=1e-6)
    np.testing.assert_allclose(
        rest[turns, 1], 500.0 * np.sign(run.yaw_rate_rad_s[turns]), atol=1e-6
    )
    assert np.abs(rest[:, 0]).max() <= 400.0 + 1e-6
    assert np.abs(rest[:, 1]).max() <= 500.0 + 1e-6


@pytest.mark.heavy
def test_speeds_are_continuous_and_accelerations_are_their_rates():
    motion = solved(*ALL, terrain={"slope_deg": 2.0}, machine={**MACHINE, "coulomb_N": 300.0})
    time, run = sampled(motion, rate_hz=5000.0)
    for speed, acceleration in (
        (run.speed_x_m_s, run.acc_x_m_s2),
        (run.yaw_rate_rad_s, run.yaw_acc_rad_s2),
        (run.heading_rad, run.yaw_rate_rad_s),
    ):
        assert np.abs(np.diff(speed)).max() < 3e-3
        middle = (acceleration[1:] + acceleration[:-1]) / 2
        steady = np.abs(np.diff(acceleration)) < 0.02
        assert steady.mean() > 0.99
        np.testing.assert_allclose(
            (np.diff(speed) / np.diff(time))[steady], middle[steady], atol=0.011
        )


@pytest.mark.parametrize(
    ("manoeuvre", "rank", "alone"),
    [
        (SWING, 3, {"mass_kg", "first_moment_y_kg_m", "friction_x_N_s_m"}),
        (
            TWIST,
            4,
            {"inertia_z_kg_m2", "first_moment_x_kg_m", "first_moment_y_kg_m", "friction_z_N_m_s"},
        ),
        (JOINT, 6, set(planar_rows.PARAMETERS)),
    ],
)
def test_a_motion_identifies_what_the_estimators_say_it_can(manoeuvre, rank, alone):
    motion = solved(manoeuvre)
    _, run = sampled(motion)
    found = find_identifiable_parameters(regressor(run), planar_rows.PARAMETERS)
    assert found.rank == rank
    assert {n for n, yes in zip(found.parameters, found.identifiable, strict=True) if yes} == alone


def test_one_arc_at_constant_rates_has_rank_two():
    motion = solved(ARC)
    (arc,) = motion.manoeuvres
    run = motion.sample_channels(np.linspace(arc.steady_s, arc.braking_s, 50))
    np.testing.assert_allclose(run.speed_x_m_s, 0.8)
    np.testing.assert_allclose(run.yaw_rate_rad_s, 0.3)
    assert set(run.phase[:-1]) == {"arc"}
    assert find_identifiable_parameters(regressor(run), planar_rows.PARAMETERS).rank == 2


def test_the_load_changes_mass_first_moment_and_inertia_by_where_it_sits():
    body = solved(START, load_kg=250.0).body
    assert body.mass_kg == 3864.0
    assert body.com_x_m == pytest.approx((3614 * -0.2 + 250 * 1.4) / 3864)
    assert body.com_y_m == pytest.approx((3614 * 0.05 - 250 * 0.1) / 3864)
    assert body.inertia_z_kg_m2 == pytest.approx(4200 + 250 * (1.4**2 + 0.1**2))


def test_reverse_mirrors_forward_on_level_ground_and_right_mirrors_left():
    reverse = {**START, "direction": "reverse"}
    right = {**SPIN, "direction": "right"}
    time = np.linspace(0.0, 6.0, 400)
    ahead, back = (solved(one).sample_channels(time) for one in (START, reverse))
    np.testing.assert_allclose(ahead.speed_x_m_s, -back.speed_x_m_s, atol=1e-9)
    np.testing.assert_allclose(ahead.force_x_N, -back.force_x_N, atol=1e-6)
    left, other = (solved(one).sample_channels(time) for one in (SPIN, right))
    np.testing.assert_allclose(left.yaw_rate_rad_s, -other.yaw_rate_rad_s, atol=1e-9)
    np.testing.assert_allclose(left.torque_z_N_m, -other.torque_z_N_m, atol=1e-6)


def test_driving_straight_keeps_the_heading_and_a_spin_keeps_the_place():
    motion = solved(START, SPIN, SWING, TWIST)
    time, run = sampled(motion)
    straight, spun, swung, twisted = motion.manoeuvres
    for window in (straight, swung):
        inside = (time >= window.start_s) & (time < window.end_s)
        assert not run.yaw_rate_rad_s[inside].any()
        assert np.ptp(run.heading_rad[inside]) == 0.0
    for window in (spun, twisted):
        inside = (time >= window.start_s) & (time < window.end_s)
        assert not run.speed_x_m_s[inside].any()
        assert np.ptp(run.heading_rad[inside]) > 0.3


def test_a_machine_turned_around_on_a_slope_drives_down_it():
    quarter = {"kind": "arc", "speed_m_s": 0.5, "yaw_rate_rad_s": np.pi / 14, "duration_s": 10.0}
    motion = solved(START, quarter, START, terrain={"slope_deg": 4.0})
    time, run = sampled(motion)
    assert run.heading_rad[-1] == pytest.approx(np.pi)
    speeds = [
        np.abs(run.speed_x_m_s[(time >= w.start_s) & (time < w.end_s)]).max()
        for w in (motion.manoeuvres[0], motion.manoeuvres[2])
    ]
    assert speeds[1] > 1.3 * speeds[0]
    gravity = run.specific_force_x_m_s2[-1] - run.acc_x_m_s2[-1]
    assert gravity == pytest.approx(-9.80665 * np.sin(np.radians(4)))


def test_a_drive_below_coulomb_friction_moves_nothing():
    weak = {"kind": "excite", "force": {"lowest_N": -390.0, "highest_N": 390.0}, "duration_s": 20.0}
    _, run = sampled(solved(weak, machine={"coulomb_N": 400.0}))
    assert not run.speed_x_m_s.any()
    assert not run.acc_x_m_s2.any()
    assert run.force_x_N.max() > 300.0
    assert set(run.phase) == {"standstill"}


def test_coulomb_friction_holds_the_machine_at_each_reversal_until_the_drive_overcomes_it():
    motion = solved(SWING, machine={"coulomb_N": 900.0})
    time, run = sampled(motion, rate_hz=1000.0)
    driven = time < 14.0
    stands = driven & (run.speed_x_m_s == 0.0)
    assert np.abs(run.force_x_N[stands]).max() <= 900.0 + 1e-6
    begins = time[np.flatnonzero(np.diff(stands.astype(int)) == 1)]
    np.testing.assert_allclose(np.diff(begins)[1:], 3.0, atol=0.002)
    assert begins.size == 5
    assert run.speed_x_m_s.max() > 0.3
    assert run.speed_x_m_s.min() < -0.3


@pytest.mark.heavy
@settings(max_examples=15, deadline=None)
@given(
    coulomb=st.floats(0, 2000),
    coulomb_z=st.floats(0, 2000),
    com_x=st.floats(-0.4, 0.4),
    com_y=st.floats(-0.3, 0.3),
    slope=st.floats(-3, 3),
    waveform=st.sampled_from(["triangular", "sinusoidal", "polynomial"]),
)
def test_the_work_of_drive_brakes_and_gravity_is_motion_and_heat(
    coulomb, coulomb_z, com_x, com_y, slope, waveform
):
    machine = {"coulomb_N": coulomb, "coulomb_z_N_m": coulomb_z, "com_x_m": com_x, "com_y_m": com_y}
    both = {
        **JOINT,
        "force": {**FORCE, "waveform": waveform},
        "torque": {**TORQUE, "waveform": waveform},
    }
    motion = solved(both, machine=machine, terrain={"slope_deg": slope})
    body = motion.body
    time = np.linspace(0.0, 14.0, 70_001)
    run = motion.sample_channels(time)
    v, omega = run.speed_x_m_s, run.yaw_rate_rad_s
    gravity_x = run.specific_force_x_m_s2 - run.acc_x_m_s2
    gravity_y = run.specific_force_y_m_s2 - omega * v
    mc_x, mc_y = body.first_moment_x_kg_m, body.first_moment_y_kg_m
    # of the centre of mass: v - ω c_y ahead, ω c_x to the left
    power = (
        run.force_x_N * v
        + run.torque_z_N_m * omega
        - gravity_x * (body.mass_kg * v - mc_y * omega)
        - gravity_y * mc_x * omega
        - body.friction_x_N_s_m * v**2
        - body.friction_z_N_m_s * omega**2
        - coulomb * np.abs(v)
        - coulomb_z * np.abs(omega)
    )
    kinetic = body.mass_kg * v**2 / 2 - mc_y * v * omega + body.inertia_z_kg_m2 * omega**2 / 2
    work = np.trapezoid(power, time)
    scale = np.trapezoid(np.abs(run.force_x_N * v) + np.abs(run.torque_z_N_m * omega), time)
    assert work == pytest.approx(kinetic[-1], abs=1e-4 * scale + 1e-3)


def test_braking_of_both_axes_ends_standing_each_at_its_own_time():
    motion = solved({**JOINT, "duration_s": 2.0})
    (window,) = motion.manoeuvres
    time = np.linspace(window.braking_s, window.end_s, 2000)
    run = motion.sample_channels(time)
    assert motion.sample_channels(np.array([window.end_s + 1e-3])).speed_x_m_s[0] == 0.0
    last = [np.flatnonzero(each)[-1] for each in (run.speed_x_m_s, run.yaw_rate_rad_s)]
    assert last[0] != last[1]
    assert max(last) >= 1997


@pytest.mark.heavy
def test_the_valves_ignore_their_dead_band_and_are_linear_beyond_it():
    swing = {**SWING, "duration_s": 12.0}
    made = {"valve_deadband_share": 0.1, "valve_lag_s": 0.001}
    time, run = sampled(solved(swing, campaign=made))
    asked = scenario(swing).campaign.manoeuvres_of_trial[0].force(time[time < 12.0])
    full = 9000.0
    opened = np.maximum(np.abs(asked) - 0.1 * full, 0.0) / 0.9 * np.sign(asked)
    np.testing.assert_allclose(run.force_x_N[time < 12.0][2:], opened[2:], atol=5.0)


def test_the_papers_triangle_is_highest_at_its_start_and_between_f0_and_f0_plus_half_a():
    wave = {"period_s": 15.0, "lowest_N": 100.0, "highest_N": 6100.0}
    force = scenario({"kind": "excite", "force": wave}).campaign.manoeuvres_of_trial[0].force
    time = np.linspace(0.0, 40.0, 999)
    amplitude, period, f0 = 12_000.0, 15.0, 100.0
    paper = amplitude / period * np.abs(np.mod(time, period) - period / 2) + f0
    np.testing.assert_allclose(force(time), paper, atol=1e-9)


@pytest.mark.parametrize("shape", ["triangular", "sinusoidal", "polynomial"])
def test_waveforms_run_between_their_values_with_their_period_and_phase(shape):
    wave = {**FORCE, "waveform": shape, "peak_s": 1.0}
    force = scenario({"kind": "excite", "force": wave}).campaign.manoeuvres_of_trial[0].force
    time = np.linspace(0.0, 12.0, 120_001)
    values = force(time)
    assert values.max() == pytest.approx(3000.0, abs=1e-3)
    assert values.min() == pytest.approx(-3000.0, abs=1e-3)
    assert time[np.argmax(values)] % 6.0 == pytest.approx(1.0, abs=1e-3)
    np.testing.assert_allclose(force(time + 6.0), values, atol=1e-6)
    assert np.mean(values[:-1]) == pytest.approx(0.0, abs=1e-3)
