"""A force whose sign the drive does not report, read with noise about zero at standstill."""

import tomllib
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from analysis.model.machine import Machine
from replay import open_log, run
from tests.replay.sledge import MACHINE, sledge


@pytest.mark.parametrize("columns", [["force_N"], ["force_N", "speed_m_s"]])
def test_a_force_without_its_sign_is_named(columns: list[str], tmp_path: Path) -> None:
    """Noise after the loss made half of the readings at standstill negative, and hid it."""
    log = sledge()
    dice = np.random.default_rng(6)
    noise_N = pl.Series(dice.normal(0.0, 0.002 * log["force_N"].abs().max(), log.height))
    unsigned = log.with_columns(pl.col(columns).abs()).with_columns(pl.col("force_N") + noise_N)
    path = tmp_path / "sledge.csv"
    unsigned.write_csv(path)
    findings = run(open_log(path), Machine.model_validate(tomllib.loads(MACHINE))).frames[
        "findings"
    ]
    assert findings["cause"][0] == "unsigned", findings["cause"].to_list()
