"""Files with a JSON object per line are tables."""

import gzip
import json
from pathlib import Path
from typing import Any

import polars as pl
import pytest

from estimators.errors import LogError
from replay.init.guess_machine import draft_machine_file
from replay.logs import TABLE, open_log

ROWS = [
    {
        "time_s": 0.02 * k,
        "wheel": {"torque_Nm": [1.5 * k, 2.0 * k], "ok": k % 2 == 0},
        "count": 2**60 + k,
        "scan": list(range(40)),
    }
    for k in range(100)
]


def write_lines(path: Path, rows: list[Any]) -> Path:
    text = "".join(json.dumps(row) + "\n" for row in rows).encode()
    path.write_bytes(gzip.compress(text) if path.suffix == ".gz" else text)
    return path


def read_fields(path: Path, *fields: str) -> pl.DataFrame:
    with open_log(path) as log:
        return log.read(TABLE, fields)


@pytest.mark.parametrize("name", ["log.jsonl", "log.ndjson", "log.jsonl.gz"])
def test_objects_and_short_lists_are_columns(tmp_path: Path, name: str) -> None:
    path = write_lines(tmp_path / name, ROWS)
    with open_log(path) as log:
        assert log.topics()["fields"].to_list() == [
            ["time_s", "wheel.torque_Nm[0]", "wheel.torque_Nm[1]", "wheel.ok", "count"]
        ]
        assert log.losses() == ()
        assert log.units(TABLE) == {
            "time_s": "s", "wheel.torque_Nm[0]": "N*m", "wheel.torque_Nm[1]": "N*m"
        }  # fmt: skip
    frame = read_fields(path, "wheel.torque_Nm[1]", "wheel.ok", "count")
    assert frame["log_time_ns"].to_list() == [20_000_000 * k for k in range(100)]
    assert frame["wheel.torque_Nm[1]"].to_list() == [2.0 * k for k in range(100)]
    assert frame["wheel.ok"].to_list() == [k % 2 == 0 for k in range(100)]
    assert frame["count"].to_list() == [2**60 + k for k in range(100)]


def test_a_draft_takes_the_elements_of_a_list_as_sides(tmp_path: Path) -> None:
    with open_log(write_lines(tmp_path / "log.jsonl", ROWS)) as log:
        text, lacking = draft_machine_file(log, None)
    assert '[channels.torque_left_N_m]\nfield = "wheel.torque_Nm[0]"' in text
    assert '[channels.torque_right_N_m]\nfield = "wheel.torque_Nm[1]"' in text
    assert "whether 'wheel.torque_Nm[0]' is the left one" in lacking


def test_a_torn_line_is_a_loss_and_a_nan_a_gap(tmp_path: Path) -> None:
    path = write_lines(tmp_path / "log.jsonl", [*ROWS[:50], [1, 2], *ROWS[50:]])
    text = path.read_text().replace('"torque_Nm": [3.0, 4.0]', '"torque_Nm": [NaN, 4.0]')
    path.write_text(text + '{"time_s": 2.0, "whe')
    frame = read_fields(path, "wheel.torque_Nm[0]")
    assert frame.height == 100
    assert frame["wheel.torque_Nm[0]"].is_null().arg_true().to_list() == [2]
    with open_log(path) as log:
        assert "2 lines dropped: not JSON objects; the first is line 51" in str(log.losses()[0])


def test_a_time_may_be_text(tmp_path: Path) -> None:
    stamps = [f"2026-05-01T10:00:{0.02 * k:09.6f}Z" for k in range(100)]
    rows = [{"stamp": stamp, "force_N": 1.0} for stamp in stamps]
    path = write_lines(tmp_path / "log.jsonl", rows)
    pl.DataFrame(rows).write_parquet(tmp_path / "log.parquet")
    expected = [1_777_629_600_000_000_000 + 20_000_000 * k for k in range(100)]
    for each in (path, tmp_path / "log.parquet"):
        assert read_fields(each, "force_N")["log_time_ns"].to_list() == expected


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[1, 2]\nhello\n", "no line is a JSON object"),
        (
            '{"t": 1, "a": {"b": 1}, "a.b": 2}\n',
            "two fields of a line become columns of the same name",
        ),
        ('{"t": 1, "größe": 2\n', "no line is a JSON object"),
        ('{"t": 1, "a": ' + "[" * 100_000 + "]" * 100_000 + "}\n", "no line is a JSON object"),
    ],
)
def test_what_is_no_table_is_refused_in_a_line(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "log.jsonl"
    path.write_text(text)
    with pytest.raises(LogError, match=said) as refused:
        read_fields(path, "b")
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("odd", "said"),
    [
        ({"force_N": [1.0]}, "1 value of 'force_N' lost: most are numbers, these are not"),
        ({"force_N": {"a": 1.0}}, "1 value of 'force_N' lost: most are numbers, these are not"),
        ({"force_N": "n/a"}, "1 cells of column 'force_N' are not numbers; the first is 'n/a'"),
        ({"wheel": [1.0, 2.0, 3.0]}, "'wheel' does not have 2 elements in 1 row"),
    ],
)
def test_a_value_of_another_kind_is_lost_alone(
    tmp_path: Path, odd: dict[str, Any], said: str
) -> None:
    rows = [{"time_s": 0.02 * k, "force_N": 1.0, "wheel": [1.0, 2.0]} for k in range(100)]
    path = write_lines(tmp_path / "log.jsonl", [*rows[:50], rows[50] | odd, *rows[51:]])
    frame = read_fields(path, "force_N", "wheel[1]")
    assert frame["force_N"].count() == 100 - ("force_N" in odd)
    assert frame["wheel[1]"].to_list() == [2.0] * 100
    with open_log(path) as log:
        log.read(TABLE, ["force_N"])
        assert [loss.what for loss in log.losses()] == [said]


@pytest.mark.parametrize(
    "first",
    [b"\xef\xbb\xbf", b'{"time_s": -0.02, "big": 1180591620717411303424}\n', b'{"a\\u0000b": 1}\n'],
)
def test_a_byte_order_mark_a_huge_integer_and_a_nul_are_read(tmp_path: Path, first: bytes) -> None:
    path = write_lines(tmp_path / "log.jsonl", ROWS)
    path.write_bytes(first + path.read_bytes())
    assert read_fields(path, "wheel.torque_Nm[1]").tail(100).height == 100
