"""The mass against the empty machine's: a scale that is wrong has no other witness."""

from functools import cache

import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.diagnosis import add_check_of_invalidating_findings
from analysis.diagnosis.check_inputs import EmptyMassDifference
from analysis.model.machine import Machine
from analysis.simulation import Scenario, simulate_campaign
from replay import load_machine
from replay.inputs.derived_logs import MemoryLog, copy_machine_with_simulated_channels
from replay.pipeline import run
from tests.analysis.weighing.weighed import Weighed
from tests.twins import mark_heavy_after

TRUE_KG = 3614.0
SCALE_STATED = ("force_gain_u=0.01", "wheel_radius_u_m=0.002", "force_share_u=0.002")


@cache
def _logs(before_start: int):
    loading = {"change_kg": 0.3 * TRUE_KG, "change_before_start": before_start}
    return tuple(
        simulate_campaign(
            Scenario.model_validate(
                {
                    "machine": {"mass_kg": TRUE_KG},
                    "campaign": {"loads_kg": [0.0], "runs": 6},
                    **({"loading": loading} if before_start else {}),
                }
            )
        )
    )


@cache
def scaled(times: float, *body: str, before_start: int = 0) -> Weighed:
    """A log whose torques are multiplied, with more keys of the machine's body."""
    (log,) = _logs(before_start)
    torque = log.topics["torque"].with_columns(pl.col("^torque.*$") * times)
    log = type(log)(**{**vars(log), "topics": {**log.topics, "torque": torque}})
    overrides = ['settings.trace.methods=["pooled"]', *(f"machine.{key}" for key in body)]
    machine: Machine = load_machine("cat262c.toml", overrides)
    return Weighed(
        run([MemoryLog(log)], copy_machine_with_simulated_channels(machine, log)), TRUE_KG, machine
    )


def first(log: Weighed) -> dict[str, object]:
    return log.replayed.frames["findings"].row(0, named=True)


@pytest.mark.heavy
@pytest.mark.parametrize("times", mark_heavy_after(1, [1 / 3.9, 0.5, 0.65]))
def test_a_mass_far_below_the_empty_machine_is_withheld_as_a_negative_payload(times):
    log = scaled(times)
    assert log.load["mass_kg"] is None
    assert log.check("negative_payload").value > 3.0
    assert first(log)["cause"] in ("wrong_scale", "wrong_unit")


@pytest.mark.parametrize(
    ("ratio", "cause"),
    [
        (0.45359237, "lb instead of kg"),
        (0.90718474, "short tons instead of tonnes"),
        (1.609344, "mile/h instead of km/h"),
        (0.44704, "mile/h instead of m/s"),
    ],
)
@given(bent=st.floats(0.96, 1.04), reversed_=st.booleans())
def test_units_of_tickets_and_speeds_are_candidates(ratio, cause, bent, reversed_):
    mass_kg = 5000.0 * (1.0 / ratio if reversed_ else ratio) * bent
    difference = EmptyMassDifference(
        mass_kg, 5000.0, 50.0, True, True, load_machine("cat262c.toml")
    )
    assert any(cause in each for each in difference.possible_causes)


def test_a_small_difference_is_of_no_unit():
    machine = load_machine("cat262c.toml")
    assert len(EmptyMassDifference(5200.0, 5000.0, 50.0, True, True, machine).possible_causes) == 1


@pytest.mark.heavy
@pytest.mark.parametrize("times", mark_heavy_after(1, [1.5, 2.7, 3.6]))
def test_a_mass_far_above_it_is_told_with_the_factor_and_its_candidates(times):
    log = scaled(times)
    remark = log.check("empty_mass")
    assert log.load["mass_kg"] is not None
    assert (remark.passed, remark.consequence) == (False, "tell")
    assert "10 % for the scale, whose uncertainty the machine file does not state" in remark.meaning
    assert f"a gear or gain of {times:g}"[:20] in remark.meaning
    assert ("km/h instead of m/s" in remark.meaning) == (times == 3.6)
    assert first(log)["cause"] == "wrong_scale"


def test_a_little_below_it_is_told_and_no_finding():
    log = scaled(0.85)
    assert log.load["mass_kg"] is not None
    assert log.check("empty_mass").passed is False
    assert log.check("negative_payload").passed is True
    assert log.replayed.frames["findings"].is_empty()


def test_what_may_be_a_payload_is_not_judged():
    log = scaled(1.3)
    assert log.check("empty_mass").passed is None
    assert log.fired == set()


@pytest.mark.heavy
def test_a_stated_scale_is_judged_by_itself():
    log = scaled(0.9, *SCALE_STATED)
    assert log.load["mass_kg"] is None
    assert "does not state" not in log.check("negative_payload").meaning
    assert scaled(1.0, *SCALE_STATED).check("negative_payload").passed is True


@pytest.mark.heavy
def test_an_empty_state_tells_of_a_factor_that_one_load_does_not():
    log = scaled(1.3, before_start=3)
    assert log.check("empty_mass").passed is False
    assert scaled(1.0, before_start=3).check("empty_mass").passed is True


@pytest.mark.heavy
def test_without_an_empty_mass_nothing_is_judged():
    (log,) = _logs(0)
    machine = load_machine("cat262c.toml", ['settings.trace.methods=["pooled"]'])
    body = machine.machine.model_copy(update={"empty_mass_kg": None})
    own = copy_machine_with_simulated_channels(machine.model_copy(update={"machine": body}), log)
    replayed = Weighed(run([MemoryLog(log)], own), TRUE_KG, own)
    assert replayed.check("negative_payload").passed is None
    assert replayed.check("empty_mass").passed is None
    assert replayed.replayed.frames["findings"].is_empty()


@pytest.mark.heavy
def test_a_cause_that_makes_a_mass_worthless_withholds_it_too():
    log = scaled(1.0)
    judged = log.replayed.frames["verdict"]
    found = log.replayed.frames["findings"]
    assert log.check("invalidating_causes").passed is True
    row = dict.fromkeys(found.columns) | {"cause": "sign_flipped"}
    grave = pl.concat([found, pl.DataFrame([row | {"severity": "withhold"}], schema=found.schema)])
    others = judged.filter(pl.col("check") != "invalidating_causes")
    with_it = add_check_of_invalidating_findings(others, grave, log.machine)
    assert with_it.filter(pl.col("passed").not_())["check"].to_list() == ["invalidating_causes"]
    assert with_it["check"].to_list() == judged["check"].to_list()
