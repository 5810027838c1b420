"""A machine that is cold at first: its resistance falls, and is no load."""

from pathlib import Path

import numpy as np
import pytest

from tests.replay.haul import haul, replay_haul


@pytest.mark.heavy
@pytest.mark.parametrize(("cold_1", "is_named"), [(0.0, False), (2.0, True)])
def test_friction_that_falls_is_named_and_is_part_of_the_uncertainty(
    cold_1: float, is_named: bool, tmp_path: Path
) -> None:
    """The first starts were loads of 0.5 t, seven expanded uncertainties from none."""
    hauled = haul(np.random.default_rng(6), grade_rad=0.0, cold_1=cold_1)
    frames = replay_haul(hauled, tmp_path)
    assert ("warming_friction" in frames["findings"]["cause"]) == is_named
    assert ("warming" in frames["budget"]["cause"]) == is_named
