"""A reviewer names a cycle by number, id or the clock; what is not one cycle is refused."""

from datetime import UTC, datetime

import polars as pl
import pytest

from estimators.errors import ReviewError
from recordings.report.clock_text import ShiftClock
from recordings.review.shift_ledger import find_ledger_row_of_cycle, parse_local_instant

NS = 10**9


def shift(start: str, zone: str, cycles: int) -> tuple[pl.DataFrame, ShiftClock]:
    """A shift whose cycles take ten minutes each, dumped 30 s past every tenth minute."""
    t0_ns = int(datetime.fromisoformat(start).timestamp()) * NS
    clock = ShiftClock(zone, t0_ns, 600.0 * cycles + 60.0)
    ends = [t0_ns + (600 * k + 30) * NS for k in range(1, cycles + 1)]
    ids = [f"{datetime.fromtimestamp(e // NS, UTC):%Y-%m-%dT%H:%M:%SZ}" for e in ends]
    rows = pl.DataFrame(
        {
            "cycle": range(1, cycles + 1),
            "id": ids,
            "start_unix_ns": [e - 600 * NS for e in ends],
            "end_unix_ns": ends,
            "local_time": [clock.format_unix_ns(e) for e in ends],
        }
    )
    return rows, clock


DAY = shift("2023-11-14T14:00:00+01:00", "Europe/Berlin", 6)
BACK = shift("2023-10-29T01:00:00+02:00", "Europe/Berlin", 18)
FORWARD = shift("2023-03-26T01:00:00+01:00", "Europe/Berlin", 18)
NIGHT = shift("2023-11-14T23:00:00+01:00", "Europe/Berlin", 12)


@pytest.mark.parametrize(
    ("when", "number"),
    [
        ("3", 3),
        ("2023-11-14T13:30:30Z", 3),
        ("14:30:30", 3),  # when it is dumped
        ("14:30:27", 3),  # to 5 s
        ("14:30", 3),  # in that minute
        ("14:33", 4),  # under way
        ("14:33:10", 4),
        ("14:30:30+01:00", 3),
        ("13:30:30Z", 3),
        ("2023-11-14 14:30:30 +01:00", 3),  # as the page has it
    ],
)
def test_a_cycle_is_named_by_number_id_or_clock(when: str, number: int) -> None:
    rows, clock = DAY
    assert rows["cycle"][find_ledger_row_of_cycle(when, rows, clock)] == number


@pytest.mark.parametrize("when", ["0", "7", "13:00:00", "18:00", "25:00", "14:61", "tomorrow", ""])
def test_what_is_no_cycle_is_refused_in_one_line(when: str) -> None:
    with pytest.raises(ReviewError) as fault:
        find_ledger_row_of_cycle(when, *DAY)
    assert "\n" not in str(fault.value)


def test_half_past_two_in_the_night_that_has_it_twice_needs_the_offset() -> None:
    with pytest.raises(ReviewError, match=r"02:30:30 \+02:00.*02:30:30 \+01:00"):
        find_ledger_row_of_cycle("02:30:30", *BACK)
    first = find_ledger_row_of_cycle("02:30:30 +02:00", *BACK)
    second = find_ledger_row_of_cycle("02:30:30+01:00", *BACK)
    assert second - first == 6


def test_half_past_two_in_the_night_without_it_is_no_cycle() -> None:
    with pytest.raises(ReviewError, match="no cycle '02:30:30'"):
        find_ledger_row_of_cycle("02:30:30", *FORWARD)


def test_a_time_after_midnight_is_of_the_second_day() -> None:
    rows, clock = NIGHT
    assert rows["local_time"][find_ledger_row_of_cycle("00:20:30", rows, clock)].startswith(
        "2023-11-15 00:20:30"
    )


def test_an_hour_of_a_shift_over_midnight_is_the_one_in_the_shift() -> None:
    _, clock = NIGHT
    before, after = (parse_local_instant(text, clock) for text in ("23:30", "00:20"))
    assert (after - before).total_seconds() == 50 * 60.0


@pytest.mark.parametrize(
    "when", ["14:30:30+25:00", "2023-02-30 14:30", "2023-11-14 14:30:30+99:99"]
)
def test_days_and_offsets_that_do_not_exist_are_refused_in_one_line(when: str) -> None:
    with pytest.raises(ReviewError):
        find_ledger_row_of_cycle(when, *DAY)
