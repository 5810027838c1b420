"""Times of tables as integer nanoseconds."""

from datetime import UTC, datetime, timedelta
from fractions import Fraction

import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from replay.logs.tables.times import (
    NS_PER_UNIT,
    RowTimes,
    TimeError,
    convert_times_to_ns,
    unwrap_counter,
)

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


COUNTERS = {"2^32 us": (32, 20_000, "us"), "2^32 ms": (32, 20, "ms"), "2^16 ms": (16, 20, "ms")}


@pytest.mark.parametrize("name", COUNTERS)
def test_a_counter_that_overflows_goes_on_and_a_note_says_so(name: str) -> None:
    bits, step, unit = COUNTERS[name]
    # without the row after the overflow, and with one that has no time
    whole = [2**bits - 1000 * step + step * k for k in range(2000) if k != 1000]
    counted = pl.Series([*(each % 2**bits for each in whole), None])
    found = unwrap_counter(RowTimes(convert_times_to_ns(counted, unit)))
    assert found.stamps.to_list() == [*(each * NS_PER_UNIT[unit] for each in whole), None]
    assert [name in note and "1 row where" in note for note in found.notes] == [True]


@pytest.mark.parametrize(
    "times",
    [
        [*range(0, 60_000, 20), *range(0, 60_000, 20)],
        [*range(0, 65_000, 1000), *range(0, 65_000, 1000)],
        [*range(40, 65_536, 20), *range(300, 9_000, 20)],
        [*range(70_000, 135_530, 20), *range(70_000, 80_000, 20)],
        [*range(0, 65_520, 20), 4, 65_520, *range(24, 9_000, 20)],
    ],
    ids=["a minute", "at 1 Hz", "after a pause", "not from 0", "swapped rows"],
)
def test_a_second_record_is_no_counter_that_overflows(times: list[int]) -> None:
    stamps = RowTimes(convert_times_to_ns(pl.Series(times), "ms"))
    assert unwrap_counter(stamps) is stamps
