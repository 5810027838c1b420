"""Load states of whole logs: masses, payloads, and what is said of them."""

import re
from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from analysis.simulation import Scenario, simulate_campaign
from analysis.weighing import joint_fit
from analysis.weighing.empty_states import estimate_std_of_empty_masses_kg
from analysis.weighing.load_changes import classify_load_change_evidence
from analysis.weighing.load_states import AlternativePartition, LoadStates, find_load_states
from analysis.weighing.weigh import weigh
from analysis.weighing.weighing_limits import LIMITS
from benchmarks.honesty_rows import LOADER, Task, row_log
from benchmarks.load_states import ONE_LOAD, whole_states
from benchmarks.weighed import machine
from estimators.errors import MachineError
from estimators.joint.unit_levels import DUMPED, FILLED, HINTED, NAMED, UnitLevels
from replay.inputs.derived_logs import MemoryLog, copy_machine_with_simulated_channels
from replay.pipeline import run
from tests.analysis.diagnosis.test_faults import situation
from tests.twins import mark_slow_after

#: The first two of four manoeuvres, and the others.
LEFT = np.array([1.0, 1.0, -1.0, -1.0])
POOLED = ('settings.trace.methods=["pooled"]',)


def logs_of(loads_kg, runs, seed=5):
    """A log a load, in one time line, with so many starts each."""
    made = []
    for place, count in enumerate(runs):
        campaign = {**LOADER["campaign"], "loads_kg": loads_kg, "runs": count}
        sections = {**LOADER, "campaign": campaign, "sensors": {"seed": seed}}
        made.append(list(simulate_campaign(Scenario.model_validate(sections)))[place])
    return made


def loaded(loads_kg, runs, overrides=POOLED, **body):
    """The loads' logs, as replayed."""
    each = [runs] * len(loads_kg) if isinstance(runs, int) else runs
    logs = logs_of(loads_kg, each)
    own = machine(overrides)
    share = Scenario.model_validate(LOADER).machine.force_share
    stated = {"empty_mass_kg": 3614.0, "force_share": share, **body}
    own = own.model_copy(update={"machine": own.machine.model_copy(update=stated)})
    return run([MemoryLog(log) for log in logs], copy_machine_with_simulated_channels(own, logs[0]))


@pytest.fixture(scope="module")
def two():
    return loaded([0.0, 250.0], 5)


class TestTwoLoads:
    @pytest.mark.heavy
    def test_each_has_a_mass_and_the_payload_is_their_difference(self, two):
        loads = two.frames["loads"]
        assert loads["manoeuvres"].to_list() == [5, 5]
        empty, full = loads.to_dicts()
        assert abs(empty["mass_kg"] - 3614.0) < 3.0 * empty["u_kg"]
        assert full["payload_kg"] == pytest.approx(full["mass_kg"] - empty["mass_kg"])
        assert abs(full["payload_kg"] - 250.0) < 3.0 * full["payload_u_kg"]
        # nearly all that is common cancels
        assert full["payload_u_kg"] < 9.0 < 20.0 < full["u_kg"]
        assert [row["payload_to"] for row in (empty, full)] == [0, 0]
        assert [row["empty"] for row in (empty, full)] == [True, False]
        assert empty["payload_kg"] == 0.0

    def test_a_states_time_is_that_of_its_manoeuvres(self, two):
        shown = two.frames["manoeuvres"]
        for load in two.frames["loads"].iter_rows(named=True):
            own = shown.filter(pl.col("load_id") == load["load_id"])
            assert own["start_t_ns"].min() == load["start_t_ns"]
            assert own["end_t_ns"].max() == load["end_t_ns"]
            # of short logs without the ground
            assert own["mass_kg"].mean() == pytest.approx(load["mass_kg"], abs=load["u_kg"] / 2.0)

    def test_no_method_has_one_mass_for_both(self, two):
        assert two.frames["masses"]["mass_kg"].null_count() == two.frames["masses"].height

    def test_the_budget_of_each_adds_up(self, two):
        for load in two.frames["loads"].iter_rows(named=True):
            own = two.frames["budget"].filter(pl.col("load_id") == load["load_id"])
            assert np.sqrt((own["u_kg"].drop_nulls() ** 2).sum()) == pytest.approx(load["u_kg"])


@pytest.mark.heavy
def test_every_empty_pass_counts_and_not_the_lightest_alone():
    loads = loaded([0.0, 400.0, 0.1, 500.0, 0.2], 3).frames["loads"]
    assert loads["empty"].to_list() == [True, False, True, False, True]
    payload, u = loads["payload_kg"].to_numpy(), loads["payload_u_kg"].to_numpy()
    assert abs(payload[[0, 2, 4]].sum()) < 1e-6
    assert (np.abs(payload - [0.0, 400.0, 0.0, 500.0, 0.0]) < 3.0 * u).all()


@pytest.mark.heavy
def test_the_empty_state_is_the_one_that_is_named():
    span = ("settings.loads.empty_from_s=0", "settings.loads.empty_to_s=60")
    replayed = loaded([0.0, 250.0], 5, (*POOLED, *span), empty_mass_kg=None)
    full = replayed.frames["loads"].row(1, named=True)
    assert full["payload_to"] == 0
    assert abs(full["payload_kg"] - 250.0) < 3.0 * full["payload_u_kg"]


@pytest.mark.heavy
def test_loads_that_are_as_near_as_the_mass_is_uncertain_are_not_taken_for_empty():
    loads = loaded([150.0, 250.0], 5).frames["loads"]
    assert loads["payload_to"].null_count() == 2
    # so payload is mass less empty mass, with the whole uncertainty
    assert (loads["payload_u_kg"] >= loads["u_kg"]).all()


@pytest.mark.heavy
def test_the_load_with_most_manoeuvres_may_be_the_last(monkeypatch):
    """The mean's length is chosen on the first stretches, which need not have that load."""
    monkeypatch.setattr(joint_fit, "LIMITS", replace(LIMITS, pilot_stretches=3))
    loads = loaded([0.0, 250.0], [3, 6]).frames["loads"]
    assert loads["manoeuvres"].to_list() == [3, 6]
    assert abs(loads["payload_kg"][1] - 250.0) < 3.0 * loads["payload_u_kg"][1]


@pytest.mark.heavy
def test_braking_is_compared_load_by_load():
    """Brakes that are seen whole agree with driving, whichever load has most manoeuvres."""
    settings = (*POOLED, "settings.gate.exclude_braking=false")
    seen = {"campaign": {**LOADER["campaign"], "brake_measured_share": 1.0}}
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(LOADER, "campaign", seen["campaign"])
        replayed = loaded([0.0, 250.0], [4, 6], settings)
    assert not replayed.frames["loads"]["braking_left_out"].any()
    judged = replayed.frames["verdict"]
    assert judged.filter(pl.col("check") == "braking_bias")["value"][0] < 0.02


@pytest.mark.parametrize(
    ("span", "fault"),
    [
        (("settings.loads.empty_from_s=3",), "must be given together"),
        (("settings.loads.empty_from_s=9", "settings.loads.empty_to_s=3"), "not before"),
    ],
)
def test_a_stretch_of_emptiness_has_two_ends(span, fault):
    with pytest.raises(MachineError, match=fault):
        machine(span)


@pytest.mark.heavy
def test_an_empty_stretch_that_is_no_load_is_said():
    span = ("settings.loads.empty_from_s=9000", "settings.loads.empty_to_s=9999")
    loads = loaded([0.0, 250.0], 4, (*POOLED, *span)).frames["loads"]
    assert loads["payload_to"].null_count() == 2
    assert "select none of the loads" in loads["said"][0]


@pytest.mark.heavy
def test_a_log_without_a_fit_has_one_state_and_no_number():
    """Force that clips in every start determines nothing."""
    log = row_log(Task("row", "force clipped", "loader", 96_662_000))
    assert log.mass_kg is None
    assert log.reason


class TestRepeatability:
    @pytest.mark.heavy
    def test_one_start_a_load_is_told_apart_where_it_is_known(self):
        span = ("settings.loads.empty_from_s=0", "settings.loads.empty_to_s=12")
        loads = loaded([0.0, 250.0], 1, (*POOLED, *span), repeatability_kg=3.0).frames["loads"]
        assert loads.height == 2
        assert abs(loads["payload_kg"][1] - 250.0) < 3.0 * loads["payload_u_kg"][1]
        assert loads["payload_u_kg"][1] < 25.0
        assert loads["scatter_known"].all()

    @pytest.mark.heavy
    def test_where_it_is_not_known_that_is_said(self):
        load = loaded([0.0], 2).frames["loads"].row(0, named=True)
        assert not load["scatter_known"]
        assert "repeatability unknown" in load["said"]


def test_an_offset_in_alternating_directions_is_one_state():
    log = situation("force offset +300 N", rich=True)
    assert log.replayed.frames["loads"].height == 1


@pytest.mark.parametrize("name", [name for name in ONE_LOAD if "throttle" in name])
def test_throttles_that_differ_by_a_third_are_one_state(name):
    assert whole_states(name, 0) == (1, False)


@pytest.mark.heavy
@pytest.mark.parametrize("arm", mark_slow_after(1, ["boom_rad", "bucket_rad"]))
def test_an_arm_that_moves_between_single_starts_speaks_for_a_load_each(arm):
    """Of the same manoeuvres, with an angle that stays and one that differs from log to log."""
    frames = loaded([0.0, 250.0, 120.0, 370.0, 180.0], 1).frames
    aligned, rest = frames["aligned"], [frames[name] for name in ("excitation", "gate", "noise")]
    stands = np.diff(aligned["gap"].to_numpy().astype(int), prepend=0) > 0
    angle = np.cumsum(stands) % 2
    assert stands.sum() == 4
    probable = {}
    for raised_rad in (0.0, 1.0):
        hinted = aligned.with_columns(pl.Series(arm, raised_rad * angle))
        found = weigh(hinted, *rest, machine(POOLED))
        assert found is not None
        motion, states = found.fit.motion, found.fit.states
        assert classify_load_change_evidence(motion).tolist() == (
            [DUMPED, HINTED] * 2 if raised_rad else [1] * 4
        )
        assert states is not None
        probable[raised_rad] = states.single_probability
    # so few starts do not settle it: it then says "states or scatter"
    assert probable[1.0] < 0.5 < probable[0.0]


@pytest.mark.heavy
def test_no_load_changes_while_the_machine_is_named_as_empty():
    """Whatever the masses say."""
    frames = loaded([0.0, 250.0, 120.0, 370.0, 180.0], 1).frames
    aligned, rest = frames["aligned"], [frames[name] for name in ("excitation", "gate", "noise")]
    third = np.flatnonzero(np.diff(aligned["gap"].to_numpy().astype(int), prepend=0) > 0)[1]
    empty_to_s = aligned["t_ns"][int(third)] / 1e9
    named = (f"settings.loads.empty_to_s={empty_to_s}", "settings.loads.empty_from_s=0.0")
    found = weigh(aligned, *rest, machine((*POOLED, *named)))
    assert found is not None
    assert classify_load_change_evidence(found.fit.motion).tolist() == [0, NAMED, 1, 1]


def test_where_the_log_cannot_tell_the_uncertainty_covers_both_readings():
    """By the law of total variance: of each start's mass, and of the difference of two states."""
    other = AlternativePartition(
        np.array([0, 1, 0, 1]), np.array([-100.0, 100.0, -80.0, 120.0]), 5.0, 0.4
    )
    nothing = np.zeros(4)
    one = LoadStates(
        np.arange(4), np.zeros(4, np.int64), nothing, nothing, 0.0, 3.0, 1.0, 0.6, other
    )
    of_one = np.sqrt(0.4 * np.mean(other.mass_difference_kg**2))
    assert one.compute_mass_sum_std_by_alternative_partition_kg(np.ones(1)) == pytest.approx(of_one)
    # two states, which one load with a scatter may as well be
    two = replace(
        one,
        state_of_manoeuvre=np.array([0, 0, 1, 1]),
        alternative_partition=replace(other, mass_difference_kg=40.0 * LEFT),
    )
    assert two.compute_mass_sum_std_by_alternative_partition_kg(
        np.array([-1.0, 1.0])
    ) == pytest.approx(np.sqrt(0.4) * 80.0)
    assert (
        replace(one, alternative_partition=None).compute_mass_sum_std_by_alternative_partition_kg(
            np.ones(1)
        )
        == 0.0
    )


@pytest.mark.heavy
def test_a_load_that_a_load_transfer_explains_as_well_is_said_with_both():
    """Empty forward and loaded in reverse: a share that changes with the acceleration is alike."""
    log = row_log(Task("row", "250 kg more at every second start", "drawn", 30932004))
    assert abs(log.deviations) < 3.0
    assert log.u_kg > 80.0


@pytest.mark.heavy
def test_a_load_that_comes_and_goes_is_never_one_narrow_mass():
    loads = situation("250 kg more at every second start").replayed.frames["loads"]
    for load in loads.iter_rows(named=True):
        if load["mass_kg"] is not None and load["manoeuvres"] > 1:
            assert load["u_kg"] > 30.0


def find_states(masses_kg: list[float], kind: int = 1, **stated: float) -> LoadStates:
    """States of manoeuvres with these masses, each known to 20 kg, and this kind of boundary."""
    units = UnitLevels(
        np.array(masses_kg),
        np.zeros((len(masses_kg), 0)),
        np.full(len(masses_kg), 400.0),
        np.zeros((0, 0)),
        np.zeros(0),
        np.full(len(masses_kg) - 1, kind, np.int64),
    )
    return find_load_states(units, np.arange(len(masses_kg)), stated.get("repeatability_kg"))


class TestScatterOfStates:
    #: Empty five times, then a load that changes by less than a tenth at nearly every stop.
    WANDERS_KG = (12000, 12010, 11990, 12005, 11995, 12800, 13500, 13490, 12600, 13050, 13700,
                  14500, 15500, 16200)  # fmt: skip

    def test_small_changes_that_the_masses_alone_show_leave_the_scatter_unknown(self):
        found = find_states([*map(float, self.WANDERS_KG)])
        assert found.state_count > 4
        assert found.assumes_scatter
        assert not found.is_scatter_estimated
        assert found.scatter_kg == pytest.approx(0.02 * np.median(self.WANDERS_KG))

    def test_a_filled_bucket_tells_them(self):
        found = find_states([*map(float, self.WANDERS_KG)], kind=FILLED)
        assert not found.assumes_scatter
        assert found.scatter_kg < 30.0

    def test_a_stated_repeatability_is_taken(self):
        found = find_states([*map(float, self.WANDERS_KG)], repeatability_kg=25.0)
        assert (found.scatter_kg, found.assumes_scatter) == (25.0, False)

    def test_an_empty_machine_that_comes_back_tells_it(self):
        found = find_states([12000.0, 15000.0, 12010.0, 15500.0, 11990.0, 16000.0, 12005.0] * 2)
        assert found.is_scatter_estimated
        assert found.scatter_kg < 30.0

    def test_one_small_change_takes_a_degree_of_freedom(self):
        found = find_states([12000.0] * 5 + [12700.0] * 5)
        assert (found.state_count, found.degrees_of_freedom) == (2, 7)


@pytest.mark.heavy
def test_empty_states_that_differ_widen_every_payload(two):
    """As if both of two loads were taken for empty."""
    stages = (two.frames[name] for name in ("aligned", "excitation", "gate", "noise"))
    weighing = weigh(*stages, machine(POOLED))
    assert weighing is not None
    std_kg = estimate_std_of_empty_masses_kg(weighing, [0, 1], machine(POOLED))
    assert std_kg == pytest.approx(np.ptp(weighing.fit.masses_kg) / np.sqrt(2.0), rel=0.02)
    assert estimate_std_of_empty_masses_kg(weighing, [0], machine(POOLED)) == 0.0


@pytest.fixture(scope="module")
def filling():
    """Five starts with one load, and a sixth in which the bucket fills by 200 kg a second."""
    logs = logs_of([0.0, 1.0], [5, 1])
    campaign = {**LOADER["campaign"], "loads_kg": [0.0, 1.0], "runs": 1}
    sections = {**LOADER, "campaign": campaign, "loading": {"fill_kg_s": 200.0}}
    logs[1] = list(simulate_campaign(Scenario.model_validate(sections)))[1]
    return run(
        [MemoryLog(log) for log in logs],
        copy_machine_with_simulated_channels(machine(POOLED), logs[0]),
    )


class TestALoadThatChangesUnderWay:
    @pytest.mark.heavy
    def test_the_manoeuvre_is_named_with_what_it_gained(self, filling):
        (said,) = filling.frames["loads"]["said"]
        found = re.search(r"within the manoeuvre at 141.0 s, by about \+([\d,]+) ± (\d+) kg", said)
        assert found, said
        # it drives for 4.8 s
        gained_kg, std_kg = (float(text.replace(",", "")) for text in found.groups())
        assert abs(gained_kg - 960.0) < 3.0 * std_kg

    def test_it_is_left_out_of_what_the_others_say(self, filling):
        load = filling.frames["loads"].row(0, named=True)
        assert load["manoeuvres"] == 5
        assert abs(load["mass_kg"] - 3614.0) < 2.0 * load["u_kg"] < 200.0

    @pytest.mark.heavy
    def test_loads_that_change_standing_are_no_such_thing(self, two):
        assert "within" not in "".join(two.frames["loads"]["said"])
