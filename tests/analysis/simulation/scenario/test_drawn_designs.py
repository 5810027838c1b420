"""Machines that are drawn, and the ground and habits of the field laid over them."""

import numpy as np
import pytest

from analysis.simulation import Scenario, simulate_campaign
from benchmarks.shift_logs import drawn_shift
from estimators.errors import ScenarioError
from tests.trials.drawn_designs import draw_design, with_field_physics

SEEDS = range(200)


def physics(seed):
    return Scenario.model_validate(with_field_physics(draw_design(seed), seed))


def test_field_physics_leaves_the_design_as_it_was_drawn():
    for seed in SEEDS:
        design = draw_design(seed)
        laid = with_field_physics(design, seed + 1)
        assert draw_design(seed) == design
        for name, keys in design.items():
            assert {key: laid[name][key] for key in keys} == keys


def test_field_physics_is_of_its_seed_alone():
    one, other = draw_design(1), draw_design(2)
    laid = [with_field_physics(design, 7) for design in (one, other, one)]
    assert laid[0] == laid[2]
    assert laid[0]["sensors"]["acc_bias_m_s2"] == laid[1]["sensors"]["acc_bias_m_s2"]
    assert laid[0]["sensors"] != with_field_physics(one, 8)["sensors"]


def test_field_physics_spans_what_the_field_has():
    made = [physics(seed) for seed in SEEDS]
    rolling = np.array([each.rolling.coefficient for each in made])
    assert 0.005 <= rolling.min() < 0.008
    assert 0.03 < rolling.max() <= 0.04
    bias = np.array([each.sensors.acc_bias_m_s2 for each in made])
    assert 0.09 < abs(bias).max() <= 0.1
    assert 0.9 < max(abs(each.defects.acc_tilt_deg) for each in made) <= 1.0
    assert 0.2 < max(each.machine.friction_warming for each in made) <= 0.25
    gentle = np.array([each.brakes.gentle_m_s2 for each in made])
    assert 0.35 < (gentle > 0.0).mean() < 0.65
    assert 0.05 <= gentle[gentle > 0.0].min() <= gentle.max() <= 0.3
    full_kg = 0.25 * np.array([each.machine.mass_kg for each in made])
    sag_deg = np.array([each.chassis.pitch_deg_kg for each in made]) * full_kg
    assert -0.7 <= sag_deg.min() < -0.6
    assert 0.2 < sag_deg.max() <= 0.3


@pytest.mark.heavy
def test_nearly_all_machines_start_on_the_ground_that_is_drawn_for_them():
    driven = 0
    for seed in range(20):
        try:
            next(simulate_campaign(physics(seed)))
            driven += 1
        except ScenarioError:
            continue
    assert driven >= 18


def test_a_shift_is_drawn_on_real_ground_only_if_asked_for():
    plain, _ = drawn_shift(3)
    assert plain.rolling.coefficient == plain.brakes.gentle_m_s2 == 0.0
    laid = [drawn_shift(seed, physics=True)[0] for seed in range(30)]
    assert all(each.rolling.coefficient > 0.0 for each in laid)
    losing = [each.shift for each in laid if each.shift is not None]
    assert any(each.spill_1_s for each in losing)
    assert any(each.pour_cycles for each in losing)
