"""Which states count as empty, beside a stated mass and an error that all have in common."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.weighing.empty_states import (
    compute_largest_excess_of_empty_state_kg,
    find_return_states,
)


@pytest.mark.parametrize("scale_error_kg", [0.0, 75.0, 150.0])
def test_a_scale_that_is_off_parts_no_empty_states(scale_error_kg: float) -> None:
    dice = np.random.default_rng(5)
    kept = 0
    for _ in range(200):
        excess_kg = np.sort(scale_error_kg + dice.normal(0.0, 20.0, 10))
        kept += all(
            each
            <= compute_largest_excess_of_empty_state_kg(
                float(np.mean(excess_kg[:n])), 20.0 / np.sqrt(n), 20.0, 50.0
            )
            for n, each in enumerate(excess_kg[1:], start=1)
        )
    assert kept > 180


def test_a_state_far_above_the_stated_mass_is_not_empty_however_much_masses_scatter() -> None:
    largest_kg = compute_largest_excess_of_empty_state_kg(0.0, 16_000.0, 22_500.0, 2_000.0)
    assert 60_000.0 < largest_kg < 84_000.0


@given(
    st.lists(st.floats(1000.0, 5000.0), min_size=3, max_size=12),
    st.lists(st.floats(-150.0, 150.0), min_size=13, max_size=13),
    st.booleans(),
)
def test_a_machine_is_empty_where_it_returns_after_each_load(
    payload_kg: list[float], off_kg: list[float], begins_loaded: bool
) -> None:
    masses_kg = [13_000.0 + off_kg[0]]
    for load_kg, empty_off_kg in zip(payload_kg, off_kg[1:], strict=False):
        masses_kg += [13_000.0 + load_kg, 13_000.0 + empty_off_kg]
    if begins_loaded:
        masses_kg = [15_000.0, *masses_kg]
    first = int(begins_loaded)
    found = find_return_states(np.array(masses_kg), np.repeat(np.arange(len(masses_kg)), 2))
    assert found == list(range(first, len(masses_kg), 2))


def test_a_state_that_recurs_is_one() -> None:
    assert find_return_states(np.array([13_000.0, 15_000.0]), np.array([0, 1, 0, 1, 0, 1, 0])) == [
        0
    ]


@given(st.lists(st.floats(13_000.0, 20_000.0), min_size=2, max_size=20, unique=True))
def test_loads_that_only_grow_or_only_shrink_tell_of_no_empty_machine(
    mass_kg: list[float],
) -> None:
    for masses_kg in (np.sort(mass_kg), np.sort(mass_kg)[::-1]):
        assert find_return_states(masses_kg, np.arange(len(mass_kg))) == []


def test_loads_any_of_which_may_be_the_lightest_tell_of_no_empty_machine() -> None:
    dice = np.random.default_rng(3)
    found = [find_return_states(dice.uniform(13e3, 18e3, 11), np.arange(11)) for _ in range(500)]
    assert sum(map(bool, found)) < 5
