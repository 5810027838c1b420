"""Friction that falls with the speed is no sign that is wrong."""

from pathlib import Path

import pytest

from analysis.model.run_record import Run
from tests.replay import truck
from tests.twins import mark_heavy_after


def friction_sign(found: Run) -> tuple[float, bool]:
    row = found.frames["verdict"].filter(check="friction_sign").row(0, named=True)
    return row["value"], row["passed"]


@pytest.mark.heavy
@pytest.mark.parametrize("grease_N", mark_heavy_after(1, [0.0, 1_000.0, 1_500.0]))
def test_grease_that_breaks_away_leaves_a_mass_that_is_right(
    grease_N: float, tmp_path: Path
) -> None:
    found = truck.replayed(tmp_path, truck.starts(grease_N=grease_N, viscous_N_s_m=0.0))
    assert friction_sign(found) == (pytest.approx(0.0, abs=4.0), True)
    (load,) = found.frames["loads"].to_dicts()
    assert abs(load["mass_kg"] - truck.MASS_KG) <= 2.0 * load["u_kg"]
    causes = found.frames["budget"]["cause"].to_list()
    assert ("falling_friction" in causes) is (grease_N > 0.0)


@pytest.mark.heavy
def test_a_speed_of_the_wrong_sign_is_refused(tmp_path: Path) -> None:
    table = truck.starts()
    found = truck.replayed(tmp_path, table.with_columns(-table["speed_m_s"]))
    (load,) = found.frames["loads"].to_dicts()
    assert load["mass_kg"] is None
    assert "sign_flipped" in found.frames["findings"]["cause"].to_list()
