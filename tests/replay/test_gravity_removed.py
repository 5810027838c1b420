"""An accelerometer whose driver has taken gravity out, given as one that reads it."""

import tomllib
from pathlib import Path

import numpy as np

from analysis.model.machine import Machine
from replay import open_log, run
from tests.replay.sledge import MACHINE, sledge


def test_gravity_that_is_missing_is_named_and_the_channel_proposed(tmp_path: Path) -> None:
    """It was an IMU that is tilted by 95 to 127°: the angle of noise."""
    log = sledge()
    dice = np.random.default_rng(6)
    axes = {name: dice.normal(0.0, 0.02, log.height) for name in ("y", "z")}
    path = tmp_path / "sledge.csv"
    log.with_columns(**axes).write_csv(path)
    text = tomllib.loads(MACHINE)
    text["settings"]["forces"]["acceleration"] = "specific_force"
    del text["channels"]["acc_x_m_s2"]
    for axis, field in (("x", "acc_m_s2"), ("y", "y"), ("z", "z")):
        text["channels"][f"specific_force_{axis}_m_s2"] = {"field": field}

    frames = run(open_log(path), Machine.model_validate(text)).frames
    finding = frames["findings"].row(0, named=True)
    assert finding["cause"] == "slope"
    assert "gravity has been removed" in finding["evidence"]
    assert finding["setting"] == "settings.forces.acceleration, channels.acc_x_m_s2.field"
    assert finding["value"] == '"kinematic", "acc_m_s2"'
    assert frames["loads"]["mass_kg"].null_count() == 1
