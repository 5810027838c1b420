"""Spreadsheets of a review in LibreOffice: dates are dates, numbers are numbers, in any locale."""

import csv
import datetime as dt
import shutil
import subprocess
from pathlib import Path

import openpyxl
import pytest

from recordings.review.ledger_table import write_ledger_as_spreadsheet_csv, write_ledger_as_xlsx
from tests.recordings.review.test_ledger_table import HEADS, clock, ledger

pytestmark = pytest.mark.skipif(shutil.which("soffice") is None, reason="needs LibreOffice Calc")
#: LibreOffice's numbers of locales.
ENGLISH, GERMAN = 1033, 1031


def convert(path: Path, kind: str, *options: str) -> None:
    """Have LibreOffice read a file and write another beside it."""
    profile = f"-env:UserInstallation={(path.parent / 'profile').as_uri()}"
    command = ["soffice", "--headless", profile, *options]
    subprocess.run(
        [*command, "--convert-to", kind, "--outdir", path.parent, path],
        check=True,
        capture_output=True,
        timeout=120,
    )


def test_a_workbook_is_read_with_its_dates_and_numbers(tmp_path: Path) -> None:
    night = ("2026-10-25T00:30:00Z", "2026-10-25T01:30:00Z")
    write_ledger_as_xlsx(ledger(*night, note="=1+1"), clock(night[0]), tmp_path / "ledger.xlsx")
    # comma, quotes, UTF-8, numbers as they are instead of as they are shown
    convert(
        tmp_path / "ledger.xlsx", "csv:Text - txt - csv (StarCalc):44,34,76,1,,0,false,true,false"
    )
    heads, units, *rows = csv.reader(
        (tmp_path / "ledger.csv").read_text(encoding="utf-8").splitlines()
    )
    assert heads == HEADS
    assert dict(zip(heads, units, strict=True))["payload"] == "kg"
    first, second = (dict(zip(heads, row, strict=True)) for row in rows)
    assert (first["local time"], second["local time"]) == ("2026-10-25 02:30:00",) * 2
    assert (float(first["offset from UTC"]), float(second["offset from UTC"])) == (2.0, 1.0)
    assert (float(first["payload"]), float(first["± (95 %, k = 2)"])) == (701.25, 21.0)
    assert (float(first["energy"]), first["note"]) == (0.1234, "=1+1")


@pytest.mark.parametrize(
    ("comma", "separator", "language"), [(False, 44, ENGLISH), (True, 59, GERMAN)]
)
def test_a_csv_is_read_in_its_locale(
    comma: bool, separator: int, language: int, tmp_path: Path
) -> None:
    path = tmp_path / "table.csv"
    rows = ledger("2026-07-01T12:32:10Z")
    write_ledger_as_spreadsheet_csv(
        rows, clock("2026-07-01T06:00:00Z"), path, has_decimal_comma=comma
    )
    # separator, quotes, UTF-8, from the first line, that language, quoted cells as text, detect
    dialect = f"--infilter=CSV:{separator},34,76,1,,{language},false,true"
    convert(path, "xlsx", dialect)
    sheet = openpyxl.load_workbook(tmp_path / "table.xlsx").active
    assert sheet is not None
    heads, _, row = sheet.iter_rows(values_only=True)
    found = dict(zip(heads, row, strict=True))
    assert list(heads) == HEADS
    assert (found["payload"], found["top speed"], found["energy"]) == (701, 9.0, 0.1234)
    assert found["local time"] == dt.datetime(2026, 7, 1, 14, 32, 10)
