"""A car that nobody here made is weighed at its own rate, without its noise stated."""

import pytest

from benchmarks.own_rate import MASS_KG, Cell, cells, logged, machine_of, weighed
from tests.twins import mark_heavy_after, mark_slow_after

#: Where the noise came out at up to 1e14 m/s², or rows between samples counted.
HARD = (
    Cell(100.0, 2.0, derived=True),
    Cell(100.0, 1.0, derived=True),
    Cell(50.0, 20.0, derived=True),
    Cell(20.0, 5.0, derived=True, speed_steps=True),
    Cell(5.0, 1.0, derived=True),
    Cell(10.0, 2.0, derived=True, force_steps=True),
    Cell(1.0, 20.0, derived=True),
    Cell(20.0, 20.0, derived=False),
)


@pytest.mark.heavy
@pytest.mark.parametrize("cell", mark_slow_after(2, HARD[::-1]), ids=str)
def test_it_opens_as_with_its_true_noise_stated_and_the_interval_holds(cell: Cell) -> None:
    table = logged(cell, 101)
    stated, own = (weighed(table, machine_of(cell, stated=how)) for how in (True, False))
    assert stated.open
    assert own.open
    assert abs(own.mass_kg - MASS_KG) < 3.0 * own.u_kg
    assert own.u_kg < 0.02 * MASS_KG


def test_no_cell_has_a_cutoff_above_what_its_rate_can_hold() -> None:
    filtered = [each for each in cells() if each.derived and each.cutoff_hz < 20.0]
    assert all(each.cutoff_hz <= 0.45 * each.rate_hz for each in filtered)


@pytest.mark.heavy
@pytest.mark.parametrize(
    "cell",
    mark_heavy_after(1, [Cell(1.0, 20.0, derived=True), Cell(50.0, 2.0, derived=True)]),
    ids=str,
)
def test_wheels_that_slip_and_give_the_acceleration_tell_how_much(cell: Cell) -> None:
    """By 7.5 % at 2.5 kN; the mass was up to 51 kg too small."""
    found = weighed(logged(cell, 1, {"slip": 3e-5}), machine_of(cell, stated=False))
    assert abs(found.mass_kg - MASS_KG) < min(3.0 * found.u_kg, 0.005 * MASS_KG)
