"""Load states of whole logs: masses, payloads, and what is said of them."""

import numpy as np
import polars as pl
import pytest

from analysis.simulation import Scenario, simulate_campaign
from benchmarks.honesty_rows import LOADER
from benchmarks.weighed import machine
from replay.memory_log import MemoryLog, reading_memory
from replay.pipeline import run
from tests.analysis.diagnosis.test_faults import situation

POOLED = ('settings.trace.methods=["pooled"]',)


def loaded(loads_kg, runs, overrides=POOLED, seed=5, **body):
    """The loads' logs in one time line, as replayed."""
    campaign = {**LOADER["campaign"], "loads_kg": loads_kg, "runs": runs}
    scenario = Scenario.model_validate({**LOADER, "campaign": campaign, "sensors": {"seed": seed}})
    logs = list(simulate_campaign(scenario))
    own = machine(overrides)
    stated = {"empty_mass_kg": 3614.0, "force_share": scenario.machine.force_share, **body}
    own = own.model_copy(update={"machine": own.machine.model_copy(update=stated)})
    return run([MemoryLog(log) for log in logs], reading_memory(own, logs[0]))


@pytest.fixture(scope="module")
def two():
    return loaded([0.0, 250.0], 5)


class TestTwoLoads:
    def test_each_has_a_mass_and_the_payload_is_their_difference(self, two):
        loads = two.frames["loads"]
        assert loads["manoeuvres"].to_list() == [5, 5]
        empty, full = loads.to_dicts()
        assert abs(empty["mass_kg"] - 3614.0) < 3.0 * empty["u_kg"]
        assert full["payload_kg"] == pytest.approx(full["mass_kg"] - empty["mass_kg"])
        assert abs(full["payload_kg"] - 250.0) < 3.0 * full["payload_u_kg"]
        # nearly all that is common cancels
        assert full["payload_u_kg"] < 6.0 < 20.0 < full["u_kg"]
        assert [row["payload_to"] for row in (empty, full)] == [None, 0]
        assert empty["payload_kg"] == 0.0

    def test_a_states_time_is_that_of_its_manoeuvres(self, two):
        shown = two.frames["manoeuvres"]
        for load in two.frames["loads"].iter_rows(named=True):
            own = shown.filter(pl.col("load_id") == load["load_id"])
            assert own["start_t_ns"].min() == load["start_t_ns"]
            assert own["end_t_ns"].max() == load["end_t_ns"]
            assert own["mass_kg"].mean() == pytest.approx(load["mass_kg"], abs=3.0)

    def test_no_method_has_one_mass_for_both(self, two):
        assert two.frames["masses"]["mass_kg"].null_count() == two.frames["masses"].height

    def test_the_budget_of_each_adds_up(self, two):
        for load in two.frames["loads"].iter_rows(named=True):
            own = two.frames["budget"].filter(pl.col("load_id") == load["load_id"])
            assert np.sqrt((own["u_kg"].drop_nulls() ** 2).sum()) == pytest.approx(load["u_kg"])


def test_the_empty_state_is_the_one_that_is_named():
    span = ("settings.loads.empty_from_s=0", "settings.loads.empty_to_s=60")
    replayed = loaded([0.0, 250.0], 5, (*POOLED, *span), empty_mass_kg=None)
    full = replayed.frames["loads"].row(1, named=True)
    assert full["payload_to"] == 0
    assert abs(full["payload_kg"] - 250.0) < 3.0 * full["payload_u_kg"]


def test_loads_that_are_as_near_as_the_mass_is_uncertain_are_not_taken_for_empty():
    loads = loaded([150.0, 250.0], 5).frames["loads"]
    assert loads["payload_to"].null_count() == 2
    # so payload is mass less empty mass, with the whole uncertainty
    assert (loads["payload_u_kg"] >= loads["u_kg"]).all()


class TestRepeatability:
    def test_one_start_a_load_is_told_apart_where_it_is_known(self):
        span = ("settings.loads.empty_from_s=0", "settings.loads.empty_to_s=12")
        loads = loaded([0.0, 250.0], 1, (*POOLED, *span), repeatability_kg=3.0).frames["loads"]
        assert loads.height == 2
        assert abs(loads["payload_kg"][1] - 250.0) < 3.0 * loads["payload_u_kg"][1]
        assert loads["payload_u_kg"][1] < 15.0
        assert loads["scatter_known"].all()

    def test_where_it_is_not_known_that_is_said(self):
        load = loaded([0.0], 2).frames["loads"].row(0, named=True)
        assert not load["scatter_known"]
        assert "repeatability unknown" in load["said"]


def test_an_offset_in_alternating_directions_is_one_state():
    log = situation("force offset +300 N", rich=True)
    assert log.replayed.frames["loads"].height == 1


def test_a_load_that_comes_and_goes_is_never_one_narrow_mass():
    loads = situation("250 kg more at every second start").replayed.frames["loads"]
    for load in loads.iter_rows(named=True):
        if load["mass_kg"] is not None and load["manoeuvres"] > 1:
            assert load["u_kg"] > 30.0
