"""Convert the values of a time column to integer nanoseconds, by unit or by epoch.

The magnitude of the numbers identifies a clock whose epoch is not 1970.
"""

import re
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Final, NamedTuple

import numpy as np
import polars as pl

from analysis.model.physical_units import NS
from estimators.arrays import Floats
from estimators.errors import format_count
from replay.logs.tables.header import ColumnName, reduce_to_lower_case_letters
from replay.logs.tables.table_limits import LIMITS

NS_PER_UNIT: Final = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}


#: Unit of a column of fractions of a second, by its name.
_FRACTIONS: Final = {
    **dict.fromkeys(("ms", "msec", "msecs", "millis", "millisecond", "milliseconds"), "ms"),
    **dict.fromkeys(("us", "usec", "usecs", "micros", "microsecond", "microseconds"), "us"),
    **dict.fromkeys(("ns", "nsec", "nsecs", "nanos", "nanosec", "nanosecs", "nanoseconds"), "ns"),
}
_PLACE: Final = re.compile(r"(?:.*[./])?(?:.*stamp_)?", re.IGNORECASE)
_WHOLE_NUMBER: Final = re.compile(r"\d+(?:[.,]0*)?")
_WHOLE_SECONDS: Final = ("sec", "secs", "second", "seconds", "s", "ss")
_BEGINNINGS: Final = {"milli": "ms", "micro": "us", "nano": "ns"}
#: Time in ns after which counters of a controller begin again.
_COUNTERS_NS: Final = {
    f"2^{bits} {unit}": 2**bits * NS_PER_UNIT[unit]
    for bits, unit in ((16, "ms"), (32, "ms"), (32, "us"))
}
#: Time in ns (two hours) below which a float resolves 0.001 ns, and need not be split.
_EXACT_NS: Final = 2.0**43


class TimeError(Exception):
    """Raised if a column cannot be the time; one line with the reason."""


@dataclass(frozen=True, slots=True)
class RowTimes:
    """Log times of rows.

    Attributes:
        stamps: (rows,) in ns, null if missing.
        notes: what was detected or assumed.
        names_no_zone: whether they are dates with a time of day in an unknown time zone.
    """

    stamps: pl.Series
    notes: tuple[str, ...] = ()
    names_no_zone: bool = False


def convert_times_to_ns(values: pl.Series, unit: str) -> pl.Series:
    """Convert times to Int64 ns; null if missing.

    Integers are multiplied as integers. A float is first split into its integer part and fraction,
    so that the result is its value correctly rounded to the ns, however large it is.

    Args:
        values: numbers in `unit`, or datetimes or durations with their own unit.
        unit: s, ms, us or ns.

    Raises:
        TimeError: the column contains no times, or they do not fit into 64 bits.
    """
    if values.dtype == pl.String:
        values = parse_times_from_text(values)
    dtype = values.dtype
    if dtype.is_temporal():
        return _convert_datetimes_to_ns(values)
    if dtype.is_integer():
        largest = (2**63 - 1) // NS_PER_UNIT[unit]
        refuse_times_beyond_64_bits((values.min(), values.max()), largest, unit)
        return values.cast(pl.Int64) * NS_PER_UNIT[unit]
    if not dtype.is_numeric():
        raise TimeError(f"it holds {dtype}, not times")
    return _convert_floats_to_ns(values.cast(pl.Float64), unit)


def _convert_floats_to_ns(values: pl.Series, unit: str) -> pl.Series:
    number, ns = pl.col(values.name), NS_PER_UNIT[unit]
    extremes = values.min(), values.max()
    if not all(isinstance(each, float) and isfinite(each) for each in extremes):
        finite = values.filter(values.is_finite())
        extremes = finite.min(), finite.max()
    refuse_times_beyond_64_bits(extremes, (2**63 - 1) // ns - 1, unit)
    if all(isinstance(each, float) and abs(each) * ns < _EXACT_NS for each in extremes):
        return values.to_frame().select(_make_rounding_expression(number * ns)).to_series()
    whole = number.floor()
    stamps = whole.cast(pl.Int64, strict=False) * ns + _make_rounding_expression(
        (number - whole) * ns
    )
    return values.to_frame().select(stamps.alias(values.name)).to_series()


def _make_rounding_expression(values: pl.Expr) -> pl.Expr:
    return values.round(mode="half_to_even").cast(pl.Int64, strict=False)


def parse_times_from_text(values: pl.Series) -> pl.Series:
    """Parse text as numbers, or as ISO 8601 times if most cells are not numbers."""
    text = values.str.strip_chars()
    present = text.filter(text.is_not_null() & (text != ""))
    numbers = present.cast(pl.Float64, strict=False)
    if numbers.null_count() * 2 <= present.len():
        integers = text.cast(pl.Int64, strict=False)
        exact = integers.count() == present.len()
        return integers if exact else text.cast(pl.Float64, strict=False)
    try:
        return text.str.to_datetime(time_unit="ns", strict=False)
    except pl.exceptions.PolarsError as error:
        raise TimeError(f"its text is not a time ('{present[0]}')") from error


def _convert_datetimes_to_ns(values: pl.Series) -> pl.Series:
    if isinstance(values.dtype, pl.Datetime):
        return values.dt.timestamp("ns")
    if isinstance(values.dtype, pl.Duration):
        return values.dt.total_nanoseconds()
    raise TimeError(f"it holds {values.dtype}, not times")


def refuse_times_beyond_64_bits(extremes: Iterable[object], max_value: int, unit: str) -> None:
    """Raise an error if a time does not fit into 64-bit ns."""
    # as Python numbers: polars compares integers only with values that fit into their dtype
    for extreme in extremes:
        if isinstance(extreme, (int, float)) and abs(extreme) > max_value:
            raise TimeError(
                f"{extreme} {unit} exceeds 64-bit nanoseconds; the unit of the time is wrong"
            )


#: Nanoseconds of a day.
_DAY_NS: Final = 86_400 * 10**9
#: Earliest and latest time of a log in s since 1970: 2000 to 2041. No log is from the future, and
#: with this end no number is a plausible date by two of these clocks.
_LOG_S: Final = (946_684_800, 2_240_611_200)


@dataclass(frozen=True, slots=True)
class Epoch:
    """A clock: its name, ns per unit, and its reading at the start of 1970."""

    name: str
    unit_ns: int
    at_1970: float

    def covers_numbers(self, min_number: float, max_number: float) -> bool:
        """Whether this clock places `min_number` to `max_number` between 2000 and 2041."""
        start, end = (s * 1e9 / self.unit_ns + self.at_1970 for s in _LOG_S)
        return start <= min_number and max_number < end

    def to_unix_ns(self, numbers: pl.Series) -> pl.Series:
        """Convert numbers counted from this epoch to Int64 ns since 1970."""
        if numbers.dtype.is_integer() and float(self.at_1970).is_integer():
            return (numbers.cast(pl.Int64) - int(self.at_1970)) * self.unit_ns
        since = numbers.cast(pl.Float64) - self.at_1970
        whole = since.floor()
        fraction = ((since - whole) * self.unit_ns).round()
        return whole.cast(pl.Int64, strict=False) * self.unit_ns + fraction.cast(
            pl.Int64, strict=False
        )


SPREADSHEET: Final = Epoch("days of a spreadsheet", _DAY_NS, 25_569)
_LABVIEW: Final = Epoch("seconds since 1904, as LabVIEW counts", 10**9, 2_082_844_800)
#: Epochs that are recognised by their numbers; none of their units is one of `[log] time_unit`.
_OTHERS: Final = (
    SPREADSHEET,
    Epoch("days of MATLAB's datenum", _DAY_NS, 719_529),
    Epoch("Julian days", _DAY_NS, 2_440_587.5),
    Epoch("modified Julian days", _DAY_NS, 40_587),
    Epoch("ticks of 100 ns since the year 1, as .NET counts", 100, 621_355_968_000_000_000),
    Epoch("ticks of 100 ns since 1601, as Windows counts", 100, 116_444_736_000_000_000),
)


def find_plausible_epoch(
    min_number: float, max_number: float, typical_step: float, steps_s: tuple[float, float]
) -> Epoch | None:
    """Find the clock by which numbers are plausible dates of a log; None if there is none.

    Args:
        min_number: smallest number.
        max_number: largest number.
        typical_step: typical difference from row to row.
        steps_s: smallest and largest plausible step of a log, in s.
    """
    for epoch in _OTHERS:
        if (
            epoch.covers_numbers(min_number, max_number)
            and steps_s[0] <= typical_step * epoch.unit_ns / 1e9 <= steps_s[1]
        ):
            return epoch
    return None


class CorrectedTimes(NamedTuple):
    """Log times in ns since 1970, and a note if they were corrected."""

    log_times: pl.Series
    note: str | None


def correct_labview_epoch(log_times: pl.Series) -> CorrectedTimes:
    """Convert times in ns that LabVIEW counted from 1904 to ns since 1970; other times are kept."""
    low, high = log_times.min(), log_times.max()
    if not isinstance(low, int) or not isinstance(high, int):
        return CorrectedTimes(log_times, None)
    if not _LABVIEW.covers_numbers(low / 1e9, high / 1e9):
        return CorrectedTimes(log_times, None)
    return CorrectedTimes(
        log_times - int(_LABVIEW.at_1970) * _LABVIEW.unit_ns, f"its times are {_LABVIEW.name}"
    )


def unwrap_counter(times: RowTimes) -> RowTimes:
    """Let times go on where a counter of ms or us has overflowed; other times are kept.

    It has overflowed where its readings are between 0 and a power of two of its unit, and each fall
    is that power, but for a few typical steps.

    Args:
        times: log times of the rows, in their order.
    """
    known = times.stamps.drop_nulls()
    low, high = known.min(), known.max()
    steps = known.diff().drop_nulls()
    falls = steps.filter(steps < 0)
    forward = steps.filter(steps > 0).median()
    if not falls.len() or not isinstance(forward, float):
        return times
    for text, period_ns in _COUNTERS_NS.items():
        is_within = isinstance(low, int) and isinstance(high, int) and 0 <= low <= high < period_ns
        most_ns = min(LIMITS.overflow_steps * forward, LIMITS.overflow_fraction * period_ns)
        missed_ns = falls + period_ns
        if not is_within or not ((missed_ns > 0) & (missed_ns <= most_ns)).all():
            continue
        # rows that are swapped where it overflows fall twice, and rise by nearly all of it
        if (steps > period_ns // 2).any():
            continue
        overflows = (times.stamps.forward_fill().diff() < 0).fill_null(value=False).cum_sum()
        note = (
            f"its times are a counter that overflows at {text}, after {period_ns / 1e9:.10g} s: "
            f"they were continued at {format_count(falls.len(), 'row')} where it begins again"
        )
        whole = times.stamps + overflows.cast(pl.Int64) * period_ns
        return RowTimes(whole.alias(times.stamps.name), (*times.notes, note), times.names_no_zone)
    return times


def find_second_fraction_column(
    columns: Sequence[ColumnName], cells: Callable[[int], list[str]], column_index: int
) -> str | None:
    """Find a column of fractions of a second; None if the times have fractions themselves."""
    own = cells(column_index)
    if any(re.search(r"[.,]0*[1-9]|:\d+:\d+:", cell) for cell in own):
        return None
    place, name = split_place_and_field(columns[column_index].name)
    if any(":" in cell for cell in own):
        place = ""
    elif name not in _WHOLE_SECONDS:
        return None
    return next(
        (
            column.name
            for k, column in enumerate(columns)
            if k != column_index
            and find_unit_of_second_fractions(column.name.removeprefix(place)) is not None
            and column.name.startswith(place)
            and all(_WHOLE_NUMBER.fullmatch(cell) for cell in cells(k))
        ),
        None,
    )


def find_seconds_of_fraction(column_name: str, all_names: Collection[str]) -> str | None:
    """Find the column of whole seconds that belongs to a column of fractions of a second.

    None if the column holds no fractions, or there is no such column in the same message.
    """
    place, name = split_place_and_field(column_name)
    if find_unit_of_second_fractions(name) is None:
        return None
    beside = (f"{place}{seconds}" for seconds in _WHOLE_SECONDS)
    return next((each for each in beside if each in all_names), None)


def find_seconds_of_stamp(names: Sequence[str]) -> list[int]:
    """Index of the first column of seconds of a stamp that has a column of fractions, in a list."""
    stamps = (name for name in names if "stamp" in split_place_and_field(name)[0].lower())
    found = (find_seconds_of_fraction(name, names) for name in stamps)
    return [names.index(seconds) for seconds in found if seconds is not None][:1]


def split_place_and_field(column_name: str) -> tuple[str, str]:
    """Split a column's name into the path of the message part and the field in lower case.

    `header.stamp.sec` gives `header.stamp.` and `sec`. An underscore separates them only after
    `stamp`: time_s and time_ms are two times.
    """
    match = _PLACE.match(column_name)
    place = match[0] if match else ""
    return place, reduce_to_lower_case_letters(column_name.removeprefix(place))


def find_unit_of_second_fractions(name: str) -> str | None:
    """Unit of the fractions of a second that a name states: ns for `nanosec`, ms for `Millitm`."""
    word = reduce_to_lower_case_letters(name)
    by_beginning = (unit for start, unit in _BEGINNINGS.items() if word.startswith(start))
    return _FRACTIONS.get(word) or next(by_beginning, None)


class SecondFractions(NamedTuple):
    """Fractions of a second in ns, and their original unit."""

    fractions_ns: pl.Series
    unit: str


def convert_second_fractions_to_ns(cells: pl.Series) -> SecondFractions:
    """Convert fractions of a second to ns, by the unit in their name, or by their magnitude.

    Raises:
        TimeError: the cells are not fractions of a second.
    """
    numbers = cells.cast(pl.Float64, strict=False)
    largest, least = numbers.max(), numbers.min()
    if not isinstance(largest, float) or not isinstance(least, float) or least < 0:
        raise TimeError(f"column '{cells.name}' holds no fractions of a second")
    _, field = split_place_and_field(cells.name)
    stated = find_unit_of_second_fractions(cells.name) or find_unit_of_second_fractions(field)
    possible = [unit for unit in ("ms", "us", "ns") if largest < NS / NS_PER_UNIT[unit]]
    unit = stated or (possible[0] if possible else "")
    if unit not in possible:
        read = f"{largest:g} {stated}" if stated else f"{largest:g}"
        raise TimeError(
            f"column '{cells.name}' looks like fractions of a second, "
            f"but {read} is a second or more"
        )
    return SecondFractions((numbers * NS_PER_UNIT[unit]).round().cast(pl.Int64, strict=False), unit)


def are_numbers_hhmmss(values: Floats, step: float) -> bool:
    """Whether numbers are hhmmss.s: at most 59 s and min, with a jump of 40 at each minute."""
    if values.min() < 0 or values.max() >= 240_000 or step > LIMITS.row_steps_s[1]:
        return False
    if (values % 100 >= 60).any() or (values // 100 % 100 >= 60).any():
        return False
    jumps = np.abs(np.diff(values))
    return (
        bool((np.abs(jumps - 40.0 - step) < step + LIMITS.minute_jump_tolerance * 40).any())
        and values.max() - values.min() > 40
    )
