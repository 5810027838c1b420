"""Convert dates and times of day, in text or in several columns, to integer nanoseconds."""

import re
from collections.abc import Sequence
from typing import Final

import numpy as np
import polars as pl

from analysis.model.physical_units import NS
from analysis.model.windows import find_flagged_runs
from estimators.arrays import Bools, Ints
from replay.logs.tables.header import ColumnName, reduce_to_lower_case_letters
from replay.logs.tables.table_limits import LIMITS
from replay.logs.tables.times import RowTimes, TimeError

#: First letters of the names of months, in the languages of Western Europe.
_MONTHS: Final = (
    ("jan", "jän", "ene", "gen"),
    ("feb", "fév", "fev"),
    ("mar", "mär", "mrz", "mrt"),
    ("apr", "avr", "abr"),
    ("may", "mai", "mei", "mag", "maj"),
    ("jun", "juin", "giu"),
    ("jul", "juil", "lug"),
    ("aug", "aoû", "aou", "ago"),
    ("sep", "set"),
    ("oct", "okt", "ott", "out"),
    ("nov",),
    ("dec", "dez", "déc", "dic"),
)
_MONTH_OF: Final = {each: k for k, names in enumerate(_MONTHS, start=1) for each in names}
_MONTH: Final = "(?i:" + "|".join(_MONTH_OF) + r")[^\W\d_]*"
_CLOCK: Final = (
    r"(?P<h>\d{1,2}):(?P<min>\d{2})(?::(?P<s>\d{2})(?:[.,:;](?P<frac>\d{1,9})\d*)?)?"
    r"\s*(?P<half>[AaPp])?\.?\s?(?:[Mm]\.?)?\s*(?P<zone>Z|UTC|GMT|[+-]\d{2}(?::?\d{2})?)?"
)
#: Forms of dates: year first, as in ISO 8601; two numbers and a year; with the name of the month.
_YEAR_FIRST: Final = r"(?P<y>\d{4})(?:[-/年]|\. ?)(?P<m>\d{1,2})(?:[-/月]|\. ?)(?P<d>\d{1,2})[.日]?"
_YEAR_LAST: Final = r"(?P<one>\d{1,2})(?P<sign>[-/.])(?P<two>\d{1,2})[-/.](?P<y>\d{4}|\d{2})\.?"
_DAY_MONTH: Final = rf"(?P<d>\d{{1,2}})[-/. ]+(?P<name>{_MONTH})[-/., ]+(?P<y>\d{{4}}|\d{{2}})"
_MONTH_DAY: Final = rf"(?P<name>{_MONTH})[-/. ]+(?P<d>\d{{1,2}}),?[-/. ]+(?P<y>\d{{4}})"
_COMPACT: Final = r"(?P<y>(?:19|20)\d{2})(?P<m>0[1-9]|1[0-2])(?P<d>0[1-9]|[12]\d|3[01])"
_DATES: Final = (_YEAR_FIRST, _YEAR_LAST, _DAY_MONTH, _MONTH_DAY, _COMPACT)
_WEEKDAY: Final = r"(?:(?i:mon|tue|wed|thu|fri|sat|sun)[a-z]*,?\s+)?"
_COMPACT_CLOCK: Final = (
    r"(?P<h>[01]\d|2[0-3])(?P<min>[0-5]\d)(?P<s>[0-5]\d)(?:[.,]?(?P<frac>\d{1,9})\d*)?(?P<zone>Z)?"
)
#: Form of `date` and Java, with the year after the zone: Fri Nov 13 08:15:30 GMT+00:00 2026.
_YEAR_BEHIND: Final = (
    rf"(?P<name>{_MONTH}) +(?P<d>\d{{1,2}}) +(?P<h>\d{{1,2}}):(?P<min>\d{{2}}):(?P<s>\d{{2}})"
    r"(?:[.,](?P<frac>\d{1,9})\d*)?(?: +(?:UTC|GMT)?(?P<zone>Z|UTC|GMT|[+-]\d{2}:?\d{2})?)? +"
    r"(?P<y>\d{4})"
)
#: Nanoseconds of a day.
DAY_NS: Final = 86_400 * 10**9
_HALF_DAY_NS: Final = DAY_NS // 2
#: Minutes and seconds without hours; the minutes may exceed 59.
_MINUTES: Final = r"(?P<min>\d{1,3}):(?P<s>\d{2})[.,](?P<frac>\d{1,9})"
#: Time since the start, in the form of pandas and Python: 0 days 00:00:12.5.
_SINCE: Final = rf"(?P<days>\d+) days?,? {_CLOCK}"
#: A date and time of day in digits alone; no counter has such a value before 2033.
_DIGITS: Final = rf"{_COMPACT}(?:[T, ]\s*)?{_COMPACT_CLOCK}"
#: Names of the columns of date and time of day, from year to second.
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


def is_date_and_time_in_digits(cell: str) -> bool:
    """Whether a number is a date with a time of day: 20261113081530020."""
    return re.fullmatch(_DIGITS, cell) is not None


def is_date_only(cell: str) -> bool:
    """Whether a cell is a date without a time of day; digits alone count as a number."""
    return any(
        re.fullmatch(_WEEKDAY + pattern, cell.strip()) for pattern in _DATES if pattern != _COMPACT
    )


def has_time_of_day(cell: str) -> bool:
    """Whether a cell is a time of day, with or without a date."""
    text = cell.strip()
    if any(re.fullmatch(pattern, text) for pattern in (_MINUTES, _CLOCK, _SINCE)):
        return True
    return find_datetime_pattern(text) is not None


def find_datetime_pattern(text: str) -> str | None:
    """Regular expression of a date with a time of day that matches a text; None if none does."""
    days = [pattern for pattern in _DATES if pattern != _COMPACT]
    moments = [rf"{day}(?:[T, ]|\s+@)\s*{_CLOCK}" for day in days]
    behind = [rf"{_CLOCK}[, ]\s*{day}" for day in days]
    for moment in (*moments, _DIGITS, _YEAR_BEHIND, *behind):
        if re.fullmatch(_WEEKDAY + moment, text):
            return f"^{_WEEKDAY}{moment}$"
    return None


def convert_clock_times_and_list_notes(
    dates: pl.Series | None,
    times: pl.Series,
    is_day_first: bool | None,
    zone_offset_s: int | None = None,
) -> RowTimes:
    """Compute log times from dates and times of day, with notes on assumptions.

    Args:
        dates: (rows,) dates; None if the times include them, or there are none.
        times: (rows,) times of day, with or without dates.
        is_day_first: whether the day is before the month, if given.
        zone_offset_s: offset in s of a time zone in the column's name, for cells without a zone.

    Raises:
        TimeError: day and month cannot be distinguished.
    """
    text = times.str.strip_chars()
    if dates is not None:
        text = _join_dates_and_times(dates, text)
    present = text.filter(text.is_not_null() & (text != ""))
    if present.is_empty():
        return RowTimes(pl.Series("log_time_ns", [None] * text.len(), dtype=pl.Int64))
    first = str(present[0])
    pattern = find_datetime_pattern(first)
    if pattern is None:
        return RowTimes(*parse_times_of_day_and_list_notes(text, first))
    part = extract_named_groups(text, pattern)
    notes: list[str] = []
    day = count_days_since_1970(part, is_day_first, notes)
    stamps = day * DAY_NS + convert_time_of_day_to_ns(part)
    names_no_zone = part.get_column("zone").drop_nulls().is_empty()
    if names_no_zone and zone_offset_s is not None:
        stamps, names_no_zone = stamps - zone_offset_s * 10**9, False
    return RowTimes(stamps.alias("log_time_ns"), tuple(notes), names_no_zone)


def convert_local_times_to_utc(stamps: pl.Series, zone: str) -> pl.Series:
    """Convert times of a zone, as if they were UTC, to UTC.

    When clocks are set back, an hour comes twice: rows belong to the second one from where the
    time falls back, or if rows after that hour follow them and none before it is near.

    Args:
        stamps: (rows,) local times in ns since 1970, null if missing.
        zone: name of a time zone.

    Raises:
        TimeError: a time does not exist in the zone, since clocks were set forward.
    """
    local = stamps.cast(pl.Datetime("ns"))
    first, second = (
        local.dt.replace_time_zone(zone, ambiguous=which, non_existent="null").cast(pl.Int64)
        for which in ("earliest", "latest")
    )
    missing = first.is_null() & stamps.is_not_null()
    if missing.any():
        raise TimeError(
            f"{local.filter(missing)[0]:%Y-%m-%d %H:%M:%S} does not exist in {zone}, where clocks "
            "were set forward; the log's clock was not: set [log] timezone to a zone without "
            "summer time, such as Etc/GMT-1 for UTC+1,"
        )
    twice = (first != second).fill_null(value=False)
    if not twice.any():
        return first.alias(stamps.name)
    known = stamps.is_not_null()
    is_second = np.zeros(stamps.len(), dtype=bool)
    is_second[known.to_numpy()] = _mark_second_occurrence_of_repeated_hour(
        stamps.filter(known).to_numpy(), twice.filter(known).to_numpy()
    )
    return second.zip_with(pl.Series(is_second), first).alias(stamps.name)


def _mark_second_occurrence_of_repeated_hour(local_ns: Ints, is_repeated: Bools) -> Bools:
    """Mark the rows of the second of two hours of one name, (rows,).

    Args:
        local_ns: (rows,) local times, none missing.
        is_repeated: (rows,) whether the time comes twice.

    Raises:
        TimeError: the rows are not in order of time, so that their order shows nothing.
    """
    steps_ns = np.diff(local_ns)
    falls = steps_ns < -LIMITS.set_back_ns
    is_descending = 2 * np.count_nonzero((steps_ns < 0) & ~falls) > steps_ns.size
    if is_descending or (falls & ~(is_repeated[:-1] & is_repeated[1:])).any():
        raise TimeError(
            "its times occur twice in the hour when clocks are set back, and the rows are not in "
            "recorded order, which would tell the two hours apart; sort them"
        )
    is_second = np.zeros(is_repeated.size, dtype=bool)
    for start, end in zip(*find_flagged_runs(is_repeated), strict=True):
        fallen = np.flatnonzero(falls[start:end])
        if fallen.size > 1:
            raise TimeError(
                "its times jump back twice or more in the hour when clocks are set back"
            )
        if fallen.size:
            is_second[start + int(fallen[0]) + 1 : end + 1] = True
        elif end < steps_ns.size and steps_ns[end] < LIMITS.set_back_ns:
            before_ns = steps_ns[start - 1] if start else LIMITS.set_back_ns
            is_second[start : end + 1] = before_ns >= LIMITS.set_back_ns
    return is_second


def _join_dates_and_times(dates: pl.Series, times: pl.Series) -> pl.Series:
    frame = pl.DataFrame({"date": dates.str.strip_chars(), "time": times})
    return frame.select(pl.concat_str("date", "time", separator=" ")).to_series()


def extract_named_groups(text: pl.Series, pattern: str) -> pl.DataFrame:
    """Extract the named groups of a pattern, a column each; null if a cell does not match."""
    names = tuple(re.compile(pattern).groupindex)
    found = text.str.extract_groups(pattern).struct.unnest()
    found.columns = list(names)
    missing = [n for n in ("h", "min", "s", "frac", "half", "zone") if n not in names]
    return found.with_columns(pl.lit(None, dtype=pl.String).alias(name) for name in missing)


def _cast_to_whole_number(column: pl.Expr) -> pl.Expr:
    return column.cast(pl.Int64, strict=False)


def convert_time_of_day_to_ns(time_groups: pl.DataFrame) -> pl.Series:
    """Time of day in ns from columns of hour, minute, second, fraction and zone; in UTC."""
    hour, half = _cast_to_whole_number(pl.col("h")), pl.col("half").str.to_lowercase()
    hour = (
        pl.when(half == "p").then(hour % 12 + 12).when(half == "a").then(hour % 12).otherwise(hour)
    )
    fraction = pl.col("frac").str.pad_end(9, "0").cast(pl.Int64, strict=False).fill_null(0)
    zone = pl.col("zone").str.replace(":", "")
    sign = pl.when(zone.str.starts_with("-")).then(-1).otherwise(1)
    offset = (
        sign
        * (
            _cast_to_whole_number(zone.str.slice(1, 2)).fill_null(0) * 3600
            + _cast_to_whole_number(zone.str.slice(3, 2)).fill_null(0) * 60
        )
    ).fill_null(0)
    seconds = (
        hour * 3600
        + _cast_to_whole_number(pl.col("min")) * 60
        + _cast_to_whole_number(pl.col("s")).fill_null(0)
        - offset
    )
    return time_groups.select(seconds * 10**9 + fraction).to_series()


def count_days_since_1970(
    date_groups: pl.DataFrame, is_day_first: bool | None, notes: list[str]
) -> pl.Series:
    """Days from 1970-01-01 to each date; null if it is invalid."""
    if "one" in date_groups.columns:
        date_groups = decide_which_number_is_day(date_groups, is_day_first, notes)
    if "name" in date_groups.columns:
        date_groups = split_dates_with_short_years(date_groups, is_day_first)
        starts = [pl.col("name").str.to_lowercase().str.starts_with(each) for each in _MONTH_OF]
        months = zip(starts, _MONTH_OF.values(), strict=True)
        number = pl.coalesce(pl.when(fits).then(month) for fits, month in months)
        date_groups = date_groups.with_columns(number.cast(pl.String).alias("m"))
    years = date_groups.get_column("y").cast(pl.Int64, strict=False).drop_nulls()
    odd = years.filter((years < LIMITS.years[0]) | (years > LIMITS.years[1]))
    if odd.len():
        raise TimeError(
            f"'{odd[0]}' is not a plausible year of the Gregorian calendar; set [log] rate_hz = "
            "rows per second,"
        )
    written = pl.concat_str("y", pl.lit("-"), "m", pl.lit("-"), "d")
    day = written.str.to_date("%Y-%m-%d", strict=False)
    return date_groups.select(day.cast(pl.Int32).cast(pl.Int64)).to_series()


def split_dates_with_short_years(
    date_groups: pl.DataFrame, is_day_first: bool | None
) -> pl.DataFrame:
    """Assign day and year of dates with month names and two-digit years, in either order.

    Raises:
        TimeError: it is ambiguous which number is the year.
    """
    is_short = pl.col("y").str.len_chars() == 2
    if not date_groups.select(is_short.any()).item():
        return date_groups
    if is_day_first is None:
        first = date_groups.filter(is_short).row(0, named=True)
        raise TimeError(
            f"'{first['d']}-{first['name']}-{first['y']}' has a two-digit year: set [log] "
            "day_first = true for day, month, year, false for year, month, day"
        )
    day, year = ("d", "y") if is_day_first else ("y", "d")
    return date_groups.with_columns(pl.col(day).alias("d"), ("20" + pl.col(year)).alias("y"))


def decide_which_number_is_day(
    date_groups: pl.DataFrame, is_day_first: bool | None, notes: list[str]
) -> pl.DataFrame:
    """Decide which of two numbers is the day: the one that exceeds 12 in any row."""
    one, two = (date_groups.get_column(n).cast(pl.Int64, strict=False) for n in ("one", "two"))
    short = date_groups.get_column("y").drop_nulls().str.len_chars().to_list()
    example = "/".join(str(date_groups.row(0, named=True)[n]) for n in ("one", "two", "y"))
    largest = [int(x.max() or 0) for x in (one, two)]  # pyright: ignore[reportArgumentType] of integers
    if is_day_first is None:
        dots = date_groups.get_column("sign").drop_nulls().head(1).to_list() == ["."]
        same = bool((one == two).all())
        if short and short[0] == 2:
            raise TimeError(
                f"'{example}' has a two-digit year: set [log] day_first = true for day, "
                "month, year, false for month, day, year"
            )
        if largest[0] > 12 or dots or same:
            is_day_first = True
        elif largest[1] > 12:
            is_day_first = False
        else:
            raise TimeError(
                f"'{example}' may begin with the day or the month: set [log] day_first = true or "
                "false"
            )
        if not same:
            notes.append(f"dates are read with the {'day' if is_day_first else 'month'} first")
    day, month = ("one", "two") if is_day_first else ("two", "one")
    year = pl.when(pl.col("y").str.len_chars() == 2).then("20" + pl.col("y"))
    return date_groups.with_columns(
        pl.col(day).alias("d"), pl.col(month).alias("m"), year.otherwise(pl.col("y")).alias("y")
    )


def parse_times_of_day_and_list_notes(
    text: pl.Series, first_clock_time: str
) -> tuple[pl.Series, tuple[str, ...]]:
    """Parse times of day without a date as ns from the first midnight, and list notes."""
    if re.fullmatch(_SINCE, first_clock_time):
        part = extract_named_groups(text, f"^{_SINCE}$")
        day = part.select(_cast_to_whole_number(pl.col("days"))).to_series()
        return (convert_time_of_day_to_ns(part) + day * DAY_NS).alias("log_time_ns"), ()
    pattern = f"^{_CLOCK}$"
    if re.fullmatch(_MINUTES, first_clock_time):
        pattern = f"^{_MINUTES}$"
    elif first_clock_time.count(":") < 2:
        raise TimeError(
            f"'{first_clock_time}' may be hours and minutes or minutes and seconds; export it as "
            "hh:mm:ss, or set another column as [log] time"
        )
    part = extract_named_groups(text, pattern)
    if pattern != f"^{_CLOCK}$":
        part = part.with_columns(h=pl.lit("0"))
    stamps = convert_time_of_day_to_ns(part)
    frame = pl.DataFrame({"t": stamps})
    step = pl.col("t").forward_fill().diff()
    has_halves = part.get_column("half").drop_nulls().len() > 0
    back = frame.select(step).to_series()
    twelve = ((back < -LIMITS.twelve_hours_ns[0]) & (back > -LIMITS.twelve_hours_ns[1])).any()
    if twelve and not has_halves:
        raise TimeError(
            "it jumps back by twelve hours, as a 12-hour clock without AM and PM does; export "
            "it with AM and PM or as a 24-hour clock, or set another column as [log] time"
        )
    days = frame.select((step < -_HALF_DAY_NS).fill_null(value=False).cum_sum()).to_series()
    note = "its times have no date: they are counted from midnight"
    return (stamps + days.cast(pl.Int64) * DAY_NS).alias("log_time_ns"), (note,)


def find_calendar_columns(columns: Sequence[ColumnName]) -> tuple[str, ...]:
    """Columns of year, month, day, hour, minute and second, or of the last three.

    Empty if one of them is missing.
    """
    by_word = {
        reduce_to_lower_case_letters(column.name): column.name for column in reversed(columns)
    }
    found = [next((by_word[w] for w in words if w in by_word), None) for words in _CALENDAR]
    clock = found[_DAY_PARTS:]
    if None in clock:
        return ()
    parts = clock if None in found else found
    return tuple(each for each in parts if each is not None)


def convert_calendar_columns_to_ns(calendar_columns: Sequence[pl.Series]) -> pl.Series:
    """Log times from columns of year to second, or hour to second; null if one is missing."""
    numbers = [
        part.cast(pl.Float64, strict=False).alias(str(k)) for k, part in enumerate(calendar_columns)
    ]
    frame = pl.DataFrame(numbers)
    hour, minute, second = (pl.col(str(len(calendar_columns) - k)) for k in (3, 2, 1))
    clock = (hour * 3600 + minute * 60) * NS + (second * NS).round()
    stamps = frame.select(clock.cast(pl.Int64, strict=False)).to_series()
    if len(calendar_columns) > _DAY_PARTS:
        whole = (pl.col(str(k)).cast(pl.Int32, strict=False) for k in range(_DAY_PARTS))
        day = frame.select(pl.date(*whole).cast(pl.Int32, strict=False).cast(pl.Int64)).to_series()
        stamps = stamps + day * DAY_NS
    return stamps.alias("log_time_ns")
