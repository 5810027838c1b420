"""What a campaign knows of its loads, and what it says of a log that cannot weigh."""

import datetime as dt

import pytest

from analysis.calibration.campaign.campaign_plan import CampaignRun
from analysis.calibration.line.procedure import PROCEDURES
from replay import load_machine
from replay.calibration.campaign_runs import (
    copy_machine_with_single_load_if_stated,
    describe_why_log_cannot_weigh,
)
from tests.analysis.weighing.test_gain_by_direction import to_and_fro
from tests.analysis.weighing.weighed import weighed


def run_of(*loads: str, from_s: float | None = None) -> CampaignRun:
    day = dt.date(2026, 9, 14)
    return CampaignRun.model_validate(
        {"id": "1", "log": "a.csv", "loads": loads, "day": day, "from_s": from_s}
    )


@pytest.mark.parametrize(
    ("runs", "is_single"),
    [
        ([run_of("w1", "w2")], True),
        ([run_of()], True),
        ([run_of("w1", from_s=60.0)], False),
        ([run_of("w1"), run_of("w2")], False),
    ],
    ids=["a load", "empty", "a stretch of the log", "two loads"],
)
def test_a_whole_log_of_one_known_load_has_no_other(
    runs: list[CampaignRun], is_single: bool
) -> None:
    machine = load_machine("cat262c.toml")
    assert not machine.settings.loads.single_load
    assert (
        copy_machine_with_single_load_if_stated(machine, runs).settings.loads.single_load
        is is_single
    )


def test_evidence_of_earlier_procedures_seeks_loads_as_it_did() -> None:
    kept = {number: rules.known_loads_kept for number, rules in PROCEDURES.items()}
    assert kept == {1: False, 2: False, 3: True}


def test_a_refusal_says_its_cause_in_words_and_what_mends_it() -> None:
    said = describe_why_log_cannot_weigh(to_and_fro(0.05).replayed)
    assert said.startswith("gain by direction: in reverse the gain of the force differs by ")
    assert "settings.loads.single_load" in said
    assert "invalidating_causes" not in said


def test_a_refusal_by_a_check_says_its_number_its_limit_and_its_remedy() -> None:
    said = describe_why_log_cannot_weigh(weighed({"sensors": {"force_delay_s": 0.15}}).replayed)
    assert said.startswith("force_delay_s 0.1")
    assert "(limit ≤ 0.1)" in said
    assert said.endswith("Remedy: channels.force_x_N.delay_s (or of both torques)")
