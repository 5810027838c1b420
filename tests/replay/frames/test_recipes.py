"""Every recipe of docs/logs-as-frames.md runs, one after another, on a simulated bag."""

import re
from pathlib import Path

import polars as pl
import pytest

from analysis.simulation import Scenario
from replay import open_log
from replay.simulation.simulate_logs import simulate_scenario_to_logs

PAGE = Path(__file__).resolve().parents[3] / "docs/logs-as-frames.md"


def test_the_recipes_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    short = Scenario()
    campaign = short.campaign.model_copy(update={"loads_kg": (0.0,), "runs": 1})
    simulate_scenario_to_logs(
        short.model_copy(update={"campaign": campaign}), tmp_path / "shift.bag"
    )
    monkeypatch.chdir(tmp_path)
    recipes = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert len(recipes) == 9
    names: dict[str, object] = {}
    for recipe in recipes:
        exec(recipe, names)
    messages = open_log("shift.bag").read("/imu/data", []).height
    assert pl.read_parquet("imu.parquet").height == messages
    assert f"{messages}\n[]\nInt64" in capsys.readouterr().out
