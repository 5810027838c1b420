"""Every situation is a scenario of the one simulator, and not the plain one."""

from functools import cache

import numpy as np
import pytest

from analysis.simulation import Scenario, simulate_campaign
from replay.simulation.scenario_file import format_scenario_file, load_scenario_file
from tests.trials.situations import SITUATIONS, sections
from tests.twins import mark_heavy_after

SHORT = {"campaign": {"runs": 2, "standstill_s": 1.0}}


@cache
def plain_log(loads_kg):
    """The first log with so many loads and nothing else about it."""
    plain = {"campaign": {**SHORT["campaign"], "loads_kg": list(loads_kg)}}
    return next(simulate_campaign(Scenario.model_validate(plain)))


@pytest.mark.parametrize("name", mark_heavy_after(1, SITUATIONS))
def test_a_situation_is_simulated_and_differs_from_the_plain_log(name, tmp_path):
    made = Scenario.model_validate(sections(name, **SHORT))
    log, again = (next(simulate_campaign(made)) for _ in range(2))
    without = plain_log(made.campaign.loads_kg)
    differs = [not log.topics[topic].equals(without.topics[topic]) for topic in log.topics]
    # another load may make the difference only from a later start on
    changes_late = made.loading.change_before_start >= made.campaign.runs
    assert any(differs) or changes_late
    for topic, frame in log.topics.items():
        assert frame.equals(again.topics[topic])
        assert frame.null_count().sum_horizontal()[0] == 0
        assert np.isfinite(frame.to_numpy()).all()
    path = tmp_path / "situation.toml"
    path.write_text(format_scenario_file(made), encoding="utf-8")
    assert load_scenario_file(path) == made
