"""A gain that falls over a shift shows in the empty machine's mass, which falls with it."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.weighing.empty_mass_drift import estimate_empty_mass_drift, is_lightest_nearby
from tests.analysis.weighing.weighed import RICH, Weighed, merged, weighed

SHIFT = merged(
    RICH,
    {"campaign": {"runs": 24}, "loading": {"change_kg": 900.0, "alternating": True}},
)


@cache
def shift(drift_1: float) -> Weighed:
    return weighed(merged(SHIFT, {"defects": {"force_gain_drift": drift_1}}))


@pytest.mark.parametrize("drift_1", [-0.08, 0.08])
def test_a_gain_that_drifts_is_found_named_and_in_the_budget(drift_1: float) -> None:
    log = shift(drift_1)
    drift = estimate_empty_mass_drift(log.weighing.fit)
    assert drift is not None
    assert drift.is_significant
    # between the means of the first and the last third
    assert drift.change_1 == pytest.approx(drift_1 * 2.0 / 3.0, abs=0.02)
    assert "gain_drift" in log.replayed.frames["findings"]["cause"]
    assert (log.causes["drifted_gain"] or 0.0) > 0.5 * abs(drift.change_1) * log.true_kg


def test_a_gain_that_stays_is_no_finding() -> None:
    log = shift(0.0)
    drift = estimate_empty_mass_drift(log.weighing.fit)
    assert drift is not None
    assert not drift.is_significant
    assert "gain_drift" not in log.replayed.frames["findings"]["cause"]
    assert not log.causes.get("drifted_gain")


def test_one_load_has_no_empty_machine_to_compare() -> None:
    assert estimate_empty_mass_drift(weighed(RICH).weighing.fit) is None


def test_a_small_load_is_not_empty_where_those_beside_it_are_lighter() -> None:
    empty_kg, small_kg, large_kg = 4200.0, 4700.0, 5800.0
    mass_kg = np.repeat([empty_kg, large_kg, empty_kg, small_kg, empty_kg], [3, 2, 4, 2, 1])
    assert mass_kg[is_lightest_nearby(mass_kg)].tolist() == [empty_kg] * 8


@given(st.lists(st.sampled_from([1.0, 2.0, 3.0]), min_size=1, max_size=30))
def test_the_lightest_load_of_a_log_is_always_lightest_nearby(masses_kg: list[float]) -> None:
    mass_kg = np.array(masses_kg)
    assert is_lightest_nearby(mass_kg)[mass_kg == mass_kg.min()].all()
