"""Excel files: values that were kept, in bounded space."""

import io
import subprocess
import sys
import zipfile
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path

import pytest
import xlsxwriter

from estimators.errors import LogError
from replay.commands.common_options import make_time_axis_from_options
from replay.logs import open_log
from replay.logs.tables.table_limits import LIMITS
from tests.one_line import assert_one_line

BEGIN = datetime(2026, 11, 13, 8, 15, 30)


def write(path: Path, *, second: bool = False) -> Path:
    with xlsxwriter.Workbook(str(path)) as book:
        stamp = book.add_format({"num_format": "yyyy-mm-dd hh:mm:ss.000"})
        sheet = book.add_worksheet("run")
        sheet.write_row(0, 0, ["Yard, Friday"])
        sheet.write_row(2, 0, ["Timestamp", "Speed [km/h]", "Force [kN]"])
        for k in range(200):
            moment = BEGIN + timedelta(milliseconds=20 * k)
            sheet.write_datetime(k + 3, 0, moment, stamp)
            sheet.write_number(k + 3, 1, k / 10)
            # what a formula gave when the file was saved
            sheet.write_formula(k + 3, 2, "=1/0", None, 1.5)
        if second:
            book.add_worksheet("other").write_column(0, 0, [1, 2, 3])
    return path


def test_a_sheet_is_a_table_and_no_formula_is_run(tmp_path: Path) -> None:
    with open_log(write(tmp_path / "run.xlsx")) as log:
        frame = log.read("table", ["Speed [km/h]", "Force [kN]"])
        assert log.units("table")["Force [kN]"] == "kN"
    assert frame["Force [kN]"].unique().to_list() == [1.5]
    assert frame["Speed [km/h]"].to_list()[:3] == [0, 0.1, 0.2]
    steps = frame["log_time_ns"].diff().drop_nulls()
    assert abs(steps.to_numpy() - 20_000_000).max() <= 1_000_000


def test_of_several_sheets_one_has_to_be_named(tmp_path: Path) -> None:
    path = write(tmp_path / "run.xlsx", second=True)
    with pytest.raises(
        LogError, match=r"2 of its sheets have rows \(run, other\); set \[log\] sheet"
    ) as e:
        open_log(path)
    assert_one_line(e.value)
    with open_log(path, time=make_time_axis_from_options(None, None, ["log.sheet=run"])) as log:
        assert log.topics()["messages"].to_list() == [200]


def test_what_is_no_workbook_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "run.xlsx"
    whole = write(tmp_path / "whole.xlsx").read_bytes()
    for data in (b"PK\3\4nothing", whole[:3000], whole[:500] + whole[900:]):
        path.write_bytes(data)
        with pytest.raises(LogError) as caught:
            open_log(path).topics()
        assert_one_line(caught.value)


def test_a_bomb_is_not_unpacked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    small = replace(LIMITS, workbook_bytes=1 << 24)
    monkeypatch.setattr("replay.logs.tables.text.LIMITS", small)
    path = tmp_path / "bomb.xlsx"
    data = io.BytesIO(write(tmp_path / "run.xlsx").read_bytes())
    with zipfile.ZipFile(data, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("xl/media/zeros.bin", bytes(1 << 25))
    path.write_bytes(data.getvalue())
    with pytest.raises(LogError, match="unpacks to more than"):
        open_log(path)


@pytest.mark.heavy
def test_without_the_library_the_line_names_the_extra(tmp_path: Path) -> None:
    path = write(tmp_path / "run.xlsx")
    code = (
        "import sys; sys.modules['python_calamine'] = None\n"
        "from replay.logs import open_log\n"
        "from estimators.errors import LogError\n"
        f"try: open_log({str(path)!r})\nexcept LogError as e: print(e)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "pip install 'payscope[excel]'" in done.stdout
    assert done.stdout.count("\n") == 1
