"""Local times with their offset: no time of a shift reads like another."""

from datetime import UTC, datetime

import pytest

from recordings.report.clock_text import ShiftClock, format_duration

NS = 10**9


def clock(start: str, zone: str, hours: float) -> ShiftClock:
    begin = datetime.fromisoformat(start).astimezone(UTC)
    return ShiftClock(zone, int(begin.timestamp()) * NS, hours * 3600.0)


BACK = clock("2023-10-29T01:00:00+02:00", "Europe/Berlin", 4.0)
FORWARD = clock("2023-03-26T01:00:00+01:00", "Europe/Berlin", 4.0)


def test_the_two_half_past_twos_of_a_night_differ_by_their_offset() -> None:
    assert BACK.format_time(1.5 * 3600.0) == "02:30:00 +02:00"
    assert BACK.format_time(2.5 * 3600.0) == "02:30:00 +01:00"


def test_a_clock_that_is_put_forward_skips_an_hour() -> None:
    assert FORWARD.format_time(3599.0) == "01:59:59 +01:00"
    assert FORWARD.format_time(3600.0) == "03:00:00 +02:00"


@pytest.mark.parametrize("night", [BACK, FORWARD])
def test_no_two_ticks_of_such_a_night_read_alike(night: ShiftClock) -> None:
    texts = [text for _, text in night.make_time_axis_ticks(0.0, night.duration_s)]
    assert len(texts) == len(set(texts)) > 3
    assert all("+0" in text for text in texts)


def test_a_shift_over_midnight_says_the_day() -> None:
    night = clock("2023-11-14T22:00:00+01:00", "Europe/Berlin", 4.0)
    assert night.format_time(3.0 * 3600.0) == "2023-11-15 01:00:00 +01:00"


def test_ticks_are_round_on_the_machines_own_clock_however_odd_its_zone() -> None:
    nepal = clock("2023-11-14T10:07:13+05:45", "Asia/Kathmandu", 2.0)
    assert [text for _, text in nepal.make_time_axis_ticks(0.0, 7200.0)] == [
        "10:30",
        "11:00",
        "11:30",
        "12:00",
    ]
    assert nepal.time_axis_label == "local time (UTC+05:45)"


def test_a_log_without_a_date_counts_from_its_start() -> None:
    undated = ShiftClock("Europe/Berlin", 12 * NS, 4000.0)
    assert undated.format_time(3723.0) == "1:02:03"
    assert undated.time_axis_label == "h:min since the start"


@pytest.mark.parametrize(
    ("s", "text"), [(7.1, "7 s"), (119.0, "119 s"), (1800.0, "30 min"), (9000.0, "2.5 h")]
)
def test_durations_are_in_the_unit_that_a_person_says(s: float, text: str) -> None:
    assert format_duration(s) == text
