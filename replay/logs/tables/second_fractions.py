"""Fractions of a second in a column beside that of the seconds."""

import re
from collections.abc import Callable, Collection, Sequence
from typing import Final, NamedTuple

import polars as pl

from analysis.model.physical_units import NS
from replay.logs.tables.dates import reduce_to_lower_case_letters
from replay.logs.tables.header import ColumnName
from replay.logs.tables.times import NS_PER_UNIT, TimeError

#: Names of a column of the fraction of a second.
_FRACTIONS: Final = {
    **dict.fromkeys(("ms", "msec", "msecs", "millis", "millisecond", "milliseconds"), "ms"),
    **dict.fromkeys(("us", "usec", "usecs", "micros", "microsecond", "microseconds"), "us"),
    **dict.fromkeys(("ns", "nsec", "nsecs", "nanos", "nanosec", "nanosecs", "nanoseconds"), "ns"),
}
_WHOLE_SECONDS: Final = ("sec", "secs", "second", "seconds", "s", "ss")
_BEGINNINGS: Final = {"milli": "ms", "micro": "us", "nano": "ns"}


def find_second_fraction_column(
    columns: Sequence[ColumnName], cells: Callable[[int], list[str]], column_index: int
) -> str | None:
    """Column of the fractions of a second, if the times have none; else None."""
    own = cells(column_index)
    if not own or any(re.search(r"[.,]\d|:\d+:\d+:", cell) for cell in own):
        return None
    place, name = _split_place_and_field(columns[column_index].name)
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
            and all(cell.isdigit() for cell in cells(k))
        ),
        None,
    )


def is_fraction_beside_seconds(column_name: str, all_names: Collection[str]) -> bool:
    """Whether a column holds the fractions of the seconds in another of the same message."""
    place, name = _split_place_and_field(column_name)
    beside = any(f"{place}{seconds}" in all_names for seconds in _WHOLE_SECONDS)
    return beside and find_unit_of_second_fractions(name) is not None


def _split_place_and_field(column_name: str) -> tuple[str, str]:
    """Where a field is in its message, and its name in lower case: header.stamp.sec."""
    place = column_name[: max(column_name.rfind(each) for each in "./_") + 1]
    return place, reduce_to_lower_case_letters(column_name.removeprefix(place))


def find_unit_of_second_fractions(name: str) -> str | None:
    """Unit of fractions of a second in a name: `nanosec`, `Millitm`."""
    word = reduce_to_lower_case_letters(name)
    by_beginning = (unit for start, unit in _BEGINNINGS.items() if word.startswith(start))
    return _FRACTIONS.get(word) or next(by_beginning, None)


class SecondFractions(NamedTuple):
    """Fractions of a second in ns, and the unit that they had."""

    fractions_ns: pl.Series
    unit: str


def convert_second_fractions_to_ns(cells: pl.Series) -> SecondFractions:
    """Fractions of a second in ns, and their unit, from the name or from their size.

    Raises:
        TimeError: they are not fractions of a second.
    """
    numbers = cells.cast(pl.Float64, strict=False)
    largest, least = numbers.max(), numbers.min()
    if not isinstance(largest, float) or not isinstance(least, float) or least < 0:
        raise TimeError(f"column '{cells.name}' holds no fractions of a second")
    _, field = _split_place_and_field(cells.name)
    stated = find_unit_of_second_fractions(cells.name) or find_unit_of_second_fractions(field)
    possible = [unit for unit in ("ms", "us", "ns") if largest < NS / NS_PER_UNIT[unit]]
    unit = stated or (possible[0] if possible else "")
    if unit not in possible:
        raise TimeError(f"column '{cells.name}' holds no fractions of a second, but {largest:g}")
    return SecondFractions((numbers * NS_PER_UNIT[unit]).round().cast(pl.Int64, strict=False), unit)
