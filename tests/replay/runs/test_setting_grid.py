"""What `--over` means: ranges with both ends, lists, grids; every slip of the pen in one line."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimators.errors import MachineError
from replay.runs.sweep_settings import list_value_combinations
from tests.one_line import assert_one_line


def test_a_range_has_both_ends_and_the_numbers_as_they_are_written() -> None:
    (values,) = zip(*list_value_combinations(["s.t=0.5:1.5:0.2"]), strict=True)
    assert values == ("s.t=0.5", "s.t=0.7", "s.t=0.9", "s.t=1.1", "s.t=1.3", "s.t=1.5")


def test_a_range_ends_before_a_step_too_far_and_may_fall() -> None:
    assert list_value_combinations(["w=200:450:100"]) == [("w=200",), ("w=300",), ("w=400",)]
    assert list_value_combinations(["w=3:1:-1"]) == [("w=3",), ("w=2",), ("w=1",)]


def test_a_list_keeps_what_is_in_brackets_together() -> None:
    assert list_value_combinations(['s.methods=["ls","rls"],["tls"]']) == [
        ('s.methods=["ls","rls"]',),
        ('s.methods=["tls"]',),
    ]


def test_several_make_a_grid_whose_last_varies_fastest() -> None:
    assert list_value_combinations(["a=1,2", "b=x,y"]) == [
        ("a=1", "b=x"),
        ("a=1", "b=y"),
        ("a=2", "b=x"),
        ("a=2", "b=y"),
    ]


@given(first=st.integers(-50, 50), step=st.integers(1, 9), count=st.integers(1, 40))
def test_a_range_has_as_many_values_as_steps_fit(first: int, step: int, count: int) -> None:
    last = first + (count - 1) * step
    expected = [(f"k={value}",) for value in range(first, last + 1, step)]
    assert list_value_combinations([f"k={first}:{last}:{step}"]) == expected


@pytest.mark.parametrize(
    ("over", "part"),
    [
        ("settings.gate.threshold_nat", "KEY=FROM:TO:STEP"),
        ("=1,2", "KEY=FROM:TO:STEP"),
        ("k=", "KEY=FROM:TO:STEP"),
        ("k=1,,2", "a value is missing"),
        ("k=1:2", "KEY=FROM:TO:STEP"),
        ("k=a:b:c", "KEY=FROM:TO:STEP"),
        ("k=1:2:0", "KEY=FROM:TO:STEP"),
        ("k=0:1e999999:1e-999999", "KEY=FROM:TO:STEP"),
        ("k=1:2:-1", "steps of -1 do not lead from 1 to 2"),
        ("k=1:nan:1", "steps of 1 do not lead from 1 to NaN"),
        ("k=0:1:0.0000001", "more than 10,000"),
    ],
)
def test_what_is_no_range_and_no_list_is_one_line(over: str, part: str) -> None:
    with pytest.raises(MachineError, match=part) as raised:
        list_value_combinations([over])
    assert_one_line(raised.value)


def test_a_key_twice_and_a_grid_too_large_are_one_line() -> None:
    with pytest.raises(MachineError, match="given twice"):
        list_value_combinations(["k=1,2", "k=3"])
    with pytest.raises(MachineError, match="1,000,000 replays"):
        list_value_combinations(["a=1:1000:1", "b=1:1000:1"])
