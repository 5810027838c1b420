"""Rows of a CSV that are too long, too short, or torn."""

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from replay import open_log
from replay.logs import Log


def opened(tmp_path: Path, text: str) -> Log:
    (tmp_path / "shift.csv").write_text(text, encoding="utf-8", newline="")
    return open_log(tmp_path / "shift.csv")


def told(log: Log) -> list[str]:
    return [loss.what for loss in log.losses()]


def test_rows_that_are_too_short_end_in_nulls_with_a_loss(tmp_path: Path) -> None:
    log = opened(tmp_path, "time_s,a,b\n0,1,1\n1\n2,3,3\n3,4\n")
    assert log.read("table", ["a", "b"]).select("a", "b").rows() == [
        (1, 1),
        (None, None),
        (3, 3),
        (4, None),
    ]
    assert told(log) == [
        "rows with fewer cells than the header: 2, the first in line 3; their missing cells are "
        "empty"
    ]


def test_rows_that_are_too_long_are_cut_with_a_loss(tmp_path: Path) -> None:
    log = opened(tmp_path, "time_s,a\n0,1\n1,2,9,9\n2,3\n")
    assert log.read("table", ["a"])["a"].to_list() == [1, 2, 3]
    assert told(log) == ["rows with more cells than the header: the additional cells are not read"]


@pytest.mark.parametrize("end", ["2", "2,", "2,3", '2,"x"', "2.0000001,-3.141"])
def test_a_torn_last_row_is_not_read_since_its_last_cell_may_be_half_a_number(
    tmp_path: Path, end: str
) -> None:
    log = opened(tmp_path, f"time_s,a,b\n0,1,1\n1,2,2\n{end}")
    assert log.read("table", ["a", "b"]).select("a", "b").rows() == [(1, 1), (2, 2)]
    assert told(log) == ["its last row (line 4) is cut off and was not read"]


@pytest.mark.parametrize("end", ['"', '"2","', '"2","3","'])
def test_a_row_that_is_torn_behind_a_quote_is_not_read(tmp_path: Path, end: str) -> None:
    log = opened(tmp_path, f'"time_s","a","b"\n"0","1","1"\n"1","2","2"\n{end}')
    assert log.read("table", ["a", "b"]).select("a", "b").rows() == [(1, 1), (2, 2)]
    assert told(log) == ["its last row is cut off and was not read"]


@pytest.mark.parametrize(
    "text",
    [
        "time_s,a,b\n0,1,1\n1,2,2",
        "time_s,a,b\r\n0,1,\r\n1,,\r\n",
        'time_s,a,b\n0,"1,5",\n',
        'time_s,a,b\n0,"two\nlines",\n',
        "time_s,a\n0,\n1,",
    ],
    ids=["no line end at the end", "empty cells", "a comma in a cell", "a cell of lines", "all"],
)
def test_what_a_csv_may_look_like_is_no_loss(tmp_path: Path, text: str) -> None:
    log = opened(tmp_path, text)
    log.read("table", ["a"])
    assert told(log) == []


@pytest.mark.heavy
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(cut=st.integers(12, 400))
def test_cut_anywhere_every_whole_row_is_read_and_a_torn_one_is_a_loss(
    tmp_path: Path, cut: int
) -> None:
    whole = "time_s,a,b\n" + "".join(f"{k},{k}.5,{k}.25\n" for k in range(40))
    text = whole[:cut]
    log = opened(tmp_path, text)
    frame = log.read("table", ["a"])
    *lines, last = text.split("\n")[1:]
    is_truncated = last.count(",") < 2
    assert frame.height == len(lines) + (not is_truncated)
    assert told(log) == (
        [f"its last row (line {len(lines) + 2}) is cut off and was not read"]
        if is_truncated and last
        else []
    )


@pytest.mark.parametrize(("decimal", "between"), [(",", "."), (".", ",")])
def test_thousands_are_told_by_the_decimal_sign_of_other_columns(
    tmp_path: Path, decimal: str, between: str
) -> None:
    """4.919 beside 0,0213 is four thousand: half of a column below a million has one sign alone."""
    numbers = [k * 1000 + 7 for k in range(2000)]
    rows = (
        f"{f'{k / 50:.4f}'.replace('.', decimal)};{f'{number:,}'.replace(',', between)}"
        for k, number in enumerate(numbers)
    )
    path = tmp_path / "thousands.csv"
    path.write_text("\n".join(["time_s;force_mN", *rows]) + "\n")
    log = open_log(path)
    assert log.read("table", ["force_mN"])["force_mN"].to_list() == numbers
    assert not log.losses()
