"""Cars, a bus, a cart, a rack and an arm: no pile, no load that is none, and a load a file."""

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from analysis.model.run_record import Run
from tests.analysis.other_machine_logs import replayed
from tests.trials.other_machines import OTHER_MACHINES, arm, bus, cart, electric_car
from tests.twins import mark_heavy_after, mark_slow_after

#: Masses on board, in kg, a file each.
SEVEN_KG = (0.0, 700.0, 1400.0, 2100.0, 2800.0, 3500.0, 4200.0)
SHUFFLED = (3, 0, 6, 2, 5, 1, 4)


@cache
def driven(name: str, seed: int) -> Run:
    """What is found of a machine's one log, which two tests look at."""
    with TemporaryDirectory() as folder:
        return replayed(OTHER_MACHINES[name](seed), Path(folder))


@pytest.mark.heavy
@pytest.mark.parametrize("seed", mark_slow_after(1, (100, 0, 1)))
@pytest.mark.parametrize("name", mark_heavy_after(1, OTHER_MACHINES))
def test_there_is_no_pile(name: str, seed: int) -> None:
    made = driven(name, seed)
    assert made.frames["digging"].is_empty()
    assert "external_force" not in set(made.frames["findings"]["cause"])


@pytest.mark.heavy
@pytest.mark.parametrize("seed", mark_slow_after(1, (100, 101, 102)))
@pytest.mark.parametrize(
    "name", ["a car whose motor brakes", "a bus that never stands", "a cart", "a rack"]
)
def test_a_load_that_stays_is_one_load(name: str, seed: int) -> None:
    scenario = OTHER_MACHINES[name](seed)
    (load,) = driven(name, seed).frames["loads"].to_dicts()
    if not load["withheld"]:
        assert abs(load["mass_kg"] - scenario.machine.mass_kg) < 3.0 * load["u_kg"]


@pytest.mark.heavy
@pytest.mark.parametrize(
    ("seed", "order"),
    mark_slow_after(1, [(5, SHUFFLED), (1, tuple(range(7))), (4, tuple(range(7)))]),
)
def test_seven_loads_of_a_bus_are_told_where_its_files_end(
    seed: int, order: tuple[int, ...], tmp_path: Path
) -> None:
    scenario = bus(seed, SEVEN_KG)
    found = replayed(scenario, tmp_path, order).frames["loads"].to_dicts()
    assert len(found) == len(order)
    for load, place in zip(found, order, strict=True):
        true_kg = scenario.machine.mass_kg + SEVEN_KG[place]
        assert abs(load["mass_kg"] - true_kg) < 3.0 * load["u_kg"]


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 3])
def test_files_of_a_bus_that_share_a_load_are_no_farther_from_it_than_its_uncertainty(
    seed: int, tmp_path: Path
) -> None:
    """Its files are a deviation apart, on slopes that no channel measures."""
    scenario = bus(seed, SEVEN_KG)
    found = replayed(scenario, tmp_path, tuple(range(7))).frames["loads"].to_dicts()
    assert len(found) >= 6
    starts_ns = np.array([load["start_t_ns"] for load in found])
    ends_ns = found[-1]["end_t_ns"]
    for place, payload_kg in enumerate(SEVEN_KG):
        middle_ns = (place + 0.5) / len(SEVEN_KG) * ends_ns
        load = found[int(np.searchsorted(starts_ns, middle_ns)) - 1]
        true_kg = scenario.machine.mass_kg + payload_kg
        assert abs(load["mass_kg"] - true_kg) < 3.0 * load["u_kg"]


@pytest.mark.slow
def test_a_load_that_a_car_carries_in_the_second_of_three_files_is_told(tmp_path: Path) -> None:
    scenario = electric_car(5, (0.0, 300.0, 1.0))
    found = replayed(scenario, tmp_path, (0, 1, 2)).frames["loads"].to_dicts()
    assert [round((load["payload_kg"] or 0.0) / 300.0) for load in found] == [0, 1, 0]


@pytest.mark.slow
def test_loads_of_an_arm_whose_weight_goes_with_its_acceleration_are_told(tmp_path: Path) -> None:
    """Its share of the weight is as large as the acceleration, and opposite: no load showed."""
    scenario = arm(23, (0.0, 1.0, 2.0))
    found = replayed(scenario, tmp_path, (1, 0, 2)).frames["loads"].to_dicts()
    assert len(found) == 3
    for load, payload_kg in zip(found, (1.0, 0.0, 2.0), strict=True):
        assert abs(load["mass_kg"] - scenario.machine.mass_kg - payload_kg) < 3.0 * load["u_kg"]


@pytest.mark.heavy
def test_a_cart_with_one_load_in_four_files_has_one_load(tmp_path: Path) -> None:
    """Samples between the grid's rows had half the noise that was taken off them: four loads."""
    scenario = cart(27, (0.0, 1e-6, 2e-6, 3e-6))
    (load,) = replayed(scenario, tmp_path, (0, 1, 2, 3)).frames["loads"].to_dicts()
    assert abs(load["mass_kg"] - scenario.machine.mass_kg) < 3.0 * load["u_kg"]
