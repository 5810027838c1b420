"""Manoeuvres that say no mass: states are found, or none is told, and nothing is divided by it."""

import numpy as np
import pytest

from analysis.weighing.load_states import find_load_states
from estimators.joint.unit_levels import UnitLevels, estimate_unit_levels


def units(*levels_kg: float, std_kg: float = 1.0) -> UnitLevels:
    """Manoeuvres that say these masses and share nothing."""
    n = len(levels_kg)
    shared, kind = np.zeros((n, 0)), np.ones(n - 1, np.int64)
    variance = np.full(n, std_kg**2)
    return UnitLevels(np.array(levels_kg), shared, variance, np.zeros((0, 0)), np.zeros(0), kind)


@pytest.mark.parametrize("repeatability_kg", [None, 2.0])
def test_manoeuvres_of_0_0_and_99_kg_have_states(repeatability_kg: float | None) -> None:
    found = find_load_states(units(0.0, 0.0, 99.0), np.arange(3), repeatability_kg)
    assert found.state_of_manoeuvre.size == 3
    assert np.isfinite(found.manoeuvre_mass_kg).all()
    assert found.state_of_manoeuvre[0] == found.state_of_manoeuvre[1]


@pytest.mark.parametrize("levels_kg", [(0.0,), (0.0, 0.0, 0.0), (-1e-12, 0.0, 1e-12)])
def test_manoeuvres_of_no_mass_are_one_state(levels_kg: tuple[float, ...]) -> None:
    found = find_load_states(units(*levels_kg), np.arange(len(levels_kg)), None)
    assert found.state_count == 1


def test_a_mass_far_above_its_noise_is_split_as_before() -> None:
    found = find_load_states(units(100.0, 100.5, 130.0, 129.5), np.arange(4), None)
    assert found.state_of_manoeuvre.tolist() == [0, 0, 1, 1]


def test_a_unit_that_never_accelerates_tells_no_level() -> None:
    A = np.column_stack([np.repeat([1.0, 0.0], 50), np.linspace(1.0, 2.0, 100)])
    group = np.repeat([0, 1], 50)
    of_each = estimate_unit_levels(
        A, A.sum(axis=1), group, None, np.zeros(1), np.full(1, np.inf), group[::50]
    )
    assert np.isnan(of_each.y).all()
    assert find_load_states(of_each, np.arange(2), None).state_count == 1
