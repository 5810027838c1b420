"""A log in which few drives determine a mass says so: loads of the others may be missing."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from tests.replay.haul import haul, replay_haul


@pytest.mark.heavy
@pytest.mark.parametrize(("straight", "is_told"), [(6, True), (16, False)])
def test_drives_without_a_usable_start_are_counted(
    straight: int, is_told: bool, tmp_path: Path
) -> None:
    """A truck that shifts gears was weighed in 2 of 8 hauls, without a word of the others."""
    drives, dice = 16, np.random.default_rng(1)
    first, second = haul(dice), haul(dice)
    later = second.with_columns(pl.col("time_s") + first["time_s"][-1] + 0.02)
    hauled = pl.concat([first, later]).with_row_index()
    turns = (pl.col("index") * drives >= straight * hauled.height) & (pl.col("speed_m_s") > 0.1)
    hauled = hauled.with_columns(yaw_rate_rad_s=0.3 * turns.cast(pl.Float64)).drop("index")
    channels = {name: {"field": name} for name in ("pitch_rad", "yaw_rate_rad_s")}
    loads = replay_haul(hauled, tmp_path, **channels)["loads"]
    note = f"of {drives} drives have a usable start"
    assert loads.height > 1
    assert (note in loads["said"][0]) == is_told, loads["said"]
