"""A gain that falls over a shift shows in the empty machine's mass, which falls with it."""

from dataclasses import replace
from functools import cache

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.cycles.load_passes import find_load_passes
from analysis.weighing.empty_mass_drift import (
    EmptyMassDrift,
    estimate_empty_mass_drift,
    mark_local_mass_minima,
)
from tests.analysis.weighing.weighed import RICH, Weighed, merged, weighed
from tests.twins import mark_slow_after

CHANGE_KG = 900.0
SHIFT = merged(
    RICH,
    {"campaign": {"runs": 24}, "loading": {"change_kg": CHANGE_KG, "alternating": True}},
)


@cache
def shift(drift_1: float) -> Weighed:
    return weighed(merged(SHIFT, {"defects": {"force_gain_drift": drift_1}}))


@pytest.mark.heavy
@pytest.mark.parametrize("drift_1", mark_slow_after(1, [-0.08, 0.08]))
def test_a_gain_that_drifts_is_found_named_and_in_the_budget(drift_1: float) -> None:
    log = shift(drift_1)
    drift = estimate_empty_mass_drift(log.weighing.fit)
    assert drift is not None
    assert drift.is_significant
    # between the means of the first and the last third
    assert drift.change_1 == pytest.approx(drift_1 * 2.0 / 3.0, abs=0.02)
    assert "gain_drift" in log.replayed.frames["findings"]["cause"]
    assert (log.causes["drifted_gain"] or 0.0) > 0.5 * abs(drift.change_1) * log.true_kg


@pytest.mark.heavy
@pytest.mark.parametrize("drift_1", mark_slow_after(1, [-0.08, 0.08]))
def test_payloads_under_a_drifting_gain_are_differences_to_the_empty_machine_nearby(
    drift_1: float,
) -> None:
    loads = shift(drift_1).replayed.frames["loads"]
    carried = loads.filter(~pl.col("empty"))
    off_kg = (carried["payload_kg"] - CHANGE_KG).to_numpy()
    assert np.abs(off_kg / carried["payload_u_kg"].to_numpy()).max() < 2.0
    # those to the mean of all empty states are off by more than half of the drift at the ends
    assert np.abs(off_kg).max() < 0.5 * abs(drift_1) * shift(drift_1).true_kg
    assert "empty states before and after" in loads["said"][0]


def test_an_error_of_the_gain_late_in_the_log_does_not_cancel_in_the_ratio_to_the_mean() -> None:
    # empty, loaded, empty; and the same after the gain has fallen by 4 per cent
    masses_kg = np.array([1.02 * 4000.0, 1.02 * 5000.0, 0.98 * 4000.0, 0.98 * 5000.0])
    nearby_1 = np.array([[0.02, 0.02, -0.02, -0.02], [0.02, -0.02, -0.02, -0.02]])
    drift = EmptyMassDrift(-0.04, 0.001, 0.0, (0, 2), nearby_1)
    late = np.array([0.0, 0.0, -1.0, 1.0])
    ratio = late - (late @ masses_kg) / 4000.0 * np.array([0.5, 0.0, 0.5, 0.0])
    stated, course, _ = drift.compute_mass_responses_kg(masses_kg) @ ratio
    assert stated == pytest.approx(0.0, abs=1e-9)
    assert course == pytest.approx(-0.02 * 980.0, rel=0.05)
    # a load between the two may have either gain
    between = np.array([-0.5, 1.0, -0.5, 0.0])
    assert abs((drift.compute_mass_responses_kg(masses_kg) @ between)[2]) > 0.02 * 4000.0


def test_small_loads_are_told_from_an_empty_machine_whose_mass_drifts() -> None:
    empty_1 = np.array([1.025, 1.025, 1.025, 1.025, 0.975, 0.975, 0.975, 0.975, 0.975])
    mass_kg = 4000.0 * empty_1
    mass_kg[1::2] += np.array([1500.0, 1400.0, 500.0, 1200.0]) * empty_1[1::2]
    start_ns = np.arange(9) * 60 * 10**9
    manoeuvres = pl.DataFrame(
        {
            "load_id": np.arange(9),
            "start_t_ns": start_ns,
            "end_t_ns": start_ns + 30 * 10**9,
            "mass_kg": mass_kg,
            "mass_std_kg": np.full(9, 5.0),
        }
    )
    digs = pl.DataFrame(schema={"start_t_ns": pl.Int64, "end_t_ns": pl.Int64})
    loads = pl.DataFrame({"scatter_kg": [0.0]})
    found = find_load_passes(loads, manoeuvres, digs, drift_1=empty_1 / empty_1.mean() - 1.0)
    assert found is not None
    assert found.loaded.tolist() == [k % 2 == 1 for k in range(9)]
    empty_kg = found.drift_corrected_masses_kg[~found.loaded]
    assert np.ptp(empty_kg) < 1.0


@pytest.mark.heavy
def test_a_gain_that_stays_is_no_finding() -> None:
    log = shift(0.0)
    drift = estimate_empty_mass_drift(log.weighing.fit)
    assert drift is not None
    assert not drift.is_significant
    assert "gain_drift" not in log.replayed.frames["findings"]["cause"]
    assert not log.causes.get("drifted_gain")


def test_one_load_has_no_empty_machine_to_compare() -> None:
    assert estimate_empty_mass_drift(weighed(RICH).weighing.fit) is None


@pytest.mark.heavy
def test_masses_below_0_are_a_failed_fit_and_no_drift() -> None:
    fit = shift(0.0).weighing.fit
    theta = fit.theta.copy()
    theta[: fit.mass_count] -= 2.0 * fit.masses_kg.max()
    failed = replace(fit, theta=theta)
    assert failed.masses_kg.max() < 0.0
    assert estimate_empty_mass_drift(failed) is None


def test_a_small_load_is_not_empty_where_those_beside_it_are_lighter() -> None:
    empty_kg, small_kg, large_kg = 4200.0, 4700.0, 5800.0
    mass_kg = np.repeat([empty_kg, large_kg, empty_kg, small_kg, empty_kg], [3, 2, 4, 2, 1])
    assert mass_kg[mark_local_mass_minima(mass_kg)].tolist() == [empty_kg] * 8


@given(st.lists(st.sampled_from([1.0, 2.0, 3.0]), min_size=1, max_size=30))
def test_the_lightest_load_of_a_log_is_always_lightest_nearby(masses_kg: list[float]) -> None:
    mass_kg = np.array(masses_kg)
    assert mark_local_mass_minima(mass_kg)[mass_kg == mass_kg.min()].all()
