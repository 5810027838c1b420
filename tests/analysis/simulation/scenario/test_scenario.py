"""What a scenario may be, and what of it can be simulated."""

import pytest
from pydantic import ValidationError

from analysis.simulation import Scenario, simulate_campaign, solve_motion
from estimators.errors import ScenarioError


def test_the_defaults_are_the_papers_campaign():
    made = Scenario()
    assert made.campaign.loads_kg == (0, 50, 100, 150, 200, 250)
    assert made.campaign.runs == 9
    assert (made.machine.mass_kg, made.machine.friction_N_s_m) == (3614.0, 2891.0)


def excite(**waves):
    return {"campaign": {"manoeuvres": [{"kind": "rest"}, {"kind": "excite", **waves}]}}


@pytest.mark.parametrize(
    ("sections", "what"),
    [
        ({"campaign": {"loads_kg": [0, 50, 50]}}, "50 kg appears twice"),
        ({"campaign": {"loads_kg": [-50]}}, "between 0 and 1e6 kg"),
        ({"sensors": {"force_noise_N": float("nan")}}, "finite number"),
        (excite(), "needs 'force', 'torque' or both"),
        ({"campaign": {"manoeuvres": [{"kind": "dance"}]}}, "dance"),
        ({"campaign": {"manoeuvres": [{"duration_s": 3}]}}, "kind"),
    ],
)
def test_a_value_that_no_scenario_may_have_is_refused_when_it_is_made(sections, what):
    with pytest.raises(ValidationError, match=what):
        Scenario.model_validate(sections)


@pytest.mark.parametrize(
    ("sections", "what"),
    [
        ({"terrain": {"slope_deg": 12.0}}, "slope and friction resist 3864 kg"),
        ({"machine": {"coulomb_N": 7000.0}}, "slope and friction resist"),
        (
            {
                "campaign": {"valve_lag_s": 10.0, "start_s": 0.1, "throttle_force_N": 100.0},
                "machine": {"coulomb_N": 50.0},
            },
            "reaches 1 N in campaign.start_s",
        ),
        ({"terrain": {"slope_deg": -12.0}}, "does not stop the machine on this slope"),
        ({"campaign": {"throttle_force_N": 1e6}}, "beyond 50 m/s"),
        ({"log": {"latency_jitter_s": 0.02}}, "recorded in order"),
        (
            {"log": {"latency_jitter_s": 0.005}, "sampling": {"imu_rate_hz": 400}},
            "shorter than the period of every topic",
        ),
        ({"drivetrain": {"relaxation_length_m": 0.4}}, "give machine.slip_stiffness_N"),
        (
            {"starts": {"turn_rad_s": 0.04}, "terrain": {"slope_deg": 1.0}},
            "starts.turn_rad_s: turning starts need level ground",
        ),
        (
            {"loading": {"change_kg": -50.0, "alternating": True}},
            "loading.change_kg: leaves -50 kg in the bucket",
        ),
    ],
)
def test_what_cannot_be_simulated_is_refused_with_the_reason(sections, what):
    with pytest.raises(ScenarioError, match=what):
        simulate_campaign(Scenario.model_validate(sections))


@pytest.mark.parametrize(
    ("sections", "what"),
    [
        (excite(force={"highest_N": 6100.0}), "manoeuvres.1: asks for 3050 N on one side"),
        (
            excite(force={"highest_N": 4000.0}, torque={"highest_N_m": 2000.0}),
            "asks for 3333 N on one side, more than full throttle gives, 3000 N",
        ),
        (
            {"campaign": {"manoeuvres": [{"kind": "arc", "speed_m_s": 3, "yaw_rate_rad_s": 0.2}]}},
            "manoeuvres.0: asks for",
        ),
        (
            {
                "machine": {"coulomb_z_N_m": 5000.0},
                "campaign": {"manoeuvres": [{"kind": "spin"}]},
            },
            "reaches 4500 N·m in start_s",
        ),
        (
            {
                "machine": {"friction_z_N_m_s": 1.0, "inertia_z_kg_m2": 700.0},
                "campaign": {"manoeuvres": [{"kind": "spin"}]},
            },
            "turns the machine faster than 10 rad/s",
        ),
        (
            {
                "terrain": {"slope_deg": -8.0},
                "campaign": {
                    "manoeuvres": [{"kind": "start", "direction": "reverse", "throttle": 0.8}]
                },
            },
            "manoeuvres.0: the driving force reaches 4800 N in campaign.manoeuvres.0.start_s, but",
        ),
        ({"machine": {"com_x_m": 2.0}}, "is about the origin"),
    ],
)
def test_a_manoeuvre_that_cannot_be_driven_is_refused_with_its_number_and_the_reason(
    sections, what
):
    with pytest.raises(ScenarioError, match=what):
        simulate_campaign(Scenario.model_validate(sections))


@pytest.mark.parametrize(
    "manoeuvre",
    [
        {"kind": "spin"},
        {"kind": "arc", "speed_m_s": 0.5, "yaw_rate_rad_s": 0.1},
        {"kind": "excite", "torque": {"highest_N_m": 100.0}},
    ],
)
@pytest.mark.parametrize(
    ("section", "key", "value"),
    [
        ("drivetrain", "power_limit_W", 5000.0),
        ("chassis", "squat_deg_s2_m", 0.5),
        ("brakes", "drag_N", 100.0),
        ("starts", "coulomb_std_N", 50.0),
        ("loading", "fill_kg_s", 10.0),
        ("terrain", "hills_deg", 1.0),
    ],
)
def test_what_turns_is_refused_where_only_straight_motion_is_simulated_and_says_for_which_key(
    manoeuvre, section, key, value
):
    made = Scenario.model_validate(
        {
            "campaign": {"manoeuvres": [{"kind": "rest"}, manoeuvre]},
            section: {key: value},
        }
    )
    with pytest.raises(ScenarioError, match=rf"manoeuvres.1: .* with {section}\.{key};"):
        simulate_campaign(made)


def test_one_trial_is_solved_only_where_all_are_alike():
    made = Scenario.model_validate({"drivetrain": {"rotating_kg": 100.0}})
    with pytest.raises(ScenarioError, match=r"drivetrain\.rotating_kg: cannot be solved trial"):
        solve_motion(made, 0.0)


def test_a_least_throttle_above_the_most_is_refused_when_it_is_made():
    with pytest.raises(ValidationError, match="is above 'throttle_most'"):
        Scenario.model_validate({"starts": {"throttle_least": 0.9, "throttle_most": 0.5}})


def test_a_scenario_made_in_python_is_refused_like_one_from_a_file():
    plain = Scenario()
    steep = plain.model_copy(update={"terrain": plain.terrain.model_copy(update={"slope_deg": 12})})
    with pytest.raises(ScenarioError, match="slope and friction resist 3864 kg"):
        simulate_campaign(steep)
    with pytest.raises(ScenarioError, match="slope and friction resist 3614 kg"):
        solve_motion(steep, 0.0)


def test_a_motion_is_refused_for_the_load_that_it_is_solved_with():
    slope = Scenario.model_validate({"terrain": {"slope_deg": 9.0}})
    assert solve_motion(slope, 0.0).duration_s > 0.0
    with pytest.raises(ScenarioError, match="resist 4614 kg"):
        solve_motion(slope, 1000.0)
