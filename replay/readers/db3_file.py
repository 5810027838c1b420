"""The container of rosbag2's SQLite storage (`.db3`), with or without its directory."""

import json
import sqlite3
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from estimators.errors import LogError
from replay.decoding.batch import RawBatch, StoredMessage, join_messages
from replay.readers.container import Connection, LossList, no_times

_MAGIC: Final = b"SQLite format 3\x00"


class Db3File:
    """A `.db3` file. Before ROS 2 Iron it carries no message definitions."""

    def __init__(self, path: Path) -> None:
        with path.open("rb") as file:
            if file.read(len(_MAGIC)) != _MAGIC:
                raise LogError(f"{path}: not a rosbag2 .db3 file; it is no SQLite database")
        self.files: tuple[Path, ...] = (path,)
        self.losses = LossList()
        self._path = path
        self._times: dict[int, NDArray[np.int64]] | None = None
        self._database = _connect(path)
        try:
            self.connections: tuple[Connection, ...] = self._connections()
        except sqlite3.Error as error:
            self._database.close()
            raise LogError(
                f"{path}: not readable as a rosbag2 database ({error}); "
                "it should have the tables 'topics' and 'messages'"
            ) from error

    def _connections(self) -> tuple[Connection, ...]:
        self._database.execute("SELECT id, topic_id, timestamp, data FROM messages LIMIT 1")
        tables = self._database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")
        definitions: dict[str, tuple[str, str]] = {}
        if ("message_definitions",) in tables.fetchall():
            definitions = {
                name: (text, encoding)
                for name, text, encoding in self._database.execute(
                    "SELECT topic_type, encoded_message_definition, encoding"
                    " FROM message_definitions"
                )
            }
        return tuple(
            Connection(key, topic, kind, encoding, *definitions.get(kind, ("", "")))
            for key, topic, kind, encoding in self._database.execute(
                "SELECT id, name, type, serialization_format FROM topics ORDER BY id"
            )
        )

    def log_times(self, connection_id: int) -> NDArray[np.int64]:
        """The log times of a topic; the first call goes through the whole table."""
        if self._times is None:
            stamps = "SELECT topic_id, timestamp FROM messages"
            pairs = np.fromiter(self._rows(stamps, ()), np.dtype((np.int64, 2)))
            self._times = {c.id: pairs[pairs[:, 0] == c.id, 1] for c in self.connections}
        return self._times.get(connection_id, no_times())

    def batches(
        self, connection_ids: Collection[int], start_ns: int | None, end_ns: int | None
    ) -> Iterator[RawBatch]:
        """The messages in batches; see `Container.batches`."""
        return join_messages(self._messages(connection_ids, start_ns, end_ns))

    def _messages(
        self, connection_ids: Collection[int], start_ns: int | None, end_ns: int | None
    ) -> Iterator[StoredMessage]:
        """Messages in log-time order, ties as stored."""
        query = (
            "SELECT timestamp, data FROM messages"
            " WHERE topic_id IN (SELECT value FROM json_each(?)) AND timestamp BETWEEN ? AND ?"
            " ORDER BY timestamp, id"
        )
        chosen = json.dumps(list(connection_ids))
        first = -(2**63) if start_ns is None else start_ns
        last = 2**63 - 1 if end_ns is None else end_ns
        for time, data in self._rows(query, (chosen, first, last)):
            yield StoredMessage(time, data)

    def _rows(self, query: str, values: tuple[object, ...]) -> Iterator[tuple[Any, ...]]:
        try:
            yield from self._database.execute(query, values)
        except sqlite3.Error as error:
            self.losses.note(self._path, f"the database is damaged, its rest is not read: {error}")

    def close(self) -> None:
        """Release the file."""
        self._database.close()


def _connect(path: Path) -> sqlite3.Connection:
    # immutable reads files on read-only media, but is blind to messages still in a -wal file
    journal = path.with_name(f"{path.name}-wal")
    unfinished = journal.exists() and journal.stat().st_size > 0
    mode = "mode=ro" if unfinished else "mode=ro&immutable=1"
    try:
        database = sqlite3.connect(f"{path.absolute().as_uri()}?{mode}", uri=True)
    except sqlite3.Error as error:
        raise LogError(f"{path}: cannot be opened: {error}") from error
    database.text_factory = _decode
    return database


def _decode(text: bytes) -> str:
    return text.decode(errors="replace")
