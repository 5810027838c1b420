"""CSV and Parquet tables as logs."""

from pathlib import Path

import polars as pl
import pytest

from estimators.errors import LogError
from replay import TimeAxis, open_log
from tests.one_line import assert_one_line
from tests.replay.logs.one_line import one_line_at_most

SAMPLES = pl.DataFrame(
    {
        "time_s": [0.0, 0.1, 0.2, 0.3],
        "force_N": [1.0, float("nan"), float("inf"), None],
        "count": [1, 2, 3, 4],
        "brake": [True, False, True, None],
        "note": ["go", "go", "stop", None],
    }
)


@pytest.fixture(params=["csv", "parquet"])
def table(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    path = tmp_path / f"shift.{request.param}"
    SAMPLES.write_csv(path) if request.param == "csv" else SAMPLES.write_parquet(path)
    return path


def write_csv(tmp_path: Path, text: str) -> Path:
    (tmp_path / "shift.csv").write_text(text, encoding="utf-8")
    return tmp_path / "shift.csv"


def test_a_table_is_a_log_with_the_one_topic_table(table: Path) -> None:
    with open_log(table) as log:
        row = log.topics().row(0, named=True)
    assert (row["topic"], row["type"]) == ("table", "table")
    assert row["encoding"] == table.suffix.removeprefix(".")
    assert (row["messages"], row["start_ns"], row["end_ns"]) == (4, 0, 300_000_000)
    assert row["rate_hz"] == pytest.approx(10)
    assert row["fields"] == SAMPLES.columns


def test_stamps_and_durations_are_nanoseconds_whatever_their_own_unit(tmp_path: Path) -> None:
    units = {
        "ms": pl.Datetime("ms"),
        "us": pl.Datetime("us", "UTC"),
        "day": pl.Date(),
        "lap": pl.Duration("ms"),
        "clock": pl.Time(),
    }
    counts = pl.DataFrame({"time_s": [0.0], **{name: [1] for name in units}})
    path = tmp_path / "shift.parquet"
    counts.with_columns(pl.col(n).cast(dtype) for n, dtype in units.items()).write_parquet(path)
    frame = open_log(path).read("table", list(units)).select(*units)
    assert set(frame.dtypes) == {pl.Int64}
    assert frame.row(0) == (1_000_000, 1_000, 86_400 * 10**9, 1_000_000, 1)


def test_columns_keep_their_kind_and_their_nan_inf_and_nothing(table: Path) -> None:
    frame = open_log(table).read("table", ["force_N", "count", "brake", "note"])
    stamps = {"log_time_ns": pl.Int64, "header_stamp_ns": pl.Int64}
    kinds = {"force_N": pl.Float64, "count": pl.Int64, "brake": pl.Boolean, "note": pl.String}
    assert frame.schema == pl.Schema({**stamps, **kinds})
    assert frame["log_time_ns"].to_list() == [0, 100_000_000, 200_000_000, 300_000_000]
    assert frame["header_stamp_ns"].null_count() == 4
    expected = SAMPLES.select("force_N", "count", "brake", "note")
    assert frame.select(expected.columns).equals(expected)


def test_both_bounds_are_inclusive(table: Path) -> None:
    frame = open_log(table).read("table", ["count"], start_ns=100_000_000, end_ns=200_000_000)
    assert frame["count"].to_list() == [2, 3]


def test_rows_out_of_order_are_sorted_stably(tmp_path: Path) -> None:
    path = write_csv(tmp_path, "t_ns,a\n5,1\n3,2\n5,3\n3,4\n")
    assert open_log(path).read("table", ["a"])["a"].to_list() == [2, 4, 1, 3]


def test_rows_without_a_time_are_dropped_and_counted(tmp_path: Path) -> None:
    log = open_log(write_csv(tmp_path, "time_s,a\n0,1\n,2\nnan,3\n1,4\n"))
    assert log.read("table", ["a"])["a"].to_list() == [1, 4]
    assert [loss.what for loss in log.losses()] == ["2 of 4 rows have no time; they were dropped"]


def test_text_among_numbers_is_null_and_counted(tmp_path: Path) -> None:
    log = open_log(write_csv(tmp_path, "time_s,a\n0,1.5\n1,broken\n2,\n3,2\n"))
    assert log.read("table", ["a"])["a"].to_list() == [1.5, None, None, 2.0]
    assert [loss.what for loss in log.losses()] == [
        "1 cells of column 'a' are not numbers; the first is 'broken'"
    ]


def test_a_byte_order_mark_is_no_part_of_the_first_name(tmp_path: Path) -> None:
    log = open_log(write_csv(tmp_path, "\ufefftime_s,a\n0,1\n"))
    assert log.read("table", ["a"])["a"].to_list() == [1]


def test_a_header_alone_is_a_log_of_no_messages(tmp_path: Path) -> None:
    log = open_log(write_csv(tmp_path, "time_s,a\n"))
    assert log.topics()["messages"].to_list() == [0]
    assert log.read("table", ["a"]).is_empty()


def test_the_time_axis_may_be_given(tmp_path: Path) -> None:
    path = write_csv(tmp_path, "clock,a\n1500,1\n2500,2\n")
    log = open_log(path, time=TimeAxis("clock", "ms"))
    assert log.read("table", ["a"])["log_time_ns"].to_list() == [1_500_000_000, 2_500_000_000]


@pytest.mark.parametrize(
    ("time", "answer"),
    [
        (None, r"no time column among 'clock', 'a'; name it in the machine file: \[log\] time"),
        (TimeAxis("clok"), r"no column 'clok' for the time; did you mean 'clock'\?"),
        (TimeAxis("clock", "h"), "no unit of time 'h'; use s, ms, us, ns"),
    ],
)
def test_a_table_without_its_time_names_the_columns_and_the_remedy(
    tmp_path: Path, time: TimeAxis | None, answer: str
) -> None:
    with pytest.raises(LogError, match=answer):
        open_log(write_csv(tmp_path, "clock,a\n1500,1\n"), time=time)


def test_a_time_column_in_another_unit_is_found_out(tmp_path: Path) -> None:
    log = open_log(write_csv(tmp_path, "time_s,a\n1700000000123456789,1\n"))
    with pytest.raises(
        LogError, match=r"unit of the time is wrong. Set \[log\] time and time_unit"
    ):
        log.topics()


@pytest.mark.parametrize(
    ("topic", "field", "answer"),
    [
        ("/imu", "count", "no topic '/imu'; a table has the one topic 'table'"),
        ("table", "cuont", r"no column 'cuont'; did you mean 'count'\?"),
    ],
)
def test_a_wrong_topic_or_column_is_one_line(
    table: Path, topic: str, field: str, answer: str
) -> None:
    with pytest.raises(LogError, match=answer):
        open_log(table).read(topic, [field])


def test_nested_columns_are_not_offered(tmp_path: Path) -> None:
    frame = pl.DataFrame({"time_s": [0.0], "pose": [[1.0, 2.0]], "big": [2**64 - 1]})
    frame.write_parquet(tmp_path / "shift.parquet")
    log = open_log(tmp_path / "shift.parquet")
    assert log.topics()["fields"][0].to_list() == ["time_s", "big"]
    assert log.read("table", ["big"])["big"].to_list() == [2**64 - 1]


@pytest.mark.parametrize("separator", [";", "\t"])
def test_a_table_that_is_not_separated_by_commas_is_read_and_says_so(
    tmp_path: Path, separator: str
) -> None:
    SAMPLES.write_csv(tmp_path / "shift.csv", separator=separator)
    log = open_log(tmp_path / "shift.csv")
    assert log.read("table", ["count"])["count"].to_list() == [1, 2, 3, 4]
    assert "cells separated by a" in log.notes()[0]


def test_a_wide_table_without_time_names_only_some_of_its_columns(tmp_path: Path) -> None:
    pl.DataFrame({f"c{k}": [0.0] for k in range(200)}).write_csv(tmp_path / "wide.csv")
    with pytest.raises(LogError, match=r"'c0', .*'c19' and 180 more; name it"):
        open_log(tmp_path / "wide.csv")


def test_a_torn_parquet_file_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "shift.parquet"
    SAMPLES.write_parquet(path)
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(LogError, match="not a parquet table") as caught:
        open_log(path)
    assert_one_line(caught.value)


def test_a_table_that_was_closed_says_so_as_every_log_does(table: Path) -> None:
    with open_log(table) as log:
        log.topics()
    with pytest.raises(LogError, match="the log was closed; open it again"):
        log.read("table", ["count"])


@pytest.mark.heavy
def test_a_page_that_asks_for_more_than_all_memory_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "shift.parquet"
    SAMPLES.write_parquet(path)
    data = path.read_bytes()
    for at in range(4, len(data) - 8, 3):
        path.write_bytes(data[:at] + b"\xff" * 5 + data[at + 5 :])
        with one_line_at_most(), open_log(path) as log:
            log.read("table", SAMPLES.columns)


@pytest.mark.parametrize(
    ("seconds", "fractions"),
    [
        ("header.stamp.sec", "header.stamp.nanosec"),
        ("/imu/header/stamp/secs", "/imu/header/stamp/nsecs"),
        ("header_stamp_sec", "header_stamp_nanosec"),
        ("sec", "nanosec"),
    ],
)
def test_a_stamp_in_two_columns_of_a_message_is_one_time(
    tmp_path: Path, seconds: str, fractions: str
) -> None:
    path = write_csv(
        tmp_path,
        f"{seconds},{fractions},speed,wheel_ms\n"
        "1700000000,999999999,0.1,7\n1700000001,9999999,0.2,8\n1700000001,20000000,0.3,9\n",
    )
    with open_log(path) as log:
        stamps = log.read("table", ["speed"])["log_time_ns"].to_list()
    second = 10**9
    assert stamps == [
        1_700_000_001 * second - 1,
        1_700_000_001 * second + 9_999_999,
        1_700_000_001 * second + 20_000_000,
    ]


def test_a_time_of_the_record_comes_before_a_stamp_in_two_columns(tmp_path: Path) -> None:
    rows = "\n".join(f"{1.7e9 + k / 50:.2f},{17 * 10**8 + k // 50},{k % 50},{k}" for k in range(99))
    path = write_csv(tmp_path, f"Time,header.stamp.secs,header.stamp.nsecs,speed\n{rows}\n")
    with open_log(path) as log:
        assert log.topics()["rate_hz"][0] == pytest.approx(50.0)


def test_a_column_stamp_is_a_time(tmp_path: Path) -> None:
    path = write_csv(tmp_path, "stamp,speed\n1.7e9,1\n1700000000.5,2\n1700000001.0,3\n")
    with open_log(path) as log:
        assert log.topics()["rate_hz"][0] == pytest.approx(2.0)


def test_a_time_in_two_units_is_no_time_and_its_fraction(tmp_path: Path) -> None:
    rows = "\n".join(f"{k // 50},{20 * k},{k}" for k in range(99))
    path = write_csv(tmp_path, f"time_s,time_ms,speed\n{rows}\n")
    with open_log(path) as log:
        assert log.topics()["rate_hz"][0] == pytest.approx(50.0)


@pytest.mark.parametrize("suffix", ["parquet", "csv"])
def test_numbers_of_a_stamp_may_be_floats(tmp_path: Path, suffix: str) -> None:
    count = 99
    frame = pl.DataFrame(
        {
            "odom.header.stamp.sec": [1.7e9 + k // 50 for k in range(count)],
            "odom.header.stamp.nanosec": [2e7 * (k % 50) for k in range(count)],
            "motor.t": [20.0 + k / 100 for k in range(count)],
        }
    )
    path = tmp_path / f"shift.{suffix}"
    frame.write_csv(path) if suffix == "csv" else frame.write_parquet(path)
    with open_log(path) as log:
        assert log.topics()["rate_hz"][0] == pytest.approx(50.0)


def test_the_only_column_in_a_unit_of_time_comes_before_a_part_that_is_called_t(
    tmp_path: Path,
) -> None:
    rows = "\n".join(f"{k / 50},{20 + k / 100},{k}" for k in range(99))
    path = write_csv(tmp_path, f"log_clock_s,motor.t,speed_m_s\n{rows}\n")
    with open_log(path) as log:
        assert log.topics()["rate_hz"][0] == pytest.approx(50.0)


def test_a_time_in_numbers_comes_before_a_coarse_time_in_text(tmp_path: Path) -> None:
    count = 99
    frame = pl.DataFrame(
        {
            "t": [k / 50 for k in range(count)],
            "timestamp": [f"2026-03-01 12:00:{k // 50:02d}" for k in range(count)],
        }
    )
    frame.write_parquet(tmp_path / "shift.parquet")
    with open_log(tmp_path / "shift.parquet") as log:
        assert log.topics()["rate_hz"][0] == pytest.approx(50.0)
