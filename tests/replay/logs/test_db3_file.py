"""rosbag2's SQLite files without their directory."""

import contextlib
import sqlite3
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from estimators.errors import LogError
from replay import open_log
from tests.replay.logs.one_line import one_line_at_most
from tests.replay.logs.written_logs import Joints, write_db3

DRIVE = [Joints(1000 + k, {"left": float(k)}) for k in range(5000)]


def test_a_type_without_definition_is_taken_from_a_ros2_release(tmp_path: Path) -> None:
    write_db3(tmp_path / "old.db3", DRIVE[:3])
    with sqlite3.connect(tmp_path / "old.db3") as database:
        database.execute("DROP TABLE message_definitions")
    database.close()
    frame = open_log(tmp_path / "old.db3").read("/joints", ["effort[left]"])
    assert frame["effort[left]"].to_list() == [0.0, 1.0, 2.0]


@pytest.mark.parametrize("column", ["encoding", "encoded_message_definition"])
@pytest.mark.parametrize("value", ["NULL", "x'ff'"])
def test_a_definition_that_is_no_text_is_taken_from_a_release_too(
    tmp_path: Path, column: str, value: str
) -> None:
    write_db3(tmp_path / "shift.db3", DRIVE[:3])
    with sqlite3.connect(tmp_path / "shift.db3") as database:
        database.execute("CREATE TABLE loose AS SELECT * FROM message_definitions")
        database.execute("DROP TABLE message_definitions")
        database.execute("ALTER TABLE loose RENAME TO message_definitions")
        database.execute(f"UPDATE message_definitions SET {column} = {value}")
    database.close()
    frame = open_log(tmp_path / "shift.db3").read("/joints", ["effort[left]"])
    assert frame["effort[left]"].to_list() == [0.0, 1.0, 2.0]


def test_a_type_that_no_release_knows_costs_its_topic(tmp_path: Path) -> None:
    write_db3(tmp_path / "old.db3", DRIVE[:3])
    with sqlite3.connect(tmp_path / "old.db3") as database:
        database.execute("DROP TABLE message_definitions")
        database.execute("UPDATE topics SET type = 'own_msgs/msg/Boom'")
    database.close()
    problem = open_log(tmp_path / "old.db3").topics()["problem"][0]
    assert problem.startswith("the log carries no definition of own_msgs/msg/Boom")


def test_messages_still_in_the_write_ahead_log_are_read(tmp_path: Path) -> None:
    path = tmp_path / "live.db3"
    write_db3(path, DRIVE[:3])
    database = sqlite3.connect(path)
    database.execute("PRAGMA journal_mode = WAL")
    database.execute("PRAGMA wal_autocheckpoint = 0")
    database.execute(
        "INSERT INTO messages (topic_id, timestamp, data) SELECT topic_id, 9999, data FROM messages"
    )
    database.commit()
    with open_log(path) as log:
        assert log.topics()["messages"].to_list() == [6]
    database.close()


def test_messages_that_no_commit_closes_are_a_loss(tmp_path: Path) -> None:
    path, journal = tmp_path / "live.db3", tmp_path / "live.db3-wal"
    write_db3(path, DRIVE[:3])
    with contextlib.closing(sqlite3.connect(path)) as database:
        database.execute("PRAGMA journal_mode = WAL")
        database.execute("PRAGMA wal_autocheckpoint = 0")
        sizes = [0]
        for _ in range(2):
            database.execute(
                "INSERT INTO messages (topic_id, timestamp, data)"
                " SELECT topic_id, 9999, zeroblob(9000) FROM messages"
            )
            database.commit()
            sizes.append(journal.stat().st_size)
        copies = {p.name: p.read_bytes() for p in (path, journal)}
    crashed = tmp_path / "crashed"
    crashed.mkdir()
    for cut, losses in ((sizes[2], 0), (sizes[2] - 1, 1), (sizes[1] + 10, 1), (sizes[1], 0)):
        (crashed / path.name).write_bytes(copies[path.name])
        (crashed / journal.name).write_bytes(copies[journal.name][:cut])
        with open_log(crashed / path.name) as log:
            assert log.topics()["messages"].to_list() == [12 if cut == sizes[2] else 6]
            assert len(log.losses()) == losses
            for loss in log.losses():
                assert f"the last {cut - sizes[1]:,} bytes of live.db3-wal" in loss.what


def test_bytes_behind_the_last_page_are_told_as_what_they_are(tmp_path: Path) -> None:
    path = tmp_path / "shift.db3"
    write_db3(path, DRIVE[:3])
    path.write_bytes(path.read_bytes() + b"junk")
    with open_log(path) as log:
        assert log.topics()["messages"].to_list() == [3]
        assert [loss.what for loss in log.losses()] == [
            "has 4 bytes after its last page, which were not read"
        ]


def test_a_database_that_is_no_bag_is_refused(tmp_path: Path) -> None:
    with sqlite3.connect(tmp_path / "other.db3") as database:
        database.execute("CREATE TABLE poems (line TEXT)")
    database.close()
    with pytest.raises(LogError, match="should have the tables 'topics' and 'messages'"):
        open_log(tmp_path / "other.db3")


@pytest.mark.parametrize("share", [0.2, 0.5, 0.9])
@pytest.mark.parametrize("beside", [0, 1000])
def test_a_database_is_read_up_to_the_page_that_is_torn(
    tmp_path: Path, share: float, beside: int
) -> None:
    path = tmp_path / "torn.db3"
    write_db3(path, DRIVE)
    data = path.read_bytes()
    cut = int(len(data) * share) // 4096 * 4096 + beside
    path.write_bytes(data[:cut])
    with open_log(path) as log:
        times = log.read("/joints", [])["log_time_ns"].to_list()
        assert times == sorted(set(times) & {j.log_time_ns for j in DRIVE})
        assert (share - 0.1) * len(DRIVE) < len(times) < share * len(DRIVE)
        whats = [loss.what for loss in log.losses()]
    assert whats[0].startswith(f"breaks off after byte {cut:,} of {len(data):,}")
    assert ("its last page is incomplete" in whats[0]) == bool(beside)


def test_a_database_torn_before_its_tables_is_refused_in_one_line(tmp_path: Path) -> None:
    write_db3(path := tmp_path / "torn.db3", DRIVE)
    path.write_bytes(path.read_bytes()[:5000])
    with pytest.raises(LogError, match=r"not readable as a rosbag2 database \(.*\)"):
        open_log(path)


def test_topics_that_damage_made_unreadable_are_said_and_so_are_their_messages(
    tmp_path: Path,
) -> None:
    path = tmp_path / "shift.db3"
    write_db3(path, [*DRIVE[:5], Joints(9000, {"left": 1.0}, topic="/other")])
    with sqlite3.connect(path) as database:
        database.execute("UPDATE topics SET name = x'00' WHERE name = '/other'")
    database.close()
    with open_log(path) as log:
        assert log.topics()["topic"].to_list() == ["/joints"]
        assert [loss.what for loss in log.losses()] == [
            "1 of its topics are damaged",
            "1 messages of topic 2, which has no definition: not read",
        ]
    with sqlite3.connect(path) as database:
        database.execute("DELETE FROM topics")
    database.close()
    with open_log(path) as log:
        assert log.topics().is_empty()
        assert "messages without their topics" in log.losses()[0].what


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(
    places=st.lists(st.tuples(st.integers(16, 10**6), st.integers(0, 255)), max_size=8),
    cut=st.integers(100, 10**6),
)
def test_damage_is_a_loss_or_one_line_never_a_traceback(
    tmp_path: Path, places: list[tuple[int, int]], cut: int
) -> None:
    whole = tmp_path / "whole.db3"
    if not whole.exists():
        write_db3(whole, DRIVE[:100])
    data = bytearray(whole.read_bytes())
    for at, value in places:
        data[at % len(data)] = value
    (tmp_path / "damaged.db3").write_bytes(data[:cut])
    with one_line_at_most(), open_log(tmp_path / "damaged.db3") as log:
        for topic in log.topics()["topic"]:
            log.read(topic, [])
        log.losses()
