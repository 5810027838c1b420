"""A scale that changes within a log: the empty machine comes back with another mass."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from tests.replay.haul import haul, replay_haul


@pytest.mark.heavy
@pytest.mark.parametrize(("column", "factor"), [("force_N", 1.356), ("speed_m_s", 0.6214)])
def test_a_unit_that_changes_in_the_middle_is_found(
    column: str, factor: float, tmp_path: Path
) -> None:
    """Payloads of 4.8 t instead of 1.5 t were open: both units share one empty machine."""
    hauled = haul(np.random.default_rng(4), grade_rad=0.0)
    later = pl.int_range(pl.len()) >= pl.len() // 2
    scaled = hauled.with_columns(pl.when(later).then(pl.col(column) * factor).otherwise(column))
    run = replay_haul(scaled, tmp_path)
    found = run["findings"].filter(pl.col("cause") == "scale_step")
    assert found.height == 1
    assert found["severity"][0] == "withhold"
    assert int(found["start_t_ns"][0]) / 1e9 == pytest.approx(80.0, abs=5.0)


@pytest.mark.heavy
def test_a_machine_that_keeps_its_scale_has_no_step(tmp_path: Path) -> None:
    findings = replay_haul(haul(np.random.default_rng(4), grade_rad=0.0), tmp_path)["findings"]
    assert "scale_step" not in findings["cause"], findings
