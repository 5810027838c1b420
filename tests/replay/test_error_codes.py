"""Error codes among the readings: found, and left out by the range that the finding proposes."""

import tomllib
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from tests.replay.haul import haul, replay_haul


@pytest.mark.heavy
@pytest.mark.parametrize(
    ("column", "rows", "code"),
    [
        pytest.param("force_N", slice(1_450, 1_510), -32_768.0, id="stretch of a bus that is down"),
        pytest.param("speed_m_s", slice(300, 7_900, 200), 71.11, id="single value not available"),
    ],
)
def test_the_proposed_range_leaves_error_codes_out(
    column: str, rows: slice, code: float, tmp_path: Path
) -> None:
    """The mass was withheld, and no setting gave it back."""
    hauled = haul(np.random.default_rng(4), grade_rad=0.0)
    readings = hauled[column].to_numpy().copy()
    readings[rows] = code
    coded = hauled.with_columns(pl.Series(column, readings))
    found = replay_haul(coded, tmp_path)["findings"].filter(
        pl.col("setting").str.ends_with(".valid_range")
    )
    assert found.height == 1
    channel = found["channel"][0]
    (low, high) = tomllib.loads(f"range = {found['value'][0]}")["range"]
    assert not low < code < high
    proposed = {"field": column, "valid_range": [low, high]}
    mended, sound = (
        replay_haul(coded, tmp_path, **{channel: proposed})["loads"],
        replay_haul(hauled, tmp_path)["loads"],
    )
    assert mended.height == sound.height
    assert not mended["withheld"].any()
    off_kg = (mended["mass_kg"] - sound["mass_kg"]).abs()
    assert (off_kg < 2.0 * mended["u_kg"]).all()


@pytest.mark.heavy
def test_the_proposed_range_keeps_the_motion_of_a_machine_that_mostly_stands(
    tmp_path: Path,
) -> None:
    """Its usual readings are zeros, and those of its motion are few."""
    hauled = haul(np.random.default_rng(4), grade_rad=0.0)
    parked = pl.DataFrame({name: np.zeros(150_000) for name in hauled.columns})
    whole = pl.concat([parked, hauled]).with_columns(time_s=pl.int_range(pl.len()) / 50.0)
    speed = whole["speed_m_s"].to_numpy().copy()
    speed[150_300::200] = 71.11
    found = replay_haul(whole.with_columns(speed_m_s=pl.Series(speed)), tmp_path)["findings"]
    (value,) = found.filter(pl.col("cause") == "spikes")["value"]
    (low, high) = tomllib.loads(f"range = {value}")["range"]
    assert low < -3.5
    assert 3.5 < high < 71.11
