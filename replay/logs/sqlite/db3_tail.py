"""A rosbag2 database that is still being written: its committed rows."""

import sqlite3
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Final

from analysis.model.loss import Loss
from replay.logs.messages.broken_bytes import BrokenBytesError
from replay.logs.messages.raw_batch import RawBatch, make_batch_of_messages
from replay.logs.sqlite.row_query import LEAST_ID, Row, convert_sqlite_errors, fetch_all_rows
from replay.logs.sqlite.sqlite_file import open_database_for_reading, read_connections_of_database
from replay.logs.storage import Connection, LossList

#: Rows of one poll.
_POLL_ROWS: Final = 16_384
_MESSAGES: Final = (
    "SELECT rowid, topic_id, timestamp, data FROM messages WHERE rowid > ? ORDER BY rowid LIMIT ?"
)


class Db3Tail:
    """A growing `.db3` file. A database does not show whether its recorder has ended."""

    def __init__(self, path: Path) -> None:
        self.connections: dict[int, Connection] = {}
        self.is_finished = False
        self._path = path
        self._journal = path.with_name(f"{path.name}-wal")
        self._losses = LossList()
        self._last_id = LEAST_ID
        #: size and time of the files when they last had no new rows
        self._idle_states: tuple[tuple[int, int], ...] = ()

    @property
    def losses(self) -> Sequence[Loss]:
        """Damage found so far."""
        return [*self._losses]

    def poll(self) -> list[RawBatch]:
        """See `Tail.poll`; a locked or half-written database is left for a later call."""
        looks = self._read_sizes_and_change_times()
        if looks == self._idle_states:
            return []
        try:
            with closing(open_database_for_reading(self._path, is_unfinished=True)) as database:
                rows = self._read_new_rows(database)
        except (BrokenBytesError, sqlite3.Error):
            return []
        if len(rows) < _POLL_ROWS:
            self._idle_states = looks
        messages: dict[int, tuple[list[int], list[bytes]]] = {}
        for number, topic, time, message in rows:
            self._last_id = number
            if topic in self.connections and isinstance(message, bytes) and time >= 0:
                times, contents = messages.setdefault(topic, ([], []))
                times.append(time)
                contents.append(message)
            else:
                self._losses.add_loss(self._path, f"row {number} is not a message of a known topic")
        return [make_batch_of_messages(topic, *parts) for topic, parts in messages.items()]

    def note_incomplete_end(self) -> None:
        """Do nothing, since transactions are never partial."""

    def close(self) -> None:
        """Do nothing; the file is closed between polls so that a recorder may checkpoint it."""

    def _read_sizes_and_change_times(self) -> tuple[tuple[int, int], ...]:
        return tuple(
            (stat.st_size, stat.st_mtime_ns)
            for stat in (path.stat() for path in (self._path, self._journal) if path.exists())
        )

    def _read_new_rows(self, database: sqlite3.Connection) -> list[Row]:
        known = len(self.connections)
        (count,) = fetch_all_rows(database, "SELECT count(*) FROM topics")[0]
        if count > known:
            found = read_connections_of_database(
                database, lambda what: self._losses.add_loss(self._path, what)
            )
            self.connections.update({each.id: each for each in found})
        with convert_sqlite_errors():
            return database.execute(_MESSAGES, (self._last_id, _POLL_ROWS)).fetchall()
