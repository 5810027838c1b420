"""Find a cycle by number, id or local time."""

import datetime as dt
import re
from typing import Final
from zoneinfo import ZoneInfo

import polars as pl

from analysis.model.physical_units import NS
from estimators.errors import ReviewError, counted
from recordings.report.clock_text import ShiftClock

#: A dump so long before or after the time that is asked for, in s, is meant.
_NEAR_S: Final = 5.0
_TIME: Final = re.compile(
    r"(?:(?P<day>\d{4}-\d\d-\d\d)[ T])?(?P<h>\d{1,2}):(?P<m>\d\d)(?::(?P<s>\d\d))?"
    r"\s*(?P<offset>Z|[+-]\d\d:?\d\d)?"
)


def find_cycle_row(when: str, rows: pl.DataFrame, clock: ShiftClock) -> int:
    """Row of the cycle that a reviewer names.

    A local time selects the cycle dumped within 5 s of it or in that minute, else the one in
    progress.

    Args:
        when: a number (14), an id (2023-11-14T22:14:58Z) or a local time (14:32:10, 14:32,
            02:30:10+02:00, 2023-11-14 14:32:10); h:mm:ss since the start for a log without a date.
        rows: the ledger.
        clock: clock of the shift.

    Raises:
        ReviewError: no cycle matches, or several do.
    """
    text = when.strip()
    if text.isdecimal():
        found = [k for k, number in enumerate(rows["cycle"]) if number == int(text)]
    elif text in (ids := rows["id"].to_list()):
        found = [ids.index(text)]
    elif match := _TIME.fullmatch(text):
        try:
            found = rows_of_cycles_at_time(match, rows, clock)
        except ValueError as error:  # 30 February, an offset of 25 h
            raise ReviewError(f"'{when}' is not a time ({error})") from None
    else:
        raise ReviewError(
            f"'{when}' names no cycle; give its number (14), its id, or a local time (14:32:10)"
        )
    if len(found) > 1:
        choices = ", ".join(f"{rows['cycle'][k]} (dumped {rows['local_time'][k]})" for k in found)
        raise ReviewError(f"'{when}' may be cycle {choices}; give the number, or the UTC offset")
    if not found:
        span = f" from {rows['local_time'][0]} to {rows['local_time'][-1]}" if rows.height else ""
        raise ReviewError(f"no cycle '{when}' among {counted(rows.height, 'cycle')}{span}")
    return found[0]


def find_instant(text: str, clock: ShiftClock) -> dt.datetime:
    """Instant at which the local clock shows a time; see `find_cycle_row`.

    Raises:
        ReviewError: it is not a time, or the clock shows it never or twice.
    """
    match = _TIME.fullmatch(text.strip())
    try:
        found = [] if match is None else unix_times_of_local_time(match, clock)
    except ValueError as error:
        raise ReviewError(f"'{text}' is not a time ({error})") from None
    if match is None:
        raise ReviewError(f"'{text}' is not a time; write it like 14:32 or 2023-11-14 14:32:10")
    begin_s = clock.t0_unix_ns / NS
    within_shift = [each for each in found if 0.0 <= each - begin_s <= clock.duration_s]
    # of a shift over midnight the other day's hour is hours before it begins
    found = within_shift or found
    if len(found) != 1:
        times = "never" if not found else f"{len(found)} times"
        raise ReviewError(f"the clock shows '{text}' {times}; give the day, and the UTC offset")
    return dt.datetime.fromtimestamp(found[0], dt.UTC)


def rows_of_cycles_at_time(
    match: re.Match[str], rows: pl.DataFrame, clock: ShiftClock
) -> list[int]:
    """Rows that a time may select."""
    starts, ends = rows["start_unix_ns"].to_list(), rows["end_unix_ns"].to_list()
    room_s = 60.0 if match["s"] is None else 0.0
    found: set[int] = set()
    for unix_s in unix_times_of_local_time(match, clock):
        dumped = {
            k: abs(end / NS - unix_s)
            for k, end in enumerate(ends)
            if unix_s - (0.0 if room_s else _NEAR_S) <= end / NS < unix_s + (room_s or _NEAR_S)
        }
        if dumped:
            found |= set(dumped) if room_s else {min(dumped, key=dumped.__getitem__)}
            continue
        spans = enumerate(zip(starts, ends, strict=True))
        found |= {k for k, (s, e) in spans if s / NS <= unix_s <= e / NS}
    return sorted(found)


def unix_times_of_local_time(match: re.Match[str], clock: ShiftClock) -> list[float]:
    """Unix times in s at which the local clock shows this time."""
    hour, minute, second = (int(match[name] or 0) for name in ("h", "m", "s"))
    if not clock.is_dated:
        return [clock.t0_unix_ns / NS + 3600 * hour + 60 * minute + second]
    zone = _parse_utc_offset(match["offset"]) if match["offset"] else ZoneInfo(clock.zone)
    first, last = (
        clock.to_local_datetime(s).astimezone(zone).date() for s in (0.0, clock.duration_s)
    )
    days = [first + dt.timedelta(days=k) for k in range((last - first).days + 1)]
    if match["day"]:
        days = [dt.date.fromisoformat(match["day"])]
    found: set[float] = set()
    for day in days:
        for fold in (0, 1):
            wall = dt.datetime.combine(day, dt.time(hour, minute, second, fold=fold), zone)
            # a clock that is put forward never shows the hour between
            utc = wall.astimezone(dt.UTC)
            if utc.astimezone(zone).replace(tzinfo=None) == wall.replace(tzinfo=None):
                found.add(utc.timestamp())
    return sorted(found)


def _parse_utc_offset(text: str) -> dt.timezone:
    if text == "Z":
        return dt.UTC
    sign, digits = (-1 if text[0] == "-" else 1), text[1:].replace(":", "")
    return dt.timezone(sign * dt.timedelta(hours=int(digits[:2]), minutes=int(digits[2:])))
