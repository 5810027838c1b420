"""What turns in low gears is no load, and vehicles that are slower than on a road have none."""

from pathlib import Path

import numpy as np
import pytest

from analysis.weighing.low_gears import LOW_GEARS
from tests.analysis.other_machine_logs import replayed
from tests.trials.other_machines import car, cart


#: Without the terms of gears the mass is 5 u off, or none.
@pytest.mark.parametrize("seed", [405, 406])
def test_a_car_with_gears_has_one_load_and_the_mass_that_its_top_gear_moves(
    seed: int, tmp_path: Path
) -> None:
    scenario = car(seed)
    (load,) = replayed(scenario, tmp_path).frames["loads"].to_dicts()
    moves_kg = scenario.machine.mass_kg + scenario.drivetrain.gear_rotating_kg[-1]
    assert abs(load["mass_kg"] - moves_kg) < 2.0 * load["u_kg"]


def test_a_cart_has_no_gears(tmp_path: Path) -> None:
    terms = set(replayed(cart(0), tmp_path).frames["nuisances"]["term"])
    assert not terms & {term.name for term in LOW_GEARS}


@pytest.mark.parametrize("ratio_speeds_m_s", [(6.0, 11.0, 17.0, 24.0), (4.8, 8.8, 13.6, 19.2)])
def test_the_terms_follow_what_gears_have_beyond_the_top_one(
    ratio_speeds_m_s: tuple[float, ...],
) -> None:
    speed = np.linspace(0.5, 30.0, 300)
    beyond = np.array([0.22, 0.09, 0.03, 0.01, 0.0])[np.digitize(speed, ratio_speeds_m_s)]
    columns = np.column_stack([(1.0 + (speed / half) ** 2) ** -2 for half in (4.0, 10.0)])
    missed = beyond - columns @ np.linalg.lstsq(columns, beyond, rcond=None)[0]
    assert np.sqrt(np.mean(missed**2)) < 0.03
