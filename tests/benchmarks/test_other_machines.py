"""Loads of machines without a bucket are told where files end, and nowhere else."""

import pytest

from benchmarks.other_machines import Told, draw_machine, told
from tests.twins import mark_slow_after

#: Numbers of the campaign: what each of a car with gears, a rack and an arm once had wrong.
ONCE_WRONG = {
    "the rotating mass of low gears is no load": 0,
    "racks do not say where a record begins": 10,
    "an arm's weight grows with its load": 17,
}


@pytest.mark.heavy
@pytest.mark.parametrize("case", mark_slow_after(1, ONCE_WRONG))
def test_each_file_has_its_load(case: str) -> None:
    mine = draw_machine(ONCE_WRONG[case], files=True)
    found = told(mine)
    assert found.piles == 0
    assert found.false_changes(mine.level) == 0
    assert found.missed(mine.level) == 0
    assert all(error is not None and abs(error) < 3.0 for error in found.errors)


@pytest.mark.heavy
def test_no_car_drives_into_a_pile_at_the_speed_of_a_road() -> None:
    found = told(draw_machine(553, files=False))
    assert found.piles == 0
    assert len(found.errors) == 1


@pytest.mark.parametrize(
    ("states", "level", "false", "missed"),
    [
        ([[0], [1], [2]], (0, 1, 2), 0, 0),
        ([[0], [0], [1]], (0, 1, 2), 0, 1),
        ([[0], [1], [2]], (0, 0, 2), 1, 0),
        ([[0, 1], [2]], (0, 1), 1, 0),
        ([[0], [], [1]], (0, 1, 0), 1, 0),
        ([[0, 1], [1]], (0, 1), 1, 1),
    ],
)
def test_changes_that_are_none_and_those_that_are_missed_are_counted(
    states: list[list[int]], level: tuple[int, ...], false: int, missed: int
) -> None:
    found = Told(0, states, [], [], "")
    assert found.false_changes(level) == false
    assert found.missed(level) == missed
