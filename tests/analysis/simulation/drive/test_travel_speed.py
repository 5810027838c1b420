"""A travel: speeds that a driver holds for a while each, in a vehicle or on a bench."""

import numpy as np
import pytest

from analysis.simulation import solve_motion
from estimators.errors import ScenarioError
from tests.analysis.simulation.quiet import drive, log, scenario
from tests.trials.other_machines import OTHER_MACHINES

CAR = {
    "machine": {"mass_kg": 1600.0, "friction_N_s_m": 10.0, "force_share": 1.0},
    "rolling": {"coefficient": 0.01},
}


def travel(**keys):
    """A campaign of one travel with a sensor that sees the brakes."""
    return {
        "runs": 1,
        "brake_measured_share": 1.0,
        "manoeuvres": [{"kind": "travel", "duration_s": 120.0, **keys}],
    }


def sampled(made, step_s=0.02):
    """The channels of a log, every so often."""
    return made.sample_channels(np.arange(0.0, made.trial_s[-1], step_s))


def travelled(campaign=(), sections=(), **keys):
    """The channels of a car's travel."""
    return sampled(
        drive(**{**CAR, **dict(sections)}, campaign={**travel(**keys), **dict(campaign)})
    )


def test_speeds_are_held_in_their_range_and_the_acceleration_is_the_asked_one():
    run = travelled(speed_least_m_s=8.0, speed_most_m_s=12.0, stop_share=0.0, acceleration_m_s2=1.0)
    held = run.speed_x_m_s[np.abs(run.acc_x_m_s2) < 0.02]
    held = held[held > 1.0]
    assert 7.5 < held.min() < held.max() < 12.5
    assert np.quantile(run.acc_x_m_s2, 0.95) == pytest.approx(1.0, abs=0.1)


def test_it_stands_after_each_speed_where_each_ends_in_a_stop():
    run = travelled(hold_most_s=6.0, stop_share=1.0, stand_least_s=2.0, stand_most_s=3.0)
    stands = run.phase == "standstill"
    begins = np.flatnonzero(stands[1:] & ~stands[:-1])
    assert begins.size >= 4
    assert np.all(np.diff(begins) * 0.02 > 2.0)


def test_a_log_in_motion_begins_and_ends_while_it_drives():
    run = travelled({"rest_s": 0.0}, stop_share=0.0, in_motion=True)
    assert run.speed_x_m_s.min() > 4.0


@pytest.mark.parametrize(
    "campaign",
    [
        {"runs": 2, "rest_s": 0.0},
        {"rest_s": 3.0},
        {"rest_s": 0.0, "manoeuvres": [{"kind": "rest"}, {"kind": "travel", "in_motion": True}]},
    ],
)
def test_a_log_in_motion_is_one_travel(campaign):
    with pytest.raises(
        ScenarioError, match=r"in_motion: a log that begins and ends in motion holds one"
    ):
        log(**CAR, campaign={**travel(in_motion=True), **campaign})


def test_strokes_go_to_and_fro_about_one_place():
    run = travelled(stop_share=1.0, to_and_fro=True, speed_least_m_s=0.5, speed_most_m_s=1.0)
    way = np.sign(run.speed_x_m_s)
    turns = way[way != 0.0]
    assert 0.3 < (turns > 0.0).mean() < 0.7
    # held for 20 s at most, speeding up and slowing down for 1 s each
    place_m = np.cumsum(run.speed_x_m_s) * 0.02
    assert np.abs(place_m).max() < 22.0


@pytest.mark.parametrize("motor_brakes", [True, False])
def test_the_motor_or_the_brakes_slow_it(motor_brakes):
    seen = {"brake_measured_share": 0.0}
    run = travelled(seen, stop_share=0.0, motor_brakes=motor_brakes)
    slowing = run.acc_x_m_s2 < -0.8
    slowing &= run.speed_x_m_s > 6.0
    # the sensors see the motor alone
    seen_N = run.measured_force_x_N[slowing]
    assert bool((seen_N < -800.0).all()) is motor_brakes
    assert bool((np.abs(seen_N) < 1.0).all()) is not motor_brakes


def test_the_force_is_of_mass_friction_and_air():
    sections = {"machine": {**CAR["machine"], "air_N_s2_m2": 0.5}}
    run = travelled((), sections, stop_share=0.0, motor_brakes=True)
    moving = run.speed_x_m_s > 1.0
    v, a = run.speed_x_m_s[moving], run.acc_x_m_s2[moving]
    rolling_N = 0.01 * 1600.0 * 9.80665
    needed_N = 1600.0 * a + 10.0 * v + 0.5 * v**2 + rolling_N
    np.testing.assert_allclose(run.measured_force_x_N[moving], needed_N, atol=2.0)


def test_low_gears_have_more_to_turn():
    gears = {"gear_up_m_s": (6.0,), "gear_rotating_kg": (400.0, 50.0)}
    run = travelled((), {"drivetrain": gears}, stop_share=0.0, motor_brakes=True)
    v, a = run.speed_x_m_s, run.acc_x_m_s2
    rolling_N = 0.01 * 1600.0 * 9.80665
    rest_N = run.measured_force_x_N - 1600.0 * a - 10.0 * v - rolling_N
    for used, rotating_kg in (((v > 1.0) & (v < 5.5), 400.0), (v > 6.5, 50.0)):
        np.testing.assert_allclose(rest_N[used], rotating_kg * a[used], atol=3.0)


def test_a_spring_pulls_back_to_where_the_log_begins():
    bench = {"mass_kg": 100.0, "friction_N_s_m": 100.0, "spring_N_m": 200.0, "force_share": 1.0}
    made = drive(
        machine={**bench, "coulomb_N": 10.0, "inertia_z_kg_m2": 100.0},
        campaign={
            "throttle_force_N": 800.0,
            **travel(
                stop_share=1.0,
                to_and_fro=True,
                motor_brakes=True,
                speed_least_m_s=0.2,
                speed_most_m_s=0.4,
                hold_least_s=0.5,
                hold_most_s=1.0,
                response_s=0.1,
            ),
        },
    )
    time_s = np.arange(0.0, made.trial_s[-1], 0.005)
    run = made.sample_channels(time_s)
    v, a = run.speed_x_m_s, run.acc_x_m_s2
    place_m = np.cumsum(v) * 0.005
    free = (np.abs(v) > 0.05) & np.isin(run.phase, ["accelerating", "cruising"])
    rest_N = run.measured_force_x_N - 100.0 * a - 100.0 * v - 10.0 * np.sign(v)
    np.testing.assert_allclose(rest_N[free], 200.0 * place_m[free], atol=2.0)


@pytest.mark.parametrize(
    ("section", "keys", "message"),
    [
        ("drivetrain", {"gear_up_m_s": (5.0,), "gear_rotating_kg": (5.0,)}, "1 of 2 gears"),
        ("drivetrain", {"gear_up_m_s": (5.0, 5.0), "gear_rotating_kg": (3.0,) * 3}, "ascending"),
        ("campaign", travel(hold_least_s=9.0, hold_most_s=8.0), "'hold_least_s' is greater"),
    ],
)
def test_what_cannot_be_is_refused(section, keys, message):
    with pytest.raises(ValueError, match=message):
        scenario(**{section: keys})


def test_a_machine_that_its_motor_does_not_move_is_refused():
    campaign = {**travel(), "throttle_force_N": 100.0}
    with pytest.raises(ScenarioError, match="100 N do not move 1600 kg"):
        log(**CAR, campaign=campaign)


def test_a_travel_has_no_exact_solution():
    with pytest.raises(ScenarioError, match=r"a travel.*use simulate_campaign"):
        solve_motion(scenario(**CAR, campaign=travel()), 0.0)


@pytest.mark.parametrize("name", OTHER_MACHINES)
def test_the_same_seed_drives_the_same(name):
    one, other, third = (OTHER_MACHINES[name](seed) for seed in (3, 3, 4))
    assert one == other
    assert one != third
