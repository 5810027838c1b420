"""`payscope query`: SQL over topics, recordings, ledgers, results; it reads nothing else."""

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path

import polars as pl
import pyarrow.feather
import pytest

from estimators.errors import QueryError
from recordings import read_frame, write_recording
from replay import load_machine, open_log, run
from replay.query.run_query import prepare_query_of_sources
from tests.one_line import assert_one_line
from tests.replay.logs.written_logs import Joints, write_bag, write_mcap
from tests.replay.sledge import MACHINE, Payscope, join_to_one_line, sledge

START_NS = 1_700_000_000_000_000_000
FORCED = 'SELECT log_time, "effort[left]" AS effort FROM wheels WHERE "effort[left]" > 8'


def joints(count: int, topic: str = "/wheels") -> list[Joints]:
    return [
        Joints(START_NS + k * 10_000_000, {"left": float(k % 10), "right": -float(k)}, topic)
        for k in range(count)
    ]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two bags, the log of a sledge with its recording, and one of another day."""
    folder = tmp_path_factory.mktemp("query")
    write_bag(folder / "one.bag", joints(300))
    write_mcap(folder / "two.mcap", [*joints(200), *joints(10, "/a b")])
    (folder / "sledge.toml").write_text(MACHINE)
    sledge().write_csv(folder / "sledge.csv")
    machine = load_machine(folder / "sledge.toml")
    for name in ("sledge", "again"):
        with open_log(folder / "sledge.csv") as log:
            write_recording(run(log, machine), folder / f"{name}.rrd")
    return folder


@pytest.mark.heavy
def test_topics_are_tables_by_name_and_in_a_word(folder: Path) -> None:
    log = str(folder / "one.bag")
    read = open_log(log).read("/wheels", ["effort[left]"])
    found = prepare_query_of_sources([log], FORCED).collect_rows()
    assert found["effort"].to_list() == [9.0] * 30
    assert found["log_time"].dt.timestamp("ns").to_list() == (
        read.filter(pl.col("effort[left]") > 8)["log_time_ns"].to_list()
    )
    assert (
        prepare_query_of_sources([log], FORCED.replace("wheels", '"/wheels"'))
        .collect_rows()
        .equals(found)
    )


def test_a_time_in_sql_reaches_the_index(folder: Path) -> None:
    log = str(folder / "one.bag")
    found = prepare_query_of_sources(
        [log], "SELECT log_time FROM wheels WHERE log_time < '2023-11-14 22:13:20.05'"
    )
    assert 'SELECTION: col("log_time")' in found.rows.explain()
    assert found.collect_rows().height == 5


def test_rows_of_several_logs_say_which(folder: Path) -> None:
    logs = [str(folder / "one.bag"), str(folder / "two.mcap")]
    found = prepare_query_of_sources(
        logs, "SELECT source, count(log_time) AS n FROM wheels GROUP BY source"
    ).collect_rows()
    assert dict(found.iter_rows()) == {logs[0]: 300, logs[1]: 200}
    assert (
        prepare_query_of_sources(logs, 'SELECT count(log_time) AS n FROM "/a b"')
        .collect_rows()
        .item()
        == 10
    )


def test_frames_of_a_recording_have_the_second_that_view_takes(folder: Path) -> None:
    recording = folder / "sledge.rrd"
    frame = read_frame(recording, "gate")
    sql = "SELECT at_s, reason_x FROM gate WHERE reason_x = 'accepted'"
    found = prepare_query_of_sources([str(recording)], sql).collect_rows()
    accepted = frame.filter(pl.col("reason_x") == "accepted")
    assert found["at_s"].to_list() == (accepted["t_ns"] / 1e9).to_list()
    everything = prepare_query_of_sources([str(recording)], "SELECT * FROM gate").collect_rows()
    assert everything.drop("at_s").equals(frame)


def test_two_frames_are_joined_and_their_rows_are_moments(folder: Path, payscope: Payscope) -> None:
    recording = folder / "sledge.rrd"
    fast = (
        "SELECT e.at_s FROM excitation e JOIN gate g ON e.t_ns = g.t_ns "
        "WHERE e.speed_x_m_s > 1.5 AND g.reason_x <> 'accepted'"
    )
    said = payscope("query", recording, fast, "--moments", 1, "--format", "json")
    assert said.status == 0, said.err
    found = json.loads(said.out)
    rows = prepare_query_of_sources([str(recording)], fast).collect_rows()
    assert sum(each["rows"] for each in found) == rows.height
    assert 1 < len(found) < 9  # some in each cycle of ten seconds
    assert all(each["to_s"] - each["from_s"] < 8 for each in found)
    assert found[0]["opens"] == f"payscope view {recording} --at {found[0]['from_s']:.3f}"
    told = payscope("query", recording, fast)
    assert f"payscope view {recording} --at {rows['at_s'][0]:.3f}" in told.err


def test_moments_of_two_recordings_open_their_own(folder: Path) -> None:
    recordings = [folder / "again.rrd", folder / "sledge.rrd"]
    asked = prepare_query_of_sources(
        [*map(str, recordings)], "SELECT source, at_s FROM aligned WHERE at_s < 2"
    )
    found = asked.collect_rows(merge_within_s=0.5)
    assert found["opens"].to_list() == [f"payscope view {each} --at 0.000" for each in recordings]


def test_a_topic_beside_its_recording_has_its_seconds(folder: Path) -> None:
    asked = [str(folder / "sledge.rrd"), str(folder / "sledge.csv")]
    found = prepare_query_of_sources(asked, "SELECT max(at_s) AS log FROM sledge").collect_rows()
    frame = prepare_query_of_sources(
        asked, "SELECT max(at_s) AS recording FROM aligned"
    ).collect_rows()
    assert found.item() == pytest.approx(frame.item(), abs=0.011)


def test_view_opens_a_time_of_day(folder: Path) -> None:
    from recordings import read_provenance
    from replay.recording.view_recording import parse_moment_of_run_s

    recording = folder / "sledge.rrd"
    start = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(
        microseconds=read_provenance(recording).t0_unix_ns / 1000 + 12_500_000
    )
    assert parse_moment_of_run_s(recording, f"{start:%FT%T.%fZ}") == pytest.approx(12.5, abs=1e-6)
    assert parse_moment_of_run_s(recording, "7.25") == 7.25


def test_a_ledger_is_a_table(tmp_path: Path) -> None:
    pl.DataFrame({"cycle": [1, 2], "payload_kg": [900.0, 1100.0]}).write_csv(
        tmp_path / "ledger.csv"
    )
    found = prepare_query_of_sources(
        [str(tmp_path / "ledger.csv")], "SELECT sum(payload_kg) AS kg FROM ledger"
    )
    assert found.collect_rows().item() == 2000.0


@pytest.mark.parametrize("name", ["ledger.csv", "ledger.parquet"])
def test_a_ledger_with_former_names_of_checks_has_the_present_ones(
    name: str, tmp_path: Path
) -> None:
    rows = pl.DataFrame({"withheld_for": ["lag, clocks", ""]})
    (rows.write_csv if name.endswith("csv") else rows.write_parquet)(tmp_path / name)
    sql = "SELECT withheld_for FROM ledger WHERE withheld_for LIKE 'force_delay_s%'"
    found = prepare_query_of_sources([str(tmp_path / name)], sql).collect_rows()
    assert found["withheld_for"].to_list() == ["force_delay_s, clock_drift_s"]


@pytest.mark.parametrize("suffix", ["parquet", "arrow", "csv", "json"])
def test_rows_are_written(folder: Path, tmp_path: Path, payscope: Payscope, suffix: str) -> None:
    out = tmp_path / f"rows.{suffix}"
    said = payscope("query", folder / "one.bag", FORCED, "-o", out)
    assert (said.status, said.out) == (0, ""), said
    if suffix == "arrow":
        assert pyarrow.feather.read_table(out).num_rows == 30
    elif suffix == "json":
        assert json.loads(out.read_text())[0] == {
            "log_time": "2023-11-14T22:13:20.090000000+00:00",
            "effort": 9.0,
        }
    else:
        back = pl.read_parquet(out) if suffix == "parquet" else pl.read_csv(out)
        assert back["effort"].to_list() == [9.0] * 30
    join_to_one_line(payscope("query", folder / "one.bag", FORCED, "-o", out), "exists already")


def test_the_same_query_gives_the_same_order(folder: Path) -> None:
    logs = [str(folder / "one.bag")]
    sql = 'SELECT "effort[left]" AS e, count(log_time) AS n FROM wheels GROUP BY "effort[left]"'
    assert prepare_query_of_sources(logs, sql).collect_rows()["e"].to_list() == [
        float(k) for k in range(10)
    ]


@pytest.mark.parametrize(
    "sql",
    [
        "DROP TABLE wheels",
        "DELETE FROM wheels WHERE 1 = 1",
        "TRUNCATE TABLE wheels",
        "CREATE TABLE x AS SELECT * FROM wheels",
        "INSERT INTO wheels VALUES (1)",
        "COPY wheels TO 'x.csv'",
        "-- a comment\nDROP TABLE wheels",
        "SELECT * FROM read_csv('{file}')",
        "SELECT * FROM \"read_csv\"('{file}')",
        "SELECT * FROM READ_PARQUET ('{file}')",
        "SELECT * FROM wheels JOIN read_csv/* */('{file}') AS x ON TRUE",
        "SELECT E'\\'' FROM wheels, read_csv('{file}')",
        "WITH x AS (SELECT * FROM read_ipc('{file}')) SELECT * FROM x, wheels",
        "SELECT * FROM wheels; DROP TABLE wheels",
        "SELECT * INTO x FROM wheels",
        "SELECT * FROM '{file}'",
        'SELECT * FROM "{file}"',
    ],
)
def test_what_reads_or_writes_files_is_refused(folder: Path, tmp_path: Path, sql: str) -> None:
    secret = tmp_path / "secret.csv"
    secret.write_text("a\n1\n")
    with pytest.raises(QueryError) as refused:
        prepare_query_of_sources(
            [str(folder / "one.bag")], sql.replace("{file}", str(secret))
        ).collect_rows()
    assert_one_line(refused.value)
    assert str(refused.value).startswith("query: ")
    assert [each.name for each in tmp_path.iterdir()] == ["secret.csv"]


@pytest.mark.parametrize(
    ("sql", "parts"),
    [
        ("SELECT * FROM wheel", ["no table 'wheel'", "did you mean 'wheels'?", "/wheels"]),
        ("SELECT nosuch FROM wheels", ["nosuch"]),
        ("", ["it is empty"]),
        ("SELECT 1", ["names no table"]),
        ("SELECT at_s FROM", ["names no table"]),
    ],
)
def test_what_is_no_query_is_said_in_one_line(
    folder: Path, payscope: Payscope, sql: str, parts: list[str]
) -> None:
    join_to_one_line(payscope("query", folder / "one.bag", sql), *parts)


def test_what_is_asked_wrongly_says_the_remedy(
    folder: Path, payscope: Payscope, tmp_path: Path
) -> None:
    log = folder / "one.bag"
    join_to_one_line(payscope("query", log), "SELECT", "--tables")
    join_to_one_line(payscope("query", "nowhere.bag", FORCED), "nowhere.bag", "no such file")
    join_to_one_line(
        payscope("query", log, 'SELECT "effort[]" FROM wheels', "--moments", 1), "log_time"
    )
    join_to_one_line(
        payscope("query", log, 'SELECT "effort[]" FROM wheels', "-o", tmp_path / "x.csv"),
        *("effort[]", ".parquet"),
    )
    join_to_one_line(payscope("view", folder / "sledge.rrd", "--at", "noon"), "--at noon")


def test_tables_are_listed(folder: Path, payscope: Payscope) -> None:
    said = payscope("query", folder / "two.mcap", folder / "sledge.rrd", "--tables")
    assert said.status == 0
    for name in ("/a b", "a_b", "/wheels", "gate", "estimates_ls", "at_s"):
        assert name in said.out


def test_losses_are_said(tmp_path: Path, payscope: Payscope) -> None:
    whole = tmp_path / "whole.bag"
    write_bag(whole, joints(300), chunk_bytes=4000)
    torn = tmp_path / "torn.bag"
    torn.write_bytes(whole.read_bytes()[:-3000])
    said = payscope("query", torn, "SELECT count(log_time) AS n FROM wheels")
    assert said.status == 0
    assert "lost: torn.bag" in said.err
