"""Find the time columns of a table, and compute the times of its rows in integer nanoseconds."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl

from estimators.arrays import Floats
from replay.logs.tables.dates import (
    convert_calendar_columns_to_ns,
    convert_clock_times_and_list_notes,
    convert_local_times_to_utc,
    find_calendar_columns,
    has_time_of_day,
    is_date_only,
)
from replay.logs.tables.header import (
    ColumnName,
    does_name_state_multiple_of_unit,
    find_zone_offset_s,
    keep_column_name_before_dash,
    keep_last_part_of_column_name,
    reduce_to_lower_case_letters,
    split_unit_from_column_name,
)
from replay.logs.tables.hints import DialectError, TableHints, TimeAxis
from replay.logs.tables.only_time import find_sole_time_column
from replay.logs.tables.table_limits import LIMITS
from replay.logs.tables.times import (
    NS_PER_UNIT,
    RowTimes,
    TimeError,
    are_numbers_hhmmss,
    convert_second_fractions_to_ns,
    convert_times_to_ns,
    correct_labview_epoch,
    find_plausible_epoch,
    find_second_fraction_column,
    find_seconds_of_fraction,
    find_seconds_of_stamp,
    unwrap_counter,
)

#: Names of a time column, letters only, in the order in which they are searched.
_NAMES: Final = (
    *("t", "logtime", "time", "timestamp", "timestamps", "timestamputc", "datetime", "utctime"),
    *("elapsedtime", "elapsed", "sampletime", "recordtime", "zeit", "zeitstempel", "mstoday"),
    *("sec", "secs", "seconds", "second", "millis", "milliseconds", "micros", "microseconds"),
    *("epoch", "unixtime", "times", "timems", "timeus", "utc", "xvalue", "runtime", "gpstime"),
    *("gpst", "ts", "stamp", "headerstamp"),
    *("uhrzeit", "temps", "heure", "tiempo", "hora", "tempo", "ora", "czas", "tijd", "tid", "aika"),
    *("datahora", "dataora", "fechahora", "dateheure", "datumuhrzeit", "datumzeit", "dateandtime"),
    *("zaman", "время", "час", "idő", "timp", "čas", "thờigian", "waktu", "vrijeme", "χρόνος"),
    *("时间", "時間", "時刻", "시간"),
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
#: Units of time that a header may state, in ns.
_NS: Final = {**NS_PER_UNIT, "min": 60 * 10**9, "h": 3600 * 10**9}


@dataclass(frozen=True, slots=True)
class TableTimes:
    """Source of the times of the rows.

    Attributes:
        time: name of the time column; None for rows of a given rate, or with `calendar`.
        date: column of the dates, if the time is a time of day.
        fraction: column of the fractions of a second, if separate.
        calendar: columns of year to second, or of hour to second.
        unit: unit of numbers; None to detect it from range and spacing.
        day_first: whether dates begin with the day, if given.
        timezone: time zone of dates that name none, if given.
        rate_hz: rate of the rows, without a time column.
    """

    time: str | None
    date: str | None = None
    fraction: str | None = None
    calendar: tuple[str, ...] = ()
    unit: str | None = None
    day_first: bool | None = None
    timezone: str | None = None
    rate_hz: float | None = None

    @property
    def time_columns(self) -> tuple[str, ...]:
        """All columns of the time; errors name the last one."""
        own = (self.date, self.fraction, self.time)
        return (*self.calendar, *(name for name in own if name is not None))

    def compute_log_times_of_rows(self, cells: Mapping[str, pl.Series], row_count: int) -> RowTimes:
        """Compute the log times of the rows.

        Args:
            cells: cells of `time_columns` by name, (rows,) each.
            row_count: number of rows.

        Raises:
            TimeError: the cells are not times, or their unit is unknown.
        """
        if self.calendar:
            names = ", ".join(self.calendar)
            has_date = len(self.calendar) > 3
            whole = RowTimes(
                convert_calendar_columns_to_ns([cells[name] for name in self.calendar]),
                (f"its times are composed of {names}",),
                names_no_zone=has_date,
            )
            return self._add_second_fractions(self._convert_local_times(whole), cells)
        if self.time is None:
            assert self.rate_hz is not None
            every_ns = 10**9 / self.rate_hz
            counted = pl.int_range(row_count, eager=True)
            stamps = (counted.cast(pl.Float64) * every_ns).round().cast(pl.Int64)
            note = f"the rows have no time: they are read at {self.rate_hz:g} rows per second"
            return RowTimes(stamps.alias("log_time_ns"), (note,))
        one = self._convert_local_times(unwrap_counter(self._convert_one_time_column(cells)))
        return self._add_second_fractions(one, cells)

    def _convert_local_times(self, times: RowTimes) -> RowTimes:
        """Convert dates that name no zone from the given one to UTC, and say what was taken."""
        if not times.names_no_zone:
            return times
        note = f"the times name no zone: they are taken as {self.timezone or 'UTC'}"
        stamps = times.stamps
        if self.timezone is not None:
            stamps = convert_local_times_to_utc(stamps, self.timezone)
        return RowTimes(stamps, (*times.notes, note))

    def _add_second_fractions(self, seconds: RowTimes, cells: Mapping[str, pl.Series]) -> RowTimes:
        """Add fractions of a second from the column `fraction`, if there is one."""
        if self.fraction is None:
            return seconds
        fractions, unit = convert_second_fractions_to_ns(cells[self.fraction])
        note = f"the fractions of its seconds are those of '{self.fraction}', in {unit}"
        return RowTimes((seconds.stamps + fractions).alias("log_time_ns"), (*seconds.notes, note))

    def _convert_one_time_column(self, cells: Mapping[str, pl.Series]) -> RowTimes:
        assert self.time is not None
        text = cells[self.time]
        if self.date is not None:
            zone = find_zone_offset_s(self.time)
            if zone is None:
                zone = find_zone_offset_s(self.date)
            return convert_clock_times_and_list_notes(cells[self.date], text, self.day_first, zone)
        if text.dtype == pl.String:
            sample = text.head(1000).drop_nulls().str.strip_chars()
            words = sample.filter(sample != "").head(50).to_list()
            if words and sum(map(has_time_of_day, words)) * 2 > len(words):
                return convert_clock_times_and_list_notes(
                    None, text, self.day_first, find_zone_offset_s(self.time)
                )
            if words and sum(is_date_only(word) for word in words) * 2 > len(words):
                raise TimeError("it has dates without times of day; set [log] time")
        if self.unit in ("min", "h"):
            scaled = text.cast(pl.Float64, strict=False) * (_NS[self.unit] // 10**9)
            return RowTimes(convert_times_to_ns(scaled, "s"), ())
        if self.unit is not None or text.dtype.is_temporal():
            stamps, note = correct_labview_epoch(convert_times_to_ns(text, self.unit or "s"))
            is_local = isinstance(text.dtype, pl.Datetime) and text.dtype.time_zone is None
            return RowTimes(stamps, (note,) if note else (), names_no_zone=is_local)
        if self.fraction is not None:
            # a column with fractions of a second beside it is in seconds
            return RowTimes(convert_times_to_ns(text, "s"))
        return RowTimes(*convert_unitless_times_and_list_notes(text))


def find_time_columns_and_their_fields(
    columns: Sequence[ColumnName], cells: Callable[[int], list[str]], time_axis: TimeAxis | None
) -> list[tuple[TableTimes, list[str]]] | None:
    """Find the time columns, and the columns that each belongs to.

    Args:
        columns: columns of the table.
        cells: returns some cells of a column, by index.
        time_axis: time column and format given by the user.

    Returns:
        Times with the names of their columns, one or several; None without a time column.
    """
    table = time_axis.table if time_axis else None
    day_first, timezone = (table.day_first, table.timezone) if table else (None, None)
    names = [column.name for column in columns]
    unit = time_axis.unit if time_axis else None
    if table is not None and table.rate_hz is not None and (time_axis and time_axis.column is None):
        return [(TableTimes(None, rate_hz=table.rate_hz), names)]
    if time_axis is not None and time_axis.column is not None:
        place = names.index(time_axis.column)
        if unit is None:
            unit = find_time_unit(columns[place])
        return [(_locate_time_columns(columns, cells, place, unit, table), names)]
    if calendar := find_calendar_columns(columns):
        fraction = find_second_fraction_column(columns, cells, names.index(calendar[-1]))
        times = TableTimes(None, fraction=fraction, calendar=calendar, timezone=timezone)
        return [(times, names)]
    found = rank_candidate_time_columns(columns, cells) or find_seconds_of_stamp(names)
    found = found or find_sole_time_column(columns, cells)
    for part in (keep_last_part_of_column_name, keep_column_name_before_dash) if not found else ():
        columns = [part(column) for column in columns]
        if found := rank_candidate_time_columns(columns, cells):
            break
    if not found:
        return None
    first = found[0]
    times = [
        k
        for k in found
        if columns[k].bare.lower() == columns[first].bare.lower()
        and columns[k].unit == columns[first].unit
    ]
    one = _locate_time_columns(columns, cells, first, unit or find_time_unit(columns[first]), table)
    if len(times) == 1 or one.date:
        return [(one, names)]
    # pairs of time and value: each column belongs to the time column before it
    ends = [*times[1:], len(names)]
    return [
        (
            TableTimes(
                names[at],
                unit=unit or find_time_unit(columns[at]),
                day_first=day_first,
                timezone=timezone,
            ),
            names[start:end],
        )
        for at, start, end in zip(times, [0, *times[1:]], ends, strict=True)
    ]


def _locate_time_columns(
    columns: Sequence[ColumnName],
    cells: Callable[[int], list[str]],
    time_column_index: int,
    time_unit: str | None,
    table: TableHints | None,
) -> TableTimes:
    """Source of the times of all columns: the time column, and its date and fraction columns."""
    fraction = table.time_fraction if table else None
    if fraction is not None and fraction not in [column.name for column in columns]:
        raise DialectError(f"no column '{fraction}' for [log] time_fraction; correct its name")
    return TableTimes(
        columns[time_column_index].name,
        find_date_column(columns, cells, time_column_index),
        fraction or find_second_fraction_column(columns, cells, time_column_index),
        unit=time_unit,
        day_first=table.day_first if table else None,
        timezone=table.timezone if table else None,
    )


def rank_candidate_time_columns(
    columns: Sequence[ColumnName], cells: Callable[[int], list[str]]
) -> list[int]:
    """List the indices of possible time columns: by rank of their names, with a unit of time first.

    A column with repeated values comes last, since another may have a finer resolution. The two
    columns of a stamp in seconds and fractions are excluded, since neither is a time by itself.
    """
    ranked: list[tuple[bool, int, int, int]] = []
    names = [column.name for column in columns]
    has_fraction = any(find_seconds_of_fraction(name, names) for name in names)
    for place, column in enumerate(columns):
        is_half_of_stamp = has_fraction and "stamp" in column.bare
        if is_half_of_stamp or find_seconds_of_fraction(column.name, names):
            continue
        # a name with a number may be an axis or a state: time1, t_2
        bare = reduce_to_lower_case_letters(column.bare)
        if reduce_to_lower_case_letters(column.name) in ("mstoday", "timeus", "timems"):
            bare = reduce_to_lower_case_letters(column.name)
        if re.search(r"\d", re.sub(r" \(\d+\)$", "", column.bare)):
            continue
        if bare in _NAMES and (column.unit is None or column.unit in _NS):
            stated = list(NS_PER_UNIT).index(column.unit) if column.unit in NS_PER_UNIT else -1
            rank = -stated if stated >= 0 else 9
            ranked.append((_has_repeated_times(cells(place)), rank, _NAMES.index(bare), place))
        elif (bare in _DATES or "time" in bare) and any(map(has_time_of_day, cells(place)[:5])):
            ranked.append((_has_repeated_times(cells(place)), 10, bare not in _DATES, place))
    return [place for *_, place in sorted(ranked)]


def _has_repeated_times(cells: Sequence[str]) -> bool:
    return 2 * len(set(cells)) < len(cells)


def find_time_unit(column_name: ColumnName) -> str | None:
    """Unit of time stated in a column's name; None without one.

    Raises:
        DialectError: the name states a multiple of a unit.
    """
    if does_name_state_multiple_of_unit(column_name.name):
        raise DialectError(
            f"column '{column_name.name}' counts multiples of a unit of time; set [log] rate_hz = "
            "rows per second"
        )
    if column_name.unit in _NS:
        return column_name.unit
    return _UNITS.get(reduce_to_lower_case_letters(column_name.name)) or (
        unit if (unit := split_unit_from_column_name(column_name.name)[1]) in _NS else None
    )


def find_date_column(
    columns: Sequence[ColumnName], cells: Callable[[int], list[str]], column_index: int
) -> str | None:
    """Find the column of dates of a time of day; None if there is none, or times have dates."""
    own = cells(column_index)[:5]
    if (
        not own
        or not all(has_time_of_day(cell) for cell in own)
        or any(is_date_only(c[:10]) for c in own)
    ):
        return None
    dated = reduce_to_lower_case_letters(columns[column_index].bare).replace("time", "date")
    dates = [
        column.name
        for k, column in enumerate(columns)
        if k != column_index
        and reduce_to_lower_case_letters(column.bare) in (*_DATES, dated)
        and all(map(is_date_only, cells(k)[:5] or ""))
    ]
    return dates[0] if dates else None


def convert_unitless_times_and_list_notes(cells: pl.Series) -> tuple[pl.Series, tuple[str, ...]]:
    """Log times of numbers without a unit, and notes on the detected unit.

    Args:
        cells: (rows,), text or numbers.

    Returns:
        Stamps in ns, null if missing; and notes on what was detected.

    Raises:
        TimeError: several units are possible, or none.
    """
    stripped = cells.str.strip_chars() if cells.dtype == pl.String else cells
    numbers = stripped.cast(pl.Float64, strict=False)
    finite = numbers.filter(numbers.is_finite().fill_null(value=False)).to_numpy()
    if not finite.size:
        return convert_times_to_ns(cells, "s"), ()
    x = np.sort(finite)
    steps = np.diff(x)
    steps = steps[steps > 0]
    if not steps.size:
        raise TimeError("all its cells hold the same number")
    step, span = float(np.median(steps)), float(x[-1] - x[0])
    if epoch := find_plausible_epoch(float(x[0]), float(x[-1]), step, LIMITS.row_steps_s):
        integers = stripped.cast(pl.Int64, strict=False)
        exact = not stripped.dtype.is_float() and integers.count() == numbers.count()
        return epoch.to_unix_ns(integers if exact else numbers), (f"its times are {epoch.name}",)
    if are_numbers_hhmmss(finite, step):
        hours, rest = numbers // 10_000, numbers % 10_000
        seconds = hours * 3600 + (rest // 100) * 60 + rest % 100
        return convert_times_to_ns(seconds, "s"), ("its times are read as hhmmss.s",)
    unit = guess_time_unit(x, step, span)
    stamps, note = correct_labview_epoch(convert_times_to_ns(cells, unit))
    taken = f"its times are read in {unit}, as their spacing suggests"
    return stamps, (taken, note) if note else (taken,)


def guess_time_unit(first_values: Floats, step: float, total_span: float) -> str:
    """Find the only unit of time that is possible; raise an error if there are none or several."""
    possible = [
        unit
        for unit, ns in NS_PER_UNIT.items()
        if LIMITS.row_steps_s[0] <= step * ns / 1e9 <= LIMITS.row_steps_s[1]
        and (total_span * ns / 1e9 >= LIMITS.shortest_log_s or first_values.size < 3)
    ]
    if len(possible) == 1:
        return possible[0]
    since_1970 = [
        unit
        for unit in possible
        if LIMITS.epoch_s[0] <= first_values[0] * NS_PER_UNIT[unit] / 1e9
        and first_values[-1] * NS_PER_UNIT[unit] / 1e9 <= LIMITS.epoch_s[1]
    ]
    if len(since_1970) == 1:
        return since_1970[0]
    said = " or ".join(possible) if possible else "s, ms, us or ns"
    raise TimeError(
        f"its steps of {step:g} may be {said}: set [log] time_unit, or, where it counts "
        "rows, [log] rate_hz = rows per second,"
    )
