"""A growing rosbag2 folder is read to its last row, whatever its recorder is doing meanwhile."""

import os
import sqlite3
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import pytest

from replay.logs import growing_logs
from replay.logs.growing_logs import TailParts
from replay.logs.log_limits import LogLimits
from replay.logs.sqlite import Db3Tail, db3_tail

SCHEMA = (
    "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,"
    " serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL)",
    "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL,"
    " timestamp INTEGER NOT NULL, data BLOB NOT NULL)",
)


class Recorder:
    """One connection to a file of the log."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.database = sqlite3.connect(path, isolation_level=None)
        for statement in SCHEMA:
            self.database.execute(statement)

    def add_topic(self) -> None:
        self.database.execute(
            "INSERT INTO topics VALUES (1, '/a', 'std_msgs/msg/String', 'cdr', '')"
        )

    def add_message(self, time_ns: int) -> None:
        self.database.execute("INSERT INTO messages VALUES (NULL, 1, ?, x'00')", (time_ns,))


@pytest.fixture
def record(tmp_path: Path) -> Iterator[Callable[[int], Recorder]]:
    opened: list[Recorder] = []

    def begin(number: int) -> Recorder:
        opened.append(Recorder(tmp_path / f"log_{number}.db3"))
        return opened[-1]

    yield begin
    for recorder in opened:
        recorder.database.close()


def follow(folder: Path) -> TailParts:
    return TailParts(lambda: sorted(folder.glob("*.db3")), Db3Tail, lambda: False)


def poll_times(tail: TailParts) -> list[int]:
    return [int(time) for batch in tail.poll() for time in batch.log_times]


def test_a_row_is_read_of_a_file_that_looks_as_before(
    record: Callable[[int], Recorder], tmp_path: Path
) -> None:
    """The bytes of a transaction are in a file before its readers are shown it."""
    recorder = record(0)
    recorder.add_topic()
    recorder.add_message(1)
    with closing(follow(tmp_path)) as tail:
        assert poll_times(tail) == [1]
        assert poll_times(tail) == []
        before = recorder.path.stat()
        recorder.add_message(2)
        os.utime(recorder.path, ns=(before.st_atime_ns, before.st_mtime_ns))
        assert recorder.path.stat().st_size == before.st_size
        assert poll_times(tail) == [2]


def test_a_locked_file_is_read_before_the_next_one(
    record: Callable[[int], Recorder], tmp_path: Path
) -> None:
    first, second = record(0), record(1)
    for recorder in (first, second):
        recorder.add_topic()
    first.add_message(1)
    second.add_message(3)
    with closing(follow(tmp_path)) as tail:
        assert poll_times(tail) == [1]
        first.add_message(2)
        first.database.execute("BEGIN EXCLUSIVE")
        assert poll_times(tail) == []
        first.database.execute("COMMIT")
        assert poll_times(tail) == [2]
        assert poll_times(tail) == [3]
        assert not tail.losses


def test_each_lock_is_waited_for_however_long_ago_the_last_one_was(
    record: Callable[[int], Recorder], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(growing_logs, "LIMITS", LogLimits(unreadable_part_s=0.3))
    first = record(0)
    first.add_topic()
    with closing(follow(tmp_path)) as tail:
        first.database.execute("BEGIN EXCLUSIVE")
        assert poll_times(tail) == []
        first.database.execute("COMMIT")
        first.add_message(1)
        assert poll_times(tail) == [1]
        time.sleep(0.4)
        first.add_message(2)
        second = record(1)
        second.add_topic()
        second.add_message(3)
        first.database.execute("BEGIN EXCLUSIVE")
        assert poll_times(tail) == []
        first.database.execute("COMMIT")
        assert [poll_times(tail), poll_times(tail)] == [[2], [3]]
        assert not tail.losses


def test_a_file_that_stays_unreadable_is_left_with_a_loss(
    record: Callable[[int], Recorder], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(growing_logs, "LIMITS", LogLimits(unreadable_part_s=0.0))
    (tmp_path / "log_0.db3").write_bytes(b"no database" * 100)
    second = record(1)
    second.add_topic()
    second.add_message(3)
    with closing(follow(tmp_path)) as tail:
        assert poll_times(tail) == [3]
        (loss,) = tail.losses
        assert loss.what == "its rows cannot be read: file is not a database"


def test_a_topic_that_comes_during_a_poll_loses_no_message(
    record: Callable[[int], Recorder], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder = record(0)
    recorder.database.execute("PRAGMA journal_mode = WAL")
    fetch_all_rows = db3_tail.fetch_all_rows

    def fetch_and_record(database: sqlite3.Connection, query: str) -> list[db3_tail.Row]:
        rows = fetch_all_rows(database, query)
        if rows == [(0,)]:
            recorder.add_topic()
            recorder.add_message(1)
        return rows

    monkeypatch.setattr(db3_tail, "fetch_all_rows", fetch_and_record)
    with closing(follow(tmp_path)) as tail:
        assert poll_times(tail) == []
        assert poll_times(tail) == [1]
        assert not tail.losses
