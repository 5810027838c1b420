"""Friction that falls as the machine warms: exponentially, from a log's beginning on."""

import numpy as np
import pytest

from analysis.simulation import Scenario, simulate_campaign
from analysis.simulation.logs.shift_logs import ShiftSimulation
from estimators.errors import ScenarioError
from tests.analysis.simulation.quiet import FRICTION_N_S_M, MASS_KG, drive, log, scenario

WARMING = {"friction_warming": 0.25, "warming_s": 20.0}


def left(share, time_s, warming_s=20.0):
    return 1.0 - share * (1.0 - np.exp(-np.asarray(time_s) / warming_s))


def test_viscous_friction_falls_by_its_share_with_its_time_constant():
    made = drive(machine=WARMING, campaign={"runs": 6})
    time_s = np.arange(0.0, made.trial_s[-1], 0.01)
    run = made.sample_channels(time_s)
    moving = run.speed_x_m_s > 0.5
    friction = (run.force_x_N - MASS_KG * run.acc_x_m_s2)[moving] / run.speed_x_m_s[moving]
    np.testing.assert_allclose(friction, FRICTION_N_S_M * left(0.25, time_s[moving]), rtol=1e-3)


def test_coulomb_friction_falls_likewise():
    machine = {"coulomb_N": 400.0, "coulomb_warming": 0.5, "warming_s": 20.0}
    made = drive(machine={**machine, "friction_N_s_m": 0.0}, campaign={"runs": 3, "start_s": 1.0})
    time_s = np.arange(0.0, made.trial_s[-1], 0.01)
    run = made.sample_channels(time_s)
    moving = run.speed_x_m_s > 0.1
    found = (run.force_x_N - MASS_KG * run.acc_x_m_s2)[moving]
    np.testing.assert_allclose(found, 400.0 * left(0.5, time_s[moving]), atol=0.5)


def test_a_cruise_is_driven_with_the_friction_that_is_left():
    made = drive(machine=WARMING, campaign={"standstill_s": 60.0, "start_s": 8.0})
    start = made.driven[-1].times
    run = made.sample_channels(np.array([start.braking_s - 0.1]))
    assert run.acc_x_m_s2[0] == pytest.approx(0.0, abs=0.01)


def test_the_truth_names_the_friction_of_every_run_and_manoeuvre():
    made = log(
        machine={**WARMING, "coulomb_N": 100.0, "coulomb_warming": 0.1}, campaign={"runs": 4}
    )
    begin_ns = made.timeline.start_ns
    for truth in (made.trials, made.manoeuvres.filter(kind="start")):
        since = "throttle_ns" if "throttle_ns" in truth.columns else "drive_ns"
        time_s = (truth[since] - begin_ns).to_numpy() * 1e-9
        np.testing.assert_allclose(truth["friction_N_s_m"], FRICTION_N_S_M * left(0.25, time_s))
        np.testing.assert_allclose(truth["coulomb_N"], 100.0 * left(0.1, time_s))


def test_a_shift_stays_warm_from_log_to_log():
    made = Scenario.model_validate(
        {
            "machine": {"friction_warming": 0.2, "warming_s": 60.0},
            "shift": {"duration_h": 0.1, "logs": 2, "restart_s": 1.0},
        }
    )
    assert made.shift is not None
    first, second = ShiftSimulation(made, made.shift).simulate_logs()
    assert first.manoeuvres["friction_N_s_m"][0] == FRICTION_N_S_M
    warm = second.manoeuvres["friction_N_s_m"][-1]
    assert warm == pytest.approx(0.8 * FRICTION_N_S_M, rel=5e-3)


def test_a_spin_of_a_machine_that_warms_is_refused():
    made = scenario(machine=WARMING, campaign={"manoeuvres": [{"kind": "spin"}]})
    with pytest.raises(ScenarioError, match=r"with machine\.friction_warming;"):
        simulate_campaign(made)
