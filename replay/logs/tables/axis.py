"""Which columns are a table's time, and the time of its rows as integer nanoseconds."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import polars as pl

from replay.logs.tables.dates import clock_times, is_clock, is_date
from replay.logs.tables.header import ColumnName, split_unit
from replay.logs.tables.hints import TimeAxis
from replay.logs.tables.times import NS_PER_UNIT, TimeError, nanoseconds
from replay.logs.tables.unit_of_time import recognised_times

#: Names of a time column without what is no letter, in the order they are looked for.
_NAMES: Final = (
    *("t", "logtime", "time", "timestamp", "timestamps", "timestamputc", "datetime", "utctime"),
    *("elapsedtime", "elapsed", "sampletime", "recordtime", "zeit", "zeitstempel", "mstoday"),
    *("sec", "secs", "seconds", "second", "millis", "milliseconds", "micros", "microseconds"),
    *("epoch", "unixtime", "times", "timems", "timeus", "utc", "xvalue"),
)
_DATES: Final = ("date", "day", "datum", "dateutc", "utcdate")
_UNITS: Final = {
    "mstoday": "ms",
    "millis": "ms",
    "milliseconds": "ms",
    "timems": "ms",
    "sec": "s",
    "secs": "s",
    "seconds": "s",
    "second": "s",
    "micros": "us",
    "microseconds": "us",
    "timeus": "us",
}
#: The units of time that a header may state, in ns.
_NS: Final = {**NS_PER_UNIT, "min": 60 * 10**9, "h": 3600 * 10**9}


@dataclass(frozen=True, slots=True)
class RowTimes:
    """Log times of rows, null where a row has none; and what was recognised."""

    stamps: pl.Series
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class TableTimes:
    """The time of the rows.

    Attributes:
        columns: the time column; the date before the time of day; none for rows of a given rate.
        unit: of numbers; None: told by their range and spacing.
        day_first: of dates, where it is given.
        rate_hz: of the rows where there is no time column.
    """

    columns: tuple[str, ...]
    unit: str | None = None
    day_first: bool | None = None
    rate_hz: float | None = None
    known: bool = False

    def stamps(self, cells: Sequence[pl.Series], rows: int) -> RowTimes:
        """Log times of the rows.

        Args:
            cells: of `columns`, (rows,) each.
            rows: how many there are.

        Raises:
            TimeError: the cells are no times, or are in a unit that is not known.
        """
        if not cells:
            assert self.rate_hz is not None
            every_ns = 10**9 / self.rate_hz
            counted = pl.int_range(rows, eager=True)
            stamps = (counted.cast(pl.Float64) * every_ns).round().cast(pl.Int64)
            note = f"the rows have no time: they are taken as {self.rate_hz:g} a second"
            return RowTimes(stamps.alias("log_time_ns"), (note,))
        text = cells[-1]
        if len(cells) > 1:
            return RowTimes(*clock_times(cells[0], text, self.day_first))
        if text.dtype == pl.String:
            sample = text.head(1000).drop_nulls().str.strip_chars()
            words = sample.filter(sample != "").head(50).to_list()
            if words and sum(map(is_clock, words)) * 2 > len(words):
                return RowTimes(*clock_times(None, text, self.day_first))
            if words and sum(is_date(word) for word in words) * 2 > len(words):
                raise TimeError("it holds days without a time of day; name the column of times")
        if self.unit in ("min", "h"):
            scaled = text.cast(pl.Float64, strict=False) * (_NS[self.unit] // 10**9)
            return RowTimes(nanoseconds(scaled, "s"), ())
        if self.unit is not None or text.dtype.is_temporal():
            return RowTimes(nanoseconds(text, self.unit or "s"))
        return RowTimes(*recognised_times(text))


def find_times(
    columns: Sequence[ColumnName], cells: Callable[[int], list[str]], given: TimeAxis | None
) -> list[tuple[TableTimes, list[str]]] | None:
    """Find the time columns, and the columns that each is the time of.

    Args:
        columns: of the table.
        cells: some cells of a column by its place.
        given: what a person said.

    Returns:
        The times with the names of their columns: one, or several where pairs of time and value
        stand side by side; None where there is no time column.
    """
    table = given.table if given else None
    day_first = table.day_first if table else None
    names = [column.name for column in columns]
    unit = given.unit if given else None
    if table is not None and table.rate_hz is not None and (given and given.column is None):
        return [(TableTimes((), rate_hz=table.rate_hz), names)]
    if given is not None and given.column is not None:
        place = names.index(given.column)
        if unit is None:
            unit = _unit(columns[place])
        date = _date_beside(columns, cells, place)
        return [(TableTimes((*date, given.column), unit, day_first), names)]
    found = _candidates(columns, cells)
    if not found:
        return None
    first = found[0]
    date = _date_beside(columns, cells, first)
    times = [
        k
        for k in found
        if columns[k].bare.lower() == columns[first].bare.lower()
        and columns[k].unit == columns[first].unit
    ]
    if len(times) == 1 or date:
        axis = TableTimes((*date, names[first]), unit or _unit(columns[first]), day_first)
        return [(axis, names)]
    # pairs side by side: each column belongs to the time before it
    ends = [*times[1:], len(names)]
    return [
        (TableTimes((names[at],), unit or _unit(columns[at]), day_first), names[start:end])
        for at, start, end in zip(times, [0, *times[1:]], ends, strict=True)
    ]


def _letters(text: str) -> str:
    return re.sub(r"[^a-zäöü]", "", text.lower())


def _candidates(columns: Sequence[ColumnName], cells: Callable[[int], list[str]]) -> list[int]:
    """Places of time columns, the best name first; a unit of time in the name is better."""
    ranked: list[tuple[int, int, int]] = []
    for place, column in enumerate(columns):
        # what stands behind a number is an axis or a state: time1, t_2
        bare = _letters(column.bare)
        if _letters(column.name) in ("mstoday", "timeus", "timems"):
            bare = _letters(column.name)
        if re.search(r"\d", re.sub(r" \(\d+\)$", "", column.bare)):
            continue
        if bare in _NAMES and (column.unit is None or column.unit in _NS):
            stated = list(NS_PER_UNIT).index(column.unit) if column.unit in NS_PER_UNIT else -1
            ranked.append((-stated if stated >= 0 else 9, _NAMES.index(bare), place))
        elif bare in _DATES and any(map(is_clock, cells(place)[:5])):
            ranked.append((10, 0, place))
    return [place for *_, place in sorted(ranked)]


def _unit(column: ColumnName) -> str | None:
    """The unit of time that a column's name states."""
    if column.unit in _NS:
        return column.unit
    return _UNITS.get(_letters(column.name)) or (
        unit if (unit := split_unit(column.name)[1]) in _NS else None
    )


def _date_beside(
    columns: Sequence[ColumnName], cells: Callable[[int], list[str]], place: int
) -> tuple[str, ...]:
    """The column of the days, where the time is one of day."""
    own = cells(place)[:5]
    if not own or not all(is_clock(cell) for cell in own) or any(is_date(c[:10]) for c in own):
        return ()
    dates = [
        column.name
        for k, column in enumerate(columns)
        if k != place and _letters(column.bare) in _DATES and all(map(is_date, cells(k)[:5] or ""))
    ]
    return tuple(dates[:1])
