"""Times that no name tells, clocks of other epochs, and clocks that contradict each other."""

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from estimators.errors import LogError
from replay.init.guess_machine import draft_machine_file
from replay.logs import open_log
from replay.logs.tables.hints import TableHints, TimeAxis
from tests.one_line import assert_one_line

BEGIN = datetime(2026, 11, 13, 8, 15, 30, tzinfo=UTC)
BEGIN_NS = int(BEGIN.timestamp()) * 10**9
BEGIN_S = BEGIN.timestamp()
ROWS = 200


def table(path: Path, head: str, cells: list[str]) -> Path:
    rows = [f"{cell},{k % 7}" for k, cell in enumerate(cells)]
    file = path / "log.csv"
    file.write_text("\n".join([head, *rows]) + "\n")
    return file


def span_of(file: Path) -> tuple[int, int]:
    row = open_log(file).topics().row(0, named=True)
    return row["start_ns"], row["end_ns"]


#: By clock: a second, and what is shown at the beginning of 1970, in its unit; rows a second.
CLOCKS = {
    ".NET": (10**7, 621_355_968_000_000_000, 50),
    "Windows": (10**7, 116_444_736_000_000_000, 1),
    "datenum": (1 / 86_400, 719_529, 50),
    "Julian": (1 / 86_400, 2_440_587.5, 10),
    "modified Julian": (1 / 86_400, 40_587, 50),
    "spreadsheet": (1 / 86_400, 25_569, 50),
    "LabVIEW": (1, 2_082_844_800, 50),
}


@pytest.mark.parametrize("clock", CLOCKS)
def test_a_clock_of_another_epoch_shows_the_day_of_the_log(tmp_path: Path, clock: str) -> None:
    second, zero, rate_hz = CLOCKS[clock]
    moments = [BEGIN_S + k / rate_hz for k in range(ROWS)]
    cells = [
        str(zero + round(s * second)) if second == 10**7 else f"{zero + s * second:.10f}"
        for s in moments
    ]
    start, end = span_of(table(tmp_path, "time,speed_m_s", cells))
    # a float of days since 4713 BC keeps 40 µs
    assert abs(start - BEGIN_NS) < 100_000
    assert abs(end - start - (ROWS - 1) / rate_hz * 1e9) < 100_000


def test_seconds_since_1904_are_told_where_the_unit_is_stated(tmp_path: Path) -> None:
    cells = [f"{2_082_844_800 + BEGIN_S + k / 50:.3f}" for k in range(ROWS)]
    assert span_of(table(tmp_path, "Time (s),speed_m_s", cells))[0] == BEGIN_NS


def test_an_unnamed_clock_is_the_time_where_it_is_the_only_one(tmp_path: Path) -> None:
    cells = [f"2026-11-13T08:15:{30 + k / 50:06.3f}" for k in range(ROWS)]
    assert span_of(table(tmp_path, "when,speed_m_s", cells))[0] == BEGIN_NS


def test_two_unnamed_clocks_are_asked_for(tmp_path: Path) -> None:
    cells = [f"08:15:{30 + k / 50:06.3f},08:16:{10 + k / 50:06.3f}" for k in range(ROWS)]
    with pytest.raises(LogError, match=r"no time column"):
        span_of(table(tmp_path, "sent,received,speed_m_s", cells))


def test_words_behind_a_unit_do_not_hide_it(tmp_path: Path) -> None:
    file = table(
        tmp_path, "Time (s) Run #1,Speed (km/h) Run #1", [f"{k / 50}" for k in range(ROWS)]
    )
    log = open_log(file)
    assert log.units("table") == {"Time (s) Run #1": "s", "Speed (km/h) Run #1": "km/h"}
    assert span_of(file) == (0, (ROWS - 1) * 20_000_000)


def test_the_zone_of_a_columns_name_counts(tmp_path: Path) -> None:
    cells = [f"2026-11-13 03:15:{30 + k / 50:06.3f}" for k in range(ROWS)]
    for head in ("Date Time UTC-5,v", "Timestamp (GMT-05:00),v"):
        assert span_of(table(tmp_path, head, cells))[0] == BEGIN_NS


@pytest.mark.parametrize("unit_s", [1.0, 1e-6, 0.0864])
def test_a_stated_unit_that_another_clock_contradicts_is_asked_for(
    tmp_path: Path, unit_s: float
) -> None:
    """What is called ms and counts s, or µs, or millionths of a day."""
    cells = [f"{k / 50 / unit_s:.6f},2026-11-13 08:15:{30 + k / 50:06.3f}" for k in range(ROWS)]
    with pytest.raises(LogError, match=r"span .* according to 'TimeString'.*\[log\] time") as asked:
        span_of(table(tmp_path, "Time_ms,TimeString,v", cells))
    assert_one_line(asked.value)


def test_a_year_of_another_calendar_is_asked_for(tmp_path: Path) -> None:
    cells = [f"2569-11-13 08:15:{30 + k / 50:06.3f}" for k in range(ROWS)]
    with pytest.raises(LogError, match="2569") as asked:
        span_of(table(tmp_path, "timestamp,v", cells))
    assert_one_line(asked.value)


def test_letters_that_are_not_western_are_asked_for(tmp_path: Path) -> None:
    file = tmp_path / "log.csv"
    rows = "\n".join(f"{k / 50};{k % 7}" for k in range(ROWS))
    file.write_bytes(f"Время, с;Скорость, км/ч\n{rows}\n".encode("cp1251"))
    with pytest.raises(LogError, match=r"\[log\] encoding"):
        open_log(file)


def test_sides_that_go_against_each_other_are_asked_for(tmp_path: Path) -> None:
    rows = [f"{k / 50},{k % 50},{-(k % 50)}" for k in range(400)]
    file = tmp_path / "log.csv"
    file.write_text("\n".join(["time_s,left_speed_m_s,right_speed_m_s", *rows]) + "\n")
    with open_log(file) as log:
        _, lacking = draft_machine_file(log, None)
    assert any("mirrored" in each for each in lacking)


@pytest.mark.parametrize("form", ["\u2212{}", "{}-", "({})", "- {}"])
def test_negative_numbers_are_no_losses(tmp_path: Path, form: str) -> None:
    cells = [form.format(k % 9 + 0.5) if k % 2 else f"{k % 9 + 0.5}" for k in range(ROWS)]
    file = table(tmp_path, "time_s,force_N,v", [f"{k / 50},{c}" for k, c in enumerate(cells)])
    log = open_log(file)
    found = log.read("table", ["force_N"])["force_N"].to_list()
    assert found == [(k % 9 + 0.5) * (-1 if k % 2 else 1) for k in range(ROWS)]
    assert not log.losses()


def test_a_year_of_two_digits_beside_a_month_is_asked(tmp_path: Path) -> None:
    path = tmp_path / "pi.csv"
    path.write_text("Time,a\n" + "".join(f"13-Nov-26 08:15:{s:02d},{s}\n" for s in range(9)))
    with pytest.raises(LogError, match="day_first = true for day, month, year") as asked:
        open_log(path).topics()
    assert_one_line(asked.value)
    for is_first, day in ((True, "2026-11-13"), (False, "2013-11-26")):
        axis = TimeAxis(None, None, TableHints(day_first=is_first))
        start_ns = open_log(path, time=axis).topics()["start_ns"][0]
        assert np.datetime64(start_ns, "ns") == np.datetime64(f"{day}T08:15:00")


def test_a_unit_that_name_and_row_state_differently_is_asked(tmp_path: Path) -> None:
    path = tmp_path / "two_units.csv"
    rows = "".join(f"{k / 50};{k}\n" for k in range(99))
    path.write_text(f"time_s;speed_kmh\ns;m/s\n{rows}")
    with pytest.raises(
        LogError, match=r"in km/h according to its name, in m/s according to line 2: set \[log\]"
    ) as asked:
        open_log(path)
    assert_one_line(asked.value)
    for line, unit in ((2, "m/s"), (0, "km/h")):
        log = open_log(path, time=TimeAxis(None, None, TableHints(units_row=line)))
        assert log.units("table")["speed_kmh"] == unit


def test_digits_of_another_script_are_read(tmp_path: Path) -> None:
    path = tmp_path / "persian.csv"
    table = str.maketrans("0123456789.", "۰۱۲۳۴۵۶۷۸۹٫")
    path.write_text(
        "time_s;a\n" + "".join(f"{k / 50:.2f};-{k}.5\n".translate(table) for k in range(60))
    )
    log = open_log(path)
    assert log.read("table", ["a"])["a"].to_list() == [-k - 0.5 for k in range(60)]
    assert any("another script" in note for note in log.notes())
