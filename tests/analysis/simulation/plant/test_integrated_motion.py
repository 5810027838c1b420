"""The integrated plant: it agrees with the exact solution, and each switch does what it says."""

import time

import numpy as np
import polars as pl
import pytest

from analysis.simulation import simulate_campaign, solve_motion
from estimators.errors import ScenarioError
from tests.analysis.simulation.quiet import (
    FRICTION_N_S_M,
    MASS_KG,
    G,
    drive,
    log,
    mean_speed,
    scenario,
)

#: Full throttle for long, without friction: the force is constant once the valves are open.
SMOOTH = {"friction_N_s_m": 0.0}


def sampled(made, begin_s=0.0, end_s=None, step_s=0.002):
    """Times and channels of a log."""
    time_s = np.arange(begin_s, made.trial_s[-1] if end_s is None else end_s, step_s)
    return time_s, made.sample_channels(time_s)


def times(made, number=-1):
    """When the last manoeuvre of the first trial happens."""
    return [each for each in made.driven if each.trial == 0][number].times


def resistance(run, mass_kg=MASS_KG):
    """What is left of the measured force after mass and viscous friction."""
    return run.measured_force_x_N - mass_kg * run.acc_x_m_s2 - FRICTION_N_S_M * run.speed_x_m_s


REVERSE_AND_FORCE = [
    {"kind": "rest", "duration_s": 1.0},
    {"kind": "start", "direction": "reverse", "throttle": 0.7},
    {
        "kind": "excite",
        "duration_s": 8.0,
        "force": {"waveform": "triangular", "period_s": 4.0, "lowest_N": -3e3, "highest_N": 4e3},
    },
]


@pytest.mark.parametrize(
    "sections",
    [
        pytest.param({}, id="plain"),
        pytest.param({"machine": {"coulomb_N": 300.0}}, id="Coulomb friction"),
        pytest.param({"terrain": {"slope_deg": 3.0}}, id="uphill"),
        pytest.param(
            {"terrain": {"slope_deg": -3.0}, "machine": {"coulomb_N": 700.0}}, id="downhill"
        ),
        pytest.param(
            {"campaign": {"manoeuvres": REVERSE_AND_FORCE}, "machine": {"coulomb_N": 400.0}},
            id="reverse, and stick and slip",
        ),
    ],
)
def test_plant_and_exact_solution_agree(sections):
    made, exact = drive(100.0, **sections), solve_motion(scenario(**sections), 100.0)
    assert made.trial_s[1] == pytest.approx(exact.duration_s, abs=1e-5)
    for mine, theirs in zip(made.driven, exact.manoeuvres, strict=True):
        assert mine.times[1:] == pytest.approx(theirs[1:], abs=1e-5)
    time_s = np.arange(0.0, exact.duration_s - 1e-3, 0.0037)
    run, truth = made.sample_channels(time_s), exact.sample_channels(time_s)
    np.testing.assert_array_equal(run.phase, truth.phase)
    for name, atol in (
        ("speed_x_m_s", 1e-4),
        ("acc_x_m_s2", 1e-3),
        ("specific_force_x_m_s2", 1e-3),
        ("force_x_N", 2.0),
        ("measured_force_x_N", 2.0),
    ):
        np.testing.assert_allclose(getattr(run, name), getattr(truth, name), atol=atol)


def test_a_log_of_150_s_takes_well_under_half_a_second():
    drive()  # compiles
    took_s = []
    for _ in range(3):
        begin = time.perf_counter()
        made = drive(campaign={"runs": 21})
        took_s.append(time.perf_counter() - begin)
    assert made.trial_s[-1] > 140.0
    assert min(took_s) < 0.5


def test_a_power_limited_force_is_the_power_over_the_speed():
    _, run = sampled(drive(drivetrain={"power_limit_W": 5000.0}), 2.0, 3.9)
    np.testing.assert_allclose(run.measured_force_x_N, 5000.0 / run.speed_x_m_s, rtol=1e-5)


def test_a_voltage_limited_force_falls_linearly_to_its_no_load_speed():
    made = drive(drivetrain={"no_load_speed_m_s": 3.0}, campaign={"start_s": 8.0})
    _, run = sampled(made, 2.5, 8.9)
    force = 6000.0 * (1.0 - run.speed_x_m_s / 3.0)
    np.testing.assert_allclose(run.measured_force_x_N, force, rtol=1e-5)
    assert run.speed_x_m_s[-1] == pytest.approx(6000.0 / (FRICTION_N_S_M + 2000.0), rel=1e-4)


def test_efficiency_is_lost_of_the_measured_force_while_driving():
    _, run = sampled(drive(drivetrain={"efficiency": 0.9}), 1.01, 5.9)
    needed = MASS_KG * run.acc_x_m_s2 + FRICTION_N_S_M * run.speed_x_m_s
    np.testing.assert_allclose(0.9 * run.measured_force_x_N, needed, atol=1.0)


def test_efficiency_is_lost_of_the_wheels_force_where_they_drive_the_motor():
    start = {"kind": "start", "throttle": 0.2, "start_s": 0.6}
    made = drive(
        drivetrain={"efficiency": 0.9},
        terrain={"slope_deg": -6.0},
        campaign={"manoeuvres": [start], "braking_m_s2": 3.0},
    )
    _, run = sampled(made, 1.5, 2.5)
    assert (run.measured_force_x_N < -1000.0).all()
    np.testing.assert_allclose(run.measured_force_x_N, 0.9 * run.force_x_N)
    ground = MASS_KG * run.specific_force_x_m_s2 + FRICTION_N_S_M * run.speed_x_m_s
    np.testing.assert_allclose(run.force_x_N, ground, atol=0.5)


def test_rotating_parts_are_accelerated_besides_the_mass_of_the_truth():
    made = drive(drivetrain={"rotating_kg": 200.0})
    _, run = sampled(made, 1.01, 5.9)
    needed = (MASS_KG + 200.0) * run.acc_x_m_s2 + FRICTION_N_S_M * run.speed_x_m_s
    np.testing.assert_allclose(run.measured_force_x_N, needed, atol=1.0)
    assert made.driven[-1].body.mass_kg == MASS_KG


SOFT = {"resonance_hz": 3.0, "resonance_damping": 0.05, "wheel_mass_share": 0.2}


def test_a_soft_driveline_conserves_momentum():
    made = drive(drivetrain=SOFT, machine=SMOOTH)
    time_s, run = sampled(made, 1.0, 3.9)
    momentum = MASS_KG * (0.2 * run.wheel_speed_x_m_s + 0.8 * run.speed_x_m_s)
    since_s, lag_s = time_s - 1.0, 0.08
    impulse = 6000.0 * (since_s + lag_s * np.expm1(-since_s / lag_s))
    np.testing.assert_allclose(momentum, impulse, atol=0.5)


def test_a_soft_driveline_swings_at_its_natural_frequency_and_decays_by_its_damping():
    made = drive(drivetrain=SOFT, machine=SMOOTH, campaign={"valve_lag_s": 0.01})
    time_s, run = sampled(made, 1.1, 3.9)
    apart = run.wheel_speed_x_m_s - run.speed_x_m_s
    ups = time_s[1:][(apart[:-1] < 0) & (apart[1:] >= 0)]
    damped_hz = 3.0 * np.sqrt(1.0 - 0.05**2)
    assert np.diff(ups).mean() == pytest.approx(1.0 / damped_hz, rel=0.002)
    period = round(1.0 / damped_hz / 0.002)
    peaks = [np.abs(apart[k * period : (k + 1) * period]).max() for k in range(5)]
    decay = np.exp(-2.0 * np.pi * 0.05 / np.sqrt(1.0 - 0.05**2))
    np.testing.assert_allclose(np.divide(peaks[1:], peaks[:-1]), decay, rtol=0.02)


def test_a_soft_driveline_on_a_slope_begins_at_rest():
    _, run = sampled(drive(drivetrain=SOFT, terrain={"slope_deg": 4.0}), 0.0, 1.0)
    np.testing.assert_allclose(run.speed_x_m_s, 0.0, atol=1e-9)


def test_tyres_that_relax_slip_behind_their_force_by_their_relaxation_length():
    made = log(
        drivetrain={"relaxation_length_m": 0.4},
        machine={"slip_stiffness_N": 80_000.0},
        sensors={"rate_hz": 1000.0},
        log={"latency_jitter_s": 0.0},
    )
    truth = made.noise_free_motion
    time_s = (truth["time_ns"] - truth["time_ns"][0]).to_numpy() * 1e-9
    v, force = truth["speed_x_m_s"].to_numpy(), truth["force_x_N"].to_numpy()
    slip_m_s = mean_speed(made) - v
    # with the distance s: σ dF/ds + F = C κ
    expected = (np.abs(v) * force + 0.4 * np.gradient(force, time_s)) / 80_000.0
    opening = (time_s > 1.01) & (time_s < 1.5)
    np.testing.assert_allclose(slip_m_s[opening], expected[opening], atol=2e-4)
    steady = (time_s > 3.0) & (time_s < 3.9)
    np.testing.assert_allclose(slip_m_s[steady], (v * force / 80_000.0)[steady], rtol=1e-5)


def test_squat_makes_the_accelerometer_read_its_share_of_gravity_and_the_pitch_says_so():
    made = log(chassis={"squat_deg_s2_m": 0.5})
    acc = made.noise_free_motion["acc_x_m_s2"].to_numpy()
    imu = made.topics["imu"]
    reads = imu["specific_force_x_m_s2"].to_numpy()
    np.testing.assert_allclose(reads, acc * (1.0 + G * np.radians(0.5)), rtol=3e-4, atol=1e-9)
    np.testing.assert_allclose(imu["pitch_rad"], np.radians(0.5) * acc, atol=1e-12)
    norm = np.hypot(reads, imu["specific_force_z_m_s2"].to_numpy())
    np.testing.assert_allclose(norm, np.hypot(acc, G), rtol=1e-9)


def test_a_body_that_pitches_overshoots_as_its_damping_says_and_settles_at_its_squat():
    made = drive(
        chassis={"squat_deg_s2_m": 0.5, "squat_hz": 1.5, "squat_damping": 0.2},
        machine=SMOOTH,
        campaign={"valve_lag_s": 0.004, "start_s": 6.0},
    )
    _, run = sampled(made, 1.0, 6.9)
    settled = np.radians(0.5) * 6000.0 / MASS_KG
    overshoot = np.exp(-np.pi * 0.2 / np.sqrt(1.0 - 0.2**2))
    assert run.squat_rad.max() == pytest.approx(settled * (1.0 + overshoot), rel=0.01)
    assert run.squat_rad[-1] == pytest.approx(settled, rel=1e-3)


def test_the_gyroscope_turns_as_the_pitch_does_with_the_y_axis_to_the_left():
    made = log(
        chassis={"squat_deg_s2_m": 0.5, "squat_hz": 1.5},
        terrain={"hills_deg": 3.0},
        sensors={"rate_hz": 1000.0},
        log={"latency_jitter_s": 0.0},
    )
    imu = made.topics["imu"]
    turned = -np.cumsum(imu["pitch_rate_rad_s"].to_numpy()) / 1000.0
    pitch = imu["pitch_rad"].to_numpy()
    assert np.ptp(pitch) > np.radians(1.0)
    np.testing.assert_allclose(turned, pitch - pitch[0], atol=1e-4)


def test_a_boom_takes_from_the_machine_the_momentum_that_it_has_itself():
    boom = {"boom_kg": 300.0, "boom_stroke_m": 0.4, "boom_period_s": 2.0}
    time_s, moved = sampled(drive(chassis=boom, machine=SMOOTH), 1.1, 3.9)
    _, plain = sampled(drive(machine=SMOOTH), 1.1, 3.9)
    turn = np.pi
    swings = 0.2 * turn * np.cos(turn * time_s)
    momentum = MASS_KG * (moved.speed_x_m_s - plain.speed_x_m_s) + 300.0 * swings
    # what the brakes held until the start is the same for good
    np.testing.assert_allclose(momentum, momentum[0], atol=0.1)
    assert np.ptp(swings) > 1.0


def test_a_drag_of_the_brakes_is_friction_that_no_sensor_sees():
    dragging, rubbing = drive(brakes={"drag_N": 200.0}), drive(machine={"coulomb_N": 200.0})
    time_s, mine = sampled(dragging)
    theirs = rubbing.sample_channels(time_s)
    np.testing.assert_allclose(mine.speed_x_m_s, theirs.speed_x_m_s, atol=1e-9)
    np.testing.assert_allclose(mine.measured_force_x_N, theirs.measured_force_x_N, atol=1e-6)
    assert dragging.driven[-1].body.coulomb_x_N == 0.0


def test_brakes_that_release_slowly_drag_less_and_less():
    made = drive(brakes={"release_s": 0.3, "release_N": 4000.0})
    time_s, run = sampled(made, 1.0, 3.9)
    moving = run.speed_x_m_s > 1e-3
    dragging = 4000.0 * np.exp(-(time_s - 1.0) / 0.3)
    np.testing.assert_allclose(resistance(run)[moving], dragging[moving], atol=1.0)
    # it stands until the drive overcomes what is left of them
    drive_N = -6000.0 * np.expm1(-(time_s - 1.0) / 0.08)
    np.testing.assert_array_equal(run.speed_x_m_s[drive_N < dragging], 0.0)
    assert (run.speed_x_m_s[drive_N > dragging + 100.0] > 0.0).all()


def test_a_machine_that_coasts_slows_down_by_friction_alone():
    start = {"kind": "start", "coast_s": 3.0}
    made = drive(campaign={"manoeuvres": [start]})
    begins_s = times(made).steady_s + 2.0
    assert times(made).braking_s == pytest.approx(begins_s + 3.0)
    time_s, run = sampled(made, begins_s + 1.5, begins_s + 3.0)
    expected = run.speed_x_m_s[0] * np.exp(-(time_s - time_s[0]) * FRICTION_N_S_M / MASS_KG)
    np.testing.assert_allclose(run.speed_x_m_s, expected, rtol=1e-5)
    np.testing.assert_allclose(run.measured_force_x_N, 0.0, atol=1e-3)


def test_digging_resists_more_and_more_at_the_end_of_a_start_whichever_way_it_goes():
    for direction, sign in (("forward", 1.0), ("reverse", -1.0)):
        start = {"kind": "start", "digging_N": 2000.0, "digging_s": 1.5, "direction": direction}
        time_s, run = sampled(drive(campaign={"manoeuvres": [start]}), 0.1, 4.99)
        digging = 2000.0 * np.clip((time_s - 3.5) / 1.5, 0.0, 1.0)
        np.testing.assert_allclose(resistance(run), sign * digging, atol=1.0)


def test_digging_stalls_a_machine_that_then_stands_against_its_drive():
    start = {"kind": "start", "digging_N": 50_000.0, "digging_s": 1.0, "cruise_s": 4.0}
    made = drive(campaign={"manoeuvres": [start]})
    _, run = sampled(made, 6.8, 6.99)
    np.testing.assert_array_equal(run.speed_x_m_s, 0.0)
    np.testing.assert_array_equal(run.acc_x_m_s2, 0.0)
    assert (run.measured_force_x_N > 1000.0).all()
    assert times(made).end_s == pytest.approx(times(made).braking_s)


HILLS = {"hills_deg": 3.0, "hills_length_m": 6.0, "hills_phase_deg": 40.0}


def test_hills_take_as_energy_what_the_machine_climbs():
    made = drive(terrain=HILLS, machine=SMOOTH, campaign={"throttle_force_N": 2500.0})
    time_s, run = sampled(made, 1.0, 5.9)
    way = np.diff(time_s) * (run.speed_x_m_s[1:] + run.speed_x_m_s[:-1]) / 2.0
    force = (run.measured_force_x_N[1:] + run.measured_force_x_N[:-1]) / 2.0
    climb = np.sin((run.slope_rad[1:] + run.slope_rad[:-1]) / 2.0)
    energy = 0.5 * MASS_KG * run.speed_x_m_s[1:] ** 2 + MASS_KG * G * np.cumsum(climb * way)
    np.testing.assert_allclose(energy, np.cumsum(force * way), atol=0.001 * energy.max())
    assert np.ptp(run.slope_rad) > np.radians(2.0)


def test_the_pitch_follows_the_hills_and_the_specific_force_carries_their_gravity():
    made = log(terrain={**HILLS, "slope_deg": 1.0}, campaign={"throttle_force_N": 5000.0})
    truth, pitch = made.noise_free_motion, made.topics["imu"]["pitch_rad"].to_numpy()
    speed = truth["speed_x_m_s"].to_numpy()
    position = np.concatenate([[0.0], np.cumsum(speed[1:] + speed[:-1]) / 2.0 * 0.01])
    phase = 2.0 * np.pi * position / 6.0 + np.radians(40.0)
    np.testing.assert_allclose(np.degrees(pitch), 1.0 + 3.0 * np.sin(phase), atol=2e-3)
    moving = truth["phase"].is_in(["accelerating", "cruising"]).to_numpy()
    specific = made.topics["imu"]["specific_force_x_m_s2"].to_numpy()
    needed = MASS_KG * specific + FRICTION_N_S_M * speed
    measured = truth["measured_force_x_N"].to_numpy()
    np.testing.assert_allclose(needed[moving], measured[moving], atol=1.0)


def starts(made):
    return [each for each in made.driven if each.times.kind == "start"]


def test_friction_that_differs_by_start_is_what_the_truth_says_of_each():
    made = drive(
        machine={"coulomb_N": 500.0},
        sensors={"seed": 2},
        starts={"coulomb_std_N": 100.0},
        campaign={"runs": 40, "standstill_s": 0.1, "start_s": 1.0, "cruise_s": 0.5},
    )
    frictions = np.array([each.body.coulomb_x_N for each in starts(made)])
    assert frictions.mean() == pytest.approx(500.0, abs=3 * 100 / np.sqrt(40))
    assert frictions.std() == pytest.approx(100.0, rel=0.35)
    for each in starts(made):
        middle_s = made.trial_s[each.trial] + (each.times.drive_s + each.times.steady_s) / 2
        run = made.sample_channels(np.array([middle_s]))
        assert resistance(run)[0] == pytest.approx(each.body.coulomb_x_N, abs=0.5)


def test_throttle_differs_by_start_within_its_range_and_directions_alternate():
    made = drive(
        starts={"throttle_least": 0.4, "throttle_most": 0.8, "directions": "alternating"},
        campaign={"runs": 30, "standstill_s": 0.1},
    )
    shares = np.array([each.throttle for each in starts(made)])
    assert 0.4 <= shares.min() < 0.5
    assert 0.7 < shares.max() <= 0.8
    for number, each in enumerate(starts(made)):
        run = made.sample_channels(
            np.array([made.trial_s[each.trial] + each.times.steady_s - 1e-6])
        )
        sign = -1.0 if number % 2 else 1.0
        assert each.direction == ("reverse" if number % 2 else "forward")
        assert run.measured_force_x_N[0] == pytest.approx(sign * each.throttle * 6000.0, rel=1e-6)


def test_what_differs_by_start_is_the_same_for_a_seed_and_leaves_earlier_starts_alone():
    differs = {"coulomb_std_N": 100.0, "throttle_least": 0.5}
    few, many = (drive(starts=differs, campaign={"runs": runs}) for runs in (2, 4))
    assert [each[4:] for each in few.driven] == [each[4:] for each in many.driven[:4]]
    other = drive(starts=differs, campaign={"runs": 2}, sensors={"seed": 9})
    assert other.driven[1].throttle != few.driven[1].throttle


def test_a_restless_stick_swings_back_from_its_throttle_and_never_beyond_it():
    made = drive(
        starts={"stick_share": 0.5, "stick_hz": 0.5},
        campaign={"start_s": 8.0, "valve_lag_s": 0.001},
    )
    time_s, run = sampled(made, 1.5, 8.9)
    asked = 6000.0 * (1.0 - 0.5 * (0.5 - 0.5 * np.cos(np.pi * (time_s - 1.0))))
    np.testing.assert_allclose(run.measured_force_x_N, asked, atol=12.0)


def test_a_start_that_turns_holds_its_yaw_rate_and_scrubs():
    made = log(
        starts={"turn_rad_s": 0.04, "scrub_N_s_rad": 8000.0},
        sensors={"rate_hz": 500.0},
        log={"latency_jitter_s": 0.0},
    )
    truth = made.noise_free_motion
    held = ((truth["time_ns"] - truth["time_ns"][0]).is_between(2.5e9, 5.9e9)).to_numpy()
    rate = made.topics["imu"]["yaw_rate_rad_s"].to_numpy()
    np.testing.assert_allclose(rate[held], 0.04, rtol=1e-5)
    speed = made.topics["speed"]
    apart = (speed["speed_right_m_s"] - speed["speed_left_m_s"]).to_numpy()
    np.testing.assert_allclose(apart, 1.5 * rate, atol=1e-9)
    needed = MASS_KG * truth["acc_x_m_s2"] + FRICTION_N_S_M * truth["speed_x_m_s"]
    scrub = (truth["measured_force_x_N"] - needed).to_numpy()
    np.testing.assert_allclose(scrub[held], 320.0, atol=0.5)
    heading = truth["heading_rad"].to_numpy()
    np.testing.assert_allclose(heading[-1], np.cumsum(rate)[-1] / 500.0, rtol=1e-3)


@pytest.mark.parametrize(
    ("loading", "loads_kg"),
    [
        ({"change_kg": 250.0, "change_before_start": 2}, [100, 100, 350, 350]),
        ({"change_kg": 250.0, "alternating": True}, [100, 350, 100, 350]),
        ({"change_kg": -100.0, "change_before_start": 1}, [100, 0, 0, 0]),
    ],
)
def test_the_truth_names_the_mass_of_every_start_and_it_is_the_one_that_is_driven(
    loading, loads_kg
):
    made = log(loading=loading, campaign={"loads_kg": [100], "runs": 4})
    assert made.trials["load_kg"].to_list() == loads_kg
    named = made.manoeuvres.filter(kind="start")
    assert named["mass_kg"].to_list() == [MASS_KG + load for load in loads_kg]
    truth = made.noise_free_motion
    for row in named.iter_rows(named=True):
        driven = pl.col("time_ns").is_between(row["drive_ns"] + 10_000_000, row["steady_ns"] - 1)
        run = truth.filter(driven)
        force = run["measured_force_x_N"] - FRICTION_N_S_M * run["speed_x_m_s"]
        np.testing.assert_allclose(force, row["mass_kg"] * run["acc_x_m_s2"], atol=1.0)
        np.testing.assert_array_equal(run["mass_kg"], row["mass_kg"])


def test_a_bucket_that_fills_takes_up_the_momentum_of_its_load_and_is_emptied_when_it_stands():
    made = log(loading={"fill_kg_s": 60.0}, campaign={"runs": 2}, machine=SMOOTH)
    start = made.manoeuvres.filter(kind="start").row(0, named=True)
    assert (start["load_kg"], start["load_end_kg"]) == (0.0, 300.0)
    truth = made.noise_free_motion
    time_s = (truth["time_ns"] - start["drive_ns"]).to_numpy() * 1e-9
    opened = (time_s > 0.02) & (time_s < 2.99)
    impulse = 6000.0 * (time_s + 0.08 * np.expm1(-time_s / 0.08))
    momentum = (truth["mass_kg"] * truth["speed_x_m_s"]).to_numpy()
    np.testing.assert_allclose(momentum[opened], impulse[opened], atol=0.5)
    assert truth.filter(phase="standstill")["mass_kg"].max() == MASS_KG


def test_a_start_that_does_not_move_is_refused_by_its_number():
    made = scenario(terrain={"slope_deg": 4.0, "hills_deg": 8.0, "hills_phase_deg": 90.0})
    with pytest.raises(ScenarioError, match="start 0 does not move 3614 kg with 6000 N"):
        next(simulate_campaign(made))
