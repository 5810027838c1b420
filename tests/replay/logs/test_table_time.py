"""Times of tables as integer nanoseconds."""

from datetime import UTC, datetime, timedelta
from fractions import Fraction

import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from replay.logs.tables.times import NS_PER_UNIT, TimeError, convert_times_to_ns

UNITS = st.sampled_from(sorted(NS_PER_UNIT))


@given(st.lists(st.integers(-(2**50), 2**50), min_size=1))
def test_nanoseconds_written_as_seconds_come_back_exactly(stamps: list[int]) -> None:
    seconds = pl.Series([stamp / 10**9 for stamp in stamps])
    assert convert_times_to_ns(seconds, "s").to_list() == stamps


@given(st.floats(-9e9, 9e9), UNITS)
def test_a_float_becomes_its_own_value_rounded_to_the_nanosecond(time: float, unit: str) -> None:
    exact = Fraction(time) * NS_PER_UNIT[unit]
    (stamp,) = convert_times_to_ns(pl.Series([time]), unit)
    assert abs(stamp - exact) <= Fraction(1, 2) + Fraction(1, 10**6)


@given(st.integers(-(9 * 10**9), 9 * 10**9), UNITS)
def test_integers_are_multiplied_as_integers(time: int, unit: str) -> None:
    assert convert_times_to_ns(pl.Series([time]), unit).to_list() == [time * NS_PER_UNIT[unit]]


@given(st.integers(-(2**63) + 1, 2**63 - 1))
def test_text_of_nanoseconds_keeps_every_digit(stamp: int) -> None:
    assert convert_times_to_ns(pl.Series([str(stamp)]), "ns").to_list() == [stamp]


def test_missing_and_infinite_times_are_null() -> None:
    times = pl.Series([1.5, None, float("nan"), float("inf"), 2.0])
    assert convert_times_to_ns(times, "s").to_list() == [
        1_500_000_000,
        None,
        None,
        None,
        2_000_000_000,
    ]
    text = pl.Series(["1.5", "", "soon", None, " 2 "])
    assert convert_times_to_ns(text, "s").to_list() == [
        1_500_000_000,
        None,
        None,
        None,
        2_000_000_000,
    ]


@pytest.mark.parametrize("unit", ["ms", "us", "ns"])
def test_datetimes_have_their_own_unit(unit: str) -> None:
    moment = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)
    times = pl.Series([moment], dtype=pl.Datetime(unit, "America/Santiago"))
    expected = [int(moment.timestamp()) * 10**9]
    assert convert_times_to_ns(times, "s").to_list() == expected
    text = pl.Series(["2026-01-02T03:04:05Z"])
    assert convert_times_to_ns(text, "s").to_list() == expected
    assert convert_times_to_ns(pl.Series([timedelta(seconds=2)]), "s").to_list() == [2 * 10**9]


@pytest.mark.parametrize("stamp", [1_700_000_000_123_456_789, 1.7e18, "1700000000123456789"])
def test_nanoseconds_taken_for_seconds_are_refused(stamp: float | str) -> None:
    with pytest.raises(
        TimeError, match="exceeds 64-bit nanoseconds; the unit of the time is wrong"
    ):
        convert_times_to_ns(pl.Series([stamp]), "s")


@pytest.mark.parametrize("dtype", [pl.Int8, pl.UInt16, pl.UInt64])
def test_integers_of_every_width_are_times(dtype: pl.DataType) -> None:
    times = pl.Series([1, None, 100], dtype=dtype)
    assert convert_times_to_ns(times, "s").to_list() == [10**9, None, 100 * 10**9]


@pytest.mark.parametrize("values", [["left", "right"], [True, False], [b"1"]])
def test_what_is_no_time_is_refused(values: list[object]) -> None:
    with pytest.raises(TimeError, match=r"not a time|not times"):
        convert_times_to_ns(pl.Series(values), "s")
