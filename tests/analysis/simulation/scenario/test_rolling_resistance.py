"""Rolling resistance: a share of the weight with its load, on the ground that is there."""

from dataclasses import astuple

import numpy as np
import polars as pl
import pytest

from analysis.simulation import Scenario, solve_motion
from analysis.simulation.logs.shift_logs import ShiftSimulation
from analysis.simulation.trials.switches import find_scenario_key_needing_integration
from tests.analysis.simulation.quiet import FRICTION_N_S_M, MASS_KG, G, drive, log, scenario

#: Nothing else slows the machine down.
SMOOTH = {"friction_N_s_m": 0.0}
COAST = {"start_s": 3.0, "cruise_s": 0.5, "coast_s": 2.0}


def start(**keys):
    """A rest and a start."""
    return {"manoeuvres": [{"kind": "rest", "duration_s": 1.0}, {"kind": "start", **keys}]}


def resistance(run, mass_kg):
    """What is left of the force after mass, gravity and viscous friction."""
    inertia = mass_kg * run.specific_force_x_m_s2
    return run.force_x_N - inertia - FRICTION_N_S_M * run.speed_x_m_s


@pytest.mark.parametrize("load_kg", [0.0, 1000.0])
@pytest.mark.parametrize("direction", ["forward", "reverse"])
def test_a_coasting_machine_slows_down_by_c_g_whatever_its_mass(load_kg, direction):
    made = drive(
        load_kg,
        rolling={"coefficient": 0.02},
        machine=SMOOTH,
        campaign=start(direction=direction, **COAST),
    )
    # the valve has closed
    run = made.sample_channels(np.arange(6.0, 6.5, 0.01))
    np.testing.assert_allclose(np.abs(run.acc_x_m_s2), 0.02 * G, rtol=1e-6)
    assert (run.acc_x_m_s2 * run.speed_x_m_s < 0.0).all()


@pytest.mark.parametrize(
    "sections",
    [
        pytest.param({}, id="level"),
        pytest.param({"terrain": {"slope_deg": 2.0}}, id="uphill"),
        pytest.param({"machine": {"coulomb_N": 150.0}, "terrain": {"slope_deg": -2.0}}, id="down"),
        pytest.param({"campaign": start(direction="reverse")}, id="reverse"),
        pytest.param(
            {
                "campaign": {
                    "manoeuvres": [
                        {
                            "kind": "excite",
                            "duration_s": 8.0,
                            "force": {"period_s": 4.0, "lowest_N": -3e3, "highest_N": 4e3},
                        }
                    ]
                }
            },
            id="stick and slip",
        ),
    ],
)
def test_plant_and_exact_solution_agree(sections):
    sections = {**sections, "rolling": {"coefficient": 0.03}}
    assert find_scenario_key_needing_integration(scenario(**sections)) is None
    made, exact = drive(500.0, **sections), solve_motion(scenario(**sections), 500.0)
    time_s = np.arange(0.0, exact.duration_s - 1e-3, 0.0037)
    run, truth = made.sample_channels(time_s), exact.sample_channels(time_s)
    np.testing.assert_allclose(run.speed_x_m_s, truth.speed_x_m_s, atol=1e-4)
    # within the step in which it moves off, forces are straight lines
    np.testing.assert_allclose(run.force_x_N, truth.force_x_N, atol=10.0)
    assert astuple(made.driven[-1].body) == pytest.approx(astuple(exact.body))


def test_a_machine_moves_off_when_the_drive_exceeds_the_share_of_its_weight():
    exact = solve_motion(scenario(rolling={"coefficient": 0.05}), 1000.0)
    time_s = np.arange(1.0, 1.5, 1e-4)
    run = exact.sample_channels(time_s)
    moves = np.flatnonzero(run.speed_x_m_s > 0.0)[0]
    assert run.force_x_N[moves] == pytest.approx(0.05 * (MASS_KG + 1000.0) * G, rel=0.01)


def test_it_holds_a_machine_on_a_slope_that_is_less_steep():
    wave = {"period_s": 2.0, "lowest_N": 0.0, "highest_N": 100.0}
    excite = {"kind": "excite", "duration_s": 2.0, "force": wave}
    made = drive(
        rolling={"coefficient": 0.04},
        terrain={"slope_deg": 2.0},
        campaign={"manoeuvres": [excite]},
    )
    assert (made.sample_channels(np.arange(0.0, 2.0, 0.01)).speed_x_m_s == 0.0).all()


def test_each_ground_along_the_way_resists_with_its_own_coefficient():
    made = drive(
        250.0,
        rolling={"coefficient": 0.01, "second_ground_more": 0.02, "ground_length_m": 3.0},
        campaign={"cruise_s": 6.0},
    )
    time_s = np.arange(1.5, 9.9, 0.002)
    run = made.sample_channels(time_s)
    position = np.interp(time_s, made.rows[:, 0], made.rows[:, 1])
    assert position[-1] > 9.0
    found = resistance(run, MASS_KG + 250.0) / ((MASS_KG + 250.0) * G)
    # a log begins with both axles on the first ground
    place = (position + 0.6) % 6.0
    np.testing.assert_allclose(found[(place > 0.7) & (place < 2.3)], 0.01, atol=1e-4)
    np.testing.assert_allclose(found[(place > 3.7) & (place < 5.3)], 0.03, atol=1e-4)
    # halfway over an edge half of the weight is on each
    np.testing.assert_allclose(found[np.abs(place - 3.0) < 0.01], 0.02, atol=4e-4)
    assert made.driven[-1].body.rolling_x_N == pytest.approx(0.01 * (MASS_KG + 250.0) * G)


def test_it_grows_with_speed_and_in_turns():
    made = drive(
        rolling={"coefficient": 0.02, "growth_s_m": 0.2, "growth_s_rad": 5.0},
        starts={"turn_rad_s": 0.04, "scrub_N_s_rad": 0.0},
    )
    run = made.sample_channels(np.arange(2.0, 5.9, 0.01))
    np.testing.assert_allclose(run.yaw_rate_rad_s, 0.04, rtol=1e-3)
    expected = 0.02 * MASS_KG * G * (1.0 + 0.2 * run.speed_x_m_s) * (1.0 + 5.0 * 0.04)
    np.testing.assert_allclose(resistance(run, MASS_KG), expected, atol=0.5)


def test_a_cruise_is_driven_with_what_keeps_the_speed_against_it():
    made = drive(500.0, rolling={"coefficient": 0.03, "growth_s_m": 0.1})
    reached, cruising = (
        made.sample_channels(np.array([4.0, 5.95])).speed_x_m_s,
        made.sample_channels(np.array([5.95])),
    )
    newtons = 0.03 * (MASS_KG + 500.0) * G * (1.0 + 0.1 * reached[0])
    assert cruising.force_x_N[0] == pytest.approx(FRICTION_N_S_M * reached[0] + newtons, abs=0.1)


def test_a_filling_bucket_adds_to_it_as_it_fills():
    made = drive(rolling={"coefficient": 0.03}, loading={"fill_kg_s": 100.0})
    run = made.sample_channels(np.arange(1.2, 5.9, 0.01))
    filling = 100.0 * run.speed_x_m_s
    np.testing.assert_allclose(
        resistance(run, run.mass_kg) - filling, 0.03 * run.mass_kg * G, atol=0.5
    )


def test_the_truth_of_a_log_names_it_for_every_run_and_manoeuvre():
    made = log(rolling={"coefficient": 0.02}, campaign={"loads_kg": [400], "runs": 2})
    newtons = 0.02 * (MASS_KG + 400.0) * G
    for truth in (made.trials, made.manoeuvres):
        assert truth["rolling_N"].to_list() == pytest.approx([newtons] * truth.height)
        assert truth["coulomb_N"].to_list() == [0.0] * truth.height


def test_in_a_shift_it_is_felt_in_both_directions_by_load_and_ground():
    made = Scenario.model_validate(
        {
            "shift": {"duration_h": 0.06},
            "rolling": {"coefficient": 0.02, "second_ground_more": 0.02, "ground_length_m": 20.0},
        }
    )
    assert made.shift is not None
    (whole,) = ShiftSimulation(made, made.shift).simulate_logs()
    fills = whole.manoeuvres.filter(pl.col("load_end_kg") > pl.col("load_kg") + 1.0)
    motion = whole.noise_free_motion
    digging = np.zeros(motion.height, np.bool_)
    for begin, end in fills.select("start_ns", "end_ns").iter_rows():
        digging |= motion["time_ns"].is_between(begin, end).to_numpy()
    speed, mass = motion["speed_x_m_s"].to_numpy(), motion["mass_kg"].to_numpy()
    assert whole.timeline.sample_position_boom_and_bucket is not None
    place = whole.timeline.sample_position_boom_and_bucket(motion["time_ns"].to_numpy()).position_m
    felt = motion["force_x_N"] - motion["mass_kg"] * motion["specific_force_x_m_s2"]
    coefficient = (felt.to_numpy() - FRICTION_N_S_M * speed) / (mass * G)
    for sign in (1.0, -1.0):
        for low, high, expected in ((0.0, 18.7, 0.02), (20.1, 38.7, 0.04)):
            here = (place > low) & (place < high) & (sign * speed > 0.05) & ~digging
            assert here.sum() > 100
            np.testing.assert_allclose(sign * coefficient[here], expected, atol=1e-4)


@pytest.mark.parametrize("second_ground_more", [0.0, 0.1])
def test_a_ground_too_heavy_to_start_on_is_refused(second_ground_more):
    from analysis.simulation import simulate_campaign
    from estimators.errors import ScenarioError

    coefficient = 0.2 - second_ground_more
    rolling = {"coefficient": coefficient, "second_ground_more": second_ground_more}
    with pytest.raises(ScenarioError, match="slope and friction resist 3614 kg with 7088 N"):
        simulate_campaign(scenario(rolling=rolling))


def test_a_second_ground_that_drives_is_refused():
    with pytest.raises(ValueError, match="second ground's coefficient negative"):
        scenario(rolling={"coefficient": 0.01, "second_ground_more": -0.02})
