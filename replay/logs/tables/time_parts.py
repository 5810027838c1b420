"""Times in several columns: year to second, or seconds with a separate fraction."""

import re
from collections.abc import Callable, Sequence
from typing import Final

import polars as pl

from analysis.model.physical_units import NS
from replay.logs.tables.dates import DAY_NS
from replay.logs.tables.header import ColumnName
from replay.logs.tables.times import NS_PER_UNIT, TimeError

#: Names of the columns of a day and a time of day, from the largest to the smallest.
_CALENDAR: Final = (
    ("year", "yyyy", "yr", "jahr"),
    ("month", "mon", "monat"),
    ("day", "dd", "tag"),
    ("hour", "hours", "hh", "hr", "stunde"),
    ("minute", "minutes", "min", "minuten"),
    ("second", "seconds", "sec", "ss", "sekunde", "sekunden"),
)
#: Parts of a date: year, month, day.
_DAY_PARTS: Final = 3
#: Names of a column of the fraction of a second.
_FRACTIONS: Final = {
    **dict.fromkeys(("ms", "msec", "msecs", "millis", "millisecond", "milliseconds"), "ms"),
    **dict.fromkeys(("us", "usec", "usecs", "micros", "microsecond", "microseconds"), "us"),
    **dict.fromkeys(("ns", "nsec", "nsecs", "nanos", "nanosec", "nanosecs", "nanoseconds"), "ns"),
}
_BEGINNINGS: Final = {"milli": "ms", "micro": "us", "nano": "ns"}


def lower_case_letters(text: str) -> str:
    """Name in lower case, letters only."""
    return "".join(each for each in text.lower() if each.isalpha())


def find_calendar_columns(columns: Sequence[ColumnName]) -> tuple[str, ...]:
    """Columns of year, month, day, hour, minute and second, or of the last three.

    Empty if one of them is missing.
    """
    by_word = {lower_case_letters(column.name): column.name for column in reversed(columns)}
    found = [next((by_word[w] for w in words if w in by_word), None) for words in _CALENDAR]
    clock = found[_DAY_PARTS:]
    if None in clock:
        return ()
    parts = clock if None in found else found
    return tuple(each for each in parts if each is not None)


def times_of_calendar(parts: Sequence[pl.Series]) -> pl.Series:
    """Log times from columns of year to second, or hour to second; null if one is missing."""
    numbers = [part.cast(pl.Float64, strict=False).alias(str(k)) for k, part in enumerate(parts)]
    frame = pl.DataFrame(numbers)
    hour, minute, second = (pl.col(str(len(parts) - k)) for k in (3, 2, 1))
    clock = (hour * 3600 + minute * 60) * NS + (second * NS).round()
    stamps = frame.select(clock.cast(pl.Int64, strict=False)).to_series()
    if len(parts) > _DAY_PARTS:
        whole = (pl.col(str(k)).cast(pl.Int32, strict=False) for k in range(_DAY_PARTS))
        day = frame.select(pl.date(*whole).cast(pl.Int32, strict=False).cast(pl.Int64)).to_series()
        stamps = stamps + day * DAY_NS
    return stamps.alias("log_time_ns")


def fraction_column_or_none(
    columns: Sequence[ColumnName], cells: Callable[[int], list[str]], place: int
) -> str | None:
    """Column of the fractions of a second, if the times have none; else None."""
    own = cells(place)
    if not own or any(re.search(r"[.,]\d|:\d+:\d+:", cell) for cell in own):
        return None
    is_clock = any(":" in cell for cell in own)
    names = [lower_case_letters(columns[place].name)]
    if not is_clock and not any(
        name in ("sec", "secs", "second", "seconds", "s", "ss") for name in names
    ):
        return None
    return next(
        (
            column.name
            for k, column in enumerate(columns)
            if k != place
            and fraction_unit_or_none(column.name) is not None
            and all(cell.isdigit() for cell in cells(k))
        ),
        None,
    )


def fraction_unit_or_none(name: str) -> str | None:
    """Unit of fractions of a second in a name: `nanosec`, `Millitm`."""
    word = lower_case_letters(name)
    by_beginning = (unit for start, unit in _BEGINNINGS.items() if word.startswith(start))
    return _FRACTIONS.get(word) or next(by_beginning, None)


def fractions_ns_and_unit(cells: pl.Series) -> tuple[pl.Series, str]:
    """Fractions of a second in ns, and their unit, from the name or from their size.

    Raises:
        TimeError: they are not fractions of a second.
    """
    numbers = cells.cast(pl.Float64, strict=False)
    largest, least = numbers.max(), numbers.min()
    if not isinstance(largest, float) or not isinstance(least, float) or least < 0:
        raise TimeError(f"column '{cells.name}' holds no fractions of a second")
    stated = fraction_unit_or_none(cells.name)
    possible = [unit for unit in ("ms", "us", "ns") if largest < NS / NS_PER_UNIT[unit]]
    unit = stated or (possible[0] if possible else "")
    if unit not in possible:
        raise TimeError(f"column '{cells.name}' holds no fractions of a second, but {largest:g}")
    return (numbers * NS_PER_UNIT[unit]).round().cast(pl.Int64, strict=False), unit
