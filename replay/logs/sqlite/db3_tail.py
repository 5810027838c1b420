"""Read the committed rows of a rosbag2 database that is still being written."""

import sqlite3
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Final

from analysis.model.loss import Loss
from estimators.errors import LogError
from replay.logs.messages.broken_bytes import BrokenBytesError
from replay.logs.messages.raw_batch import RawBatch, make_batch_of_messages
from replay.logs.sqlite.row_query import LEAST_ID, Row, convert_sqlite_errors, fetch_all_rows
from replay.logs.sqlite.sqlite_file import open_database_for_reading, read_connections_of_database
from replay.logs.storage import Connection, LossList

#: Most rows of one poll.
_POLL_ROWS: Final = 16_384
#: Time in ms that a poll waits for a lock of the recorder: about the interval between polls.
_LOCKED_MS: Final = 50
_MESSAGES: Final = (
    "SELECT rowid, topic_id, timestamp, data FROM messages WHERE rowid > ? ORDER BY rowid LIMIT ?"
)


class Db3Tail:
    """A growing `.db3` file, from which the end of the recording cannot be known."""

    def __init__(self, path: Path) -> None:
        self.connections: dict[int, Connection] = {}
        self.is_finished = False
        self.read_error = ""
        self._path = path
        self._losses = LossList()
        self._last_id = LEAST_ID

    @property
    def losses(self) -> Sequence[Loss]:
        """Damage found so far."""
        return [*self._losses]

    def poll(self) -> list[RawBatch]:
        """See `Tail.poll`; a locked or half-written database is left for a later call."""
        # always query, even if size and time of the files are unchanged: bytes of a transaction are
        # written before readers see it
        try:
            with closing(open_database_for_reading(self._path, is_unfinished=True)) as database:
                rows = self._read_new_rows(database)
        except (BrokenBytesError, LogError) as error:
            self.read_error = str(error) or type(error.__cause__).__name__
            return []
        self.read_error = ""
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

    def finish_and_note_incomplete_end(self) -> None:
        """See `Tail.finish_and_note_incomplete_end`; transactions are never partial."""
        if self.read_error:
            rows = f"its rows after {self._last_id:,}" if self._last_id > LEAST_ID else "its rows"
            self._losses.add_loss(self._path, f"{rows} cannot be read: {self.read_error}")

    def close(self) -> None:
        """Do nothing; the file is closed between polls so that a recorder may checkpoint it."""

    def _read_new_rows(self, database: sqlite3.Connection) -> list[Row]:
        with convert_sqlite_errors():
            database.execute(f"PRAGMA busy_timeout = {_LOCKED_MS}")
            # read one state of the database, else messages may belong to topics not yet read
            database.execute("BEGIN")
        known = len(self.connections)
        (count,) = fetch_all_rows(database, "SELECT count(*) FROM topics")[0]
        if count > known:
            found = read_connections_of_database(
                database, lambda what: self._losses.add_loss(self._path, what)
            )
            self.connections.update({each.id: each for each in found})
        with convert_sqlite_errors():
            return database.execute(_MESSAGES, (self._last_id, _POLL_ROWS)).fetchall()
