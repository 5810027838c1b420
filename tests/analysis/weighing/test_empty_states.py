"""Which states count as empty, beside a stated mass and an error that all have in common."""

import numpy as np
import pytest

from analysis.weighing.empty_states import compute_largest_excess_of_empty_state_kg


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
