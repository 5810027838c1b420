"""A spring, or gravity that depends on the place, is no mass: a bench goes over one short path."""

from pathlib import Path

import pytest

from replay import open_log, run
from replay.logs import TimeAxis
from tests.analysis.other_machine_logs import replayed
from tests.analysis.without_bucket import arm
from tests.trials.other_machines import electric_car, rack
from tests.twins import mark_slow_after


#: Racks whose springs take a mass of 13 to 41 % less where the fit has none.
@pytest.mark.heavy
@pytest.mark.parametrize("seed", mark_slow_after(1, [101, 102, 104, 106]))
def test_a_rack_is_weighed_beside_its_spring(seed: int, tmp_path: Path) -> None:
    scenario = rack(seed)
    made = replayed(scenario, tmp_path)
    (load,) = made.frames["loads"].to_dicts()
    assert not load["withheld"]
    assert abs(load["mass_kg"] - scenario.machine.mass_kg) < 3.0 * load["u_kg"]
    assert load["u_kg"] < 0.01 * scenario.machine.mass_kg
    assert "place" in set(made.frames["budget"]["cause"])


@pytest.mark.heavy
@pytest.mark.parametrize("seed", mark_slow_after(1, [0, 6, 10]))
def test_an_arm_whose_weight_pulls_by_its_place_has_one_load(seed: int, tmp_path: Path) -> None:
    drawn = arm(seed)
    path = tmp_path / "arm.parquet"
    drawn.table.write_parquet(path)
    with open_log(path, time=TimeAxis("t")) as log:
        (load,) = run(log, drawn.machine).frames["loads"].to_dicts()
    assert not load["withheld"]
    assert abs(load["mass_kg"] - drawn.mass_kg) < 3.0 * load["u_kg"]


@pytest.mark.heavy
def test_what_drives_on_has_no_such_force(tmp_path: Path) -> None:
    terms = set(replayed(electric_car(0), tmp_path).frames["nuisances"]["term"])
    assert "const" in terms
    assert not any(term.startswith(("spring", "place")) for term in terms)
