"""The ledger as spreadsheets read it: dates, units, decimal commas, and nights with two 02:30."""

import csv
import datetime as dt
from pathlib import Path
from typing import Any

import openpyxl
import polars as pl
import pytest

from recordings.report.clock_text import ShiftClock
from recordings.review.energy_columns import (
    ENERGIES,
    FUEL,
    FUEL_U,
    make_energy_column_name,
    make_uncertainty_column_name,
)
from recordings.review.ledger_table import (
    COLUMNS,
    make_ledger_table_cells,
    write_ledger_as_spreadsheet_csv,
    write_ledger_as_xlsx,
)
from recordings.review.reviewer_verdicts import LABELS
from recordings.review.shift_ledger import (
    PARQUET,
    escape_spreadsheet_formula,
    write_ledger_parquet_and_csv,
)

HEADS = [column.head for column in COLUMNS]


def unix_ns(iso: str) -> int:
    return int(dt.datetime.fromisoformat(iso).timestamp()) * 10**9


def ledger(*dumps: str, note: str = "") -> pl.DataFrame:
    """A load at each time."""
    return pl.DataFrame(
        [
            {
                "cycle": number,
                "end_unix_ns": unix_ns(each),
                "payload_kg": 701.25,
                "payload_u_kg": 10.5,
                "counted": True,
                "quality": "good",
                "withheld_for": "",
                "doubt": "",
                **dict.fromkeys(LABELS, ""),
                "note": note,
                "author": "",
                "haul_m": 41.5,
                "top_speed_m_s": 2.5,
                "moving_s": None,
                "standing_s": 3.0,
                "hole_s": 0.0,
                **dict.fromkeys(map(make_energy_column_name, ENERGIES), 0.1234),
                **dict.fromkeys(map(make_uncertainty_column_name, ENERGIES), 0.0021),
                FUEL: 0.25,
                FUEL_U: None,
                "id": each,
            }
            for number, each in enumerate(dumps, start=1)
        ],
        schema_overrides={"moving_s": pl.Float64},
    )


def clock(begins: str, zone: str = "Europe/Berlin") -> ShiftClock:
    return ShiftClock(zone, unix_ns(begins), 8 * 3600.0)


def read_back(path: Path) -> list[dict[str, Any]]:
    """The rows of a workbook, units first."""
    sheet = openpyxl.load_workbook(path)["ledger"]
    heads, *rows = sheet.iter_rows(values_only=True)
    return [dict(zip(heads, row, strict=True)) for row in rows]


def test_a_workbook_has_units_real_dates_numbers_and_the_interval_of_the_page(
    tmp_path: Path,
) -> None:
    write_ledger_as_xlsx(
        ledger("2026-07-01T12:32:10Z"), clock("2026-07-01T06:00:00Z"), tmp_path / "a.xlsx"
    )
    units, row = read_back(tmp_path / "a.xlsx")
    assert units["payload"] == "kg"
    assert row["local time"] == dt.datetime(2026, 7, 1, 14, 32, 10)
    assert row["UTC"] == dt.datetime(2026, 7, 1, 12, 32, 10)
    assert (row["offset from UTC"], row["payload"], row["± (95 %, k = 2)"]) == (2, 701.25, 21)
    assert row["top speed"] == 9
    assert row["moving"] is None


@pytest.mark.parametrize(
    ("utc", "local"),
    [
        (("2026-10-25T00:30:00Z", "2026-10-25T01:30:00Z"), (("02:30", 2.0), ("02:30", 1.0))),
        (("2026-03-29T00:59:00Z", "2026-03-29T01:01:00Z"), (("01:59", 1.0), ("03:01", 2.0))),
        (("2026-06-30T21:59:00Z", "2026-06-30T22:01:00Z"), (("23:59", 2.0), ("00:01", 2.0))),
    ],
    ids=["clock set back", "clock set forward", "over midnight"],
)
def test_every_load_of_a_night_has_its_wall_time_and_offset(
    utc: tuple[str, str], local: tuple[tuple[str, float], ...], tmp_path: Path
) -> None:
    rows, at = ledger(*utc), clock(utc[0])
    write_ledger_as_xlsx(rows, at, tmp_path / "a.xlsx")
    _, *found = read_back(tmp_path / "a.xlsx")
    assert [(f"{r['local time']:%H:%M}", r["offset from UTC"]) for r in found] == list(local)
    assert found[0]["UTC"] < found[1]["UTC"]


def test_times_are_the_machines_whatever_the_readers_zone(monkeypatch: pytest.MonkeyPatch) -> None:
    rows, at = ledger("2026-07-01T12:00:00Z"), clock("2026-07-01T06:00:00Z", "Asia/Kolkata")
    tables: list[Any] = []
    for zone in ("America/Denver", "Asia/Tokyo"):
        monkeypatch.setenv("TZ", zone)
        tables.append(make_ledger_table_cells(rows, at))
    assert tables[0] == tables[1]
    assert tables[0][0][HEADS.index("local time")] == dt.datetime(2026, 7, 1, 17, 30)
    assert tables[0][0][HEADS.index("offset from UTC")] == 5.5


@pytest.mark.parametrize(("comma", "delimiter", "haul"), [(False, ",", "9.0"), (True, ";", "9,0")])
def test_a_csv_is_for_the_locale_that_is_asked_for(
    comma: bool, delimiter: str, haul: str, tmp_path: Path
) -> None:
    path = tmp_path / "a.csv"
    rows = ledger("2026-07-01T12:00:00Z", note="=1+1")
    write_ledger_as_spreadsheet_csv(
        rows, clock("2026-07-01T06:00:00Z"), path, has_decimal_comma=comma
    )
    assert path.read_bytes().startswith(b"\xef\xbb\xbf")  # or a spreadsheet takes ± for Â±
    heads, units, row = csv.reader(
        path.read_text(encoding="utf-8-sig").splitlines(), delimiter=delimiter
    )
    assert heads == HEADS
    assert dict(zip(heads, units, strict=True))["local time"] == "date"
    named = dict(zip(heads, row, strict=True))
    assert (named["top speed"], named["local time"]) == (haul, "2026-07-01 14:00:00")
    assert named["note"] == "'=1+1"


@pytest.mark.parametrize("first", ["=", "+", "-", "@", "\t", "\n", "\uff1d"])
def test_a_text_that_some_spreadsheet_computes_begins_with_an_apostrophe(first: str) -> None:
    assert escape_spreadsheet_formula(f"{first}1+1") == f"'{first}1+1"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
def test_a_ledger_on_a_full_disk_is_a_fault_of_the_disk(tmp_path: Path) -> None:
    (tmp_path / PARQUET).symlink_to("/dev/full")
    with pytest.raises(OSError, match="No space left on device"):
        write_ledger_parquet_and_csv(ledger("2026-07-01T12:00:00Z"), tmp_path)


def test_a_text_of_a_workbook_is_no_formula(tmp_path: Path) -> None:
    rows = ledger("2026-07-01T12:00:00Z", note="=1+1")
    write_ledger_as_xlsx(rows, clock("2026-07-01T06:00:00Z"), tmp_path / "a.xlsx")
    sheet = openpyxl.load_workbook(tmp_path / "a.xlsx")["ledger"]
    cell = sheet.cell(3, HEADS.index("note") + 1)
    assert (cell.value, cell.data_type) == ("=1+1", "s")


def test_a_log_without_a_date_has_no_dates(tmp_path: Path) -> None:
    rows = ledger("1970-01-01T00:10:00Z")
    write_ledger_as_xlsx(rows, ShiftClock("UTC", 0, 3600.0), tmp_path / "a.xlsx")
    _, row = read_back(tmp_path / "a.xlsx")
    assert (row["UTC"], row["local time"], row["offset from UTC"]) == (None, None, None)
