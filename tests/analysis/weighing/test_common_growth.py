"""What a model misses grows with the load: starts with the largest do not lose a part of it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.weighing.growing_load import estimate_load_growth_common_to_mass_kg

EMPTY_KG, LOADED_KG = 330.0, 890.0


@settings(deadline=None)
@given(st.floats(-0.5, 0.5), st.integers(0, 43), st.floats(50.0, 500.0))
def test_a_growth_in_proportion_to_the_mass_is_common_and_one_beside_it_is_not(
    slope: float, place: int, grown_kg: float
) -> None:
    masses_kg = np.repeat([EMPTY_KG, 500.0, 600.0, 700.0, LOADED_KG], [20, 9, 5, 5, 5])
    growth_kg = slope * masses_kg
    growth_kg[place] += grown_kg
    left_kg = growth_kg - estimate_load_growth_common_to_mass_kg(masses_kg, growth_kg)
    assert left_kg[place] == pytest.approx(grown_kg, rel=0.05)
    assert np.abs(np.delete(left_kg, place)).max() < 0.05 * grown_kg


def test_one_heavy_manoeuvre_does_not_say_what_is_common_to_heavy_ones() -> None:
    masses_kg = np.append(np.full(20, EMPTY_KG), LOADED_KG)
    growth_kg = np.append(np.zeros(20), 200.0)
    assert estimate_load_growth_common_to_mass_kg(masses_kg, growth_kg) == pytest.approx(0.0)


def test_loads_of_one_mass_have_the_median_in_common() -> None:
    growth_kg = np.array([1.0, 2.0, 30.0, 2.5, 1.5])
    assert estimate_load_growth_common_to_mass_kg(np.full(5, 400.0), growth_kg) == pytest.approx(
        2.0
    )
