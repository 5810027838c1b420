"""A load that grows at every start: it is told by what it does to a mass, not by a long log."""

import numpy as np
import pytest

from analysis.weighing.growing_load import (
    LoadGrowthAtEveryStart,
    list_coefficients_of_mean_payloads,
)
from analysis.weighing.mass_budget import list_uncertainty_by_failed_checks_kg
from tests.analysis.weighing.weighed import RICH, weighed

#: A bucket that takes up 25 to 250 kg at every start, driven both ways.
FILLS_KG_S = (20.0, 50.0)


@pytest.mark.heavy
@pytest.mark.parametrize("fill_kg_s", FILLS_KG_S)
def test_a_bucket_that_fills_moves_the_mass_and_is_evidence_in_full(fill_kg_s: float) -> None:
    fills = {"loading": {"fill_kg_s": fill_kg_s}, "starts": {"directions": "alternating"}}
    filling = weighed(fills).weighing.filling
    assert filling.largest_mass_change_over_u > 1.0
    assert filling.load_growth_over_std == filling.deviations


def test_a_clean_log_has_no_evidence_of_one() -> None:
    assert weighed(RICH).weighing.filling.load_growth_over_std < 1.0


def test_what_a_long_log_tells_of_a_growth_that_moves_no_mass_is_no_evidence() -> None:
    """Two half hours of a clean shift have three deviations together, for 5 kg under ± 25 kg."""
    assert LoadGrowthAtEveryStart(2.6, 3.25, 0.9).load_growth_over_std == 0.0
    assert LoadGrowthAtEveryStart(2.6, 3.25, 1.1).load_growth_over_std == 3.25
    for unknown in (
        LoadGrowthAtEveryStart(0.0, float("nan")),
        LoadGrowthAtEveryStart(2.6, 3.25, float("nan")),
    ):
        assert np.isnan(unknown.load_growth_over_std)


@pytest.mark.heavy
def test_where_nothing_fills_the_machine_a_growth_is_in_the_uncertainty() -> None:
    """A late force or a changing efficiency looks alike: the mass without the growth is within."""
    fills = {"loading": {"fill_kg_s": FILLS_KG_S[1]}, "starts": {"directions": "alternating"}}
    digs = weighed(fills).weighing
    shift, one = weighed(fills, "machine.digs=false").weighing, np.ones(1)
    assert shift.filling.load_growth_over_std == 0.0
    (effect_kg,) = np.abs(np.atleast_1d(shift.filling.significant_mass_changes_kg))
    assert effect_kg > 0.0
    widened = list_uncertainty_by_failed_checks_kg(shift, one, shift.fit.compute_u_by_cause_kg(one))
    assert widened["growth"] >= effect_kg * (1.0 - 1e-9)
    assert not np.any(digs.filling.significant_mass_changes_kg)


@pytest.mark.heavy
def test_a_growth_is_judged_by_the_payload_as_well_whose_uncertainty_is_smaller() -> None:
    """Ten starts without and with a load that all fill: the masses of both have common causes."""
    fills = {"loading": {"fill_kg_s": FILLS_KG_S[0]}, "campaign": {"loads_kg": (0.0, 400.0)}}
    shift = weighed(fills | {"starts": {"directions": "alternating"}}).weighing
    (weights,) = list_coefficients_of_mean_payloads(shift.fit)
    assert weights.sum() == pytest.approx(0.0, abs=1e-12)
    payload_kg = float(weights @ shift.fit.masses_kg)
    assert payload_kg == pytest.approx(400.0, abs=60.0)
    assert shift.fit.compute_mass_sum_u_kg(weights) < shift.fit.u_kg
