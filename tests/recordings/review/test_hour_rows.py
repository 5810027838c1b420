"""The table of hours: each that the shift touches, with what was recorded of it."""

from recordings.review.review_page import HOUR_HEADS, make_hour_table_rows
from tests.recordings.review.test_shift_facts import rows, state

#: From 00:00:00 in Berlin: four cycles of 100 s, then nothing.
MIDNIGHT_S = 1_700_002_800
AT_MIDNIGHT = {"t0_unix_ns": MIDNIGHT_S * 10**9, "duration_s": 3 * 3600.0 + 600.0}


def hours(**more: object) -> dict[str, dict[str, str]]:
    """The cells by hour and head."""
    of = state(**(AT_MIDNIGHT | more))
    return {
        row[0]: dict(zip(HOUR_HEADS, row[1:], strict=True))
        for row in make_hour_table_rows(rows(of), of)
    }


def test_an_hour_of_which_no_log_is_left_is_there_with_nothing_recorded() -> None:
    found = hours(gaps_s=((3000.0, 8000.0),))
    assert [each["recorded"] for each in found.values()] == ["50 min", "0 min", "47 min", "10 min"]
    assert [each["loads"] for each in found.values()] == ["4", "0", "0", "0"]
    assert found["01:00 +01:00"]["t/h"] == "–"


def test_years_between_two_logs_have_no_rows() -> None:
    days = 1200.0
    found = hours(duration_s=days * 86_400.0, gaps_s=((1800.0, days * 86_400.0 - 600.0),))
    assert [each["recorded"] for each in found.values()] == ["30 min", "10 min"]


def test_tonnes_an_hour_are_those_of_recorded_time() -> None:
    first = hours(gaps_s=((1800.0, 3600.0),))["00:00 +01:00"]
    tonnes = float(first["t ± U"].split(" ± ")[0])
    assert float(first["t/h"]) == round(2.0 * tonnes, 1)


def test_a_night_whose_clock_is_put_back_has_its_hour_twice() -> None:
    # 29 October 2023, 02:00 summer time in Berlin
    found = hours(t0_unix_ns=1_698_537_600 * 10**9, duration_s=2.5 * 3600.0)
    assert list(found) == ["02:00 +02:00", "02:00 +01:00", "03:00 +01:00"]


def test_a_log_without_a_date_counts_hours_from_its_start() -> None:
    assert list(hours(t0_unix_ns=0)) == ["0:00", "1:00", "2:00", "3:00"]
