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


def test_a_machine_that_rolls_back_without_drive_has_its_sign(tmp_path: Path) -> None:
    log = sledge()
    back = pl.when(pl.int_range(pl.len()) // 1_000 % 2 == 0).then(-1.0).otherwise(1.0)
    rolled = log.with_columns(speed_m_s=pl.col("speed_m_s") * back).with_columns(
        force_N=pl.when(pl.col("speed_m_s") < 0.0).then(0.0).otherwise(pl.col("force_N").abs())
        + pl.Series(np.random.default_rng(6).normal(0.0, 1.0, log.height))
    )
    path = tmp_path / "sledge.csv"
    rolled.write_csv(path)
    findings = run(open_log(path), Machine.model_validate(tomllib.loads(MACHINE))).frames[
        "findings"
    ]
    unsigned = findings.filter(cause="unsigned")
    assert "drives in reverse" not in " ".join(unsigned["evidence"])
