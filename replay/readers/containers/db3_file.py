"""The container of rosbag2's SQLite storage (`.db3`), with or without its directory."""

import sqlite3
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from analysis.run import Loss
from estimators.errors import LogError
from replay.decoding.batch import RawBatch
from replay.readers.container import Connection, no_times
from replay.readers.containers.by_connection import by_connection
from replay.readers.containers.damage import Damage
from replay.readers.containers.sqlite_rows import FAULTS, Row, read_rows

_MAGIC: Final = b"SQLite format 3\x00"
_HEAD_BYTES: Final = 100
_TIMES: Final = "SELECT rowid, topic_id, timestamp FROM messages WHERE rowid > ? ORDER BY rowid"
_MESSAGES: Final = _TIMES.replace("timestamp", "timestamp, data")


class Db3File:
    """A `.db3` file. Before ROS 2 Iron it carries no message definitions."""

    def __init__(self, path: Path) -> None:
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
        if not head.startswith(_MAGIC):
            raise LogError(f"{path}: not a rosbag2 .db3 file; it is no SQLite database")
        self.files: tuple[Path, ...] = (path,)
        self._damage = Damage(path.name)
        tear = _tear(head, path.stat().st_size)
        if tear:
            self._damage.note(tear)
        self._path = path
        self._times: dict[int, NDArray[np.int64]] | None = None
        self._database = _connect(path)
        try:
            self.connections: tuple[Connection, ...] = self._connections()
        except FAULTS as error:
            self._database.close()
            reason = " ".join(str(error).split())
            raise LogError(
                f"{path}: not readable as a rosbag2 database ({reason}); "
                "it should have the tables 'topics' and 'messages'"
            ) from error

    def _connections(self) -> tuple[Connection, ...]:
        found = self._database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")
        tables = {name for (name,) in found}
        if not tables >= {"topics", "messages"}:
            raise sqlite3.DatabaseError(f"it has {', '.join(sorted(tables)) or 'no tables'}")
        self._database.execute(f"{_MESSAGES} LIMIT 0", (0,)).close()
        definitions: dict[str, tuple[str, str]] = {}
        if "message_definitions" in tables:
            definitions = {
                name: (text, encoding)
                for name, text, encoding in self._database.execute(
                    "SELECT topic_type, encoded_message_definition, encoding"
                    " FROM message_definitions WHERE typeof(encoded_message_definition) = 'text'"
                    " AND typeof(encoding) = 'text'"
                )
            }
        topics = self._database.execute(
            "SELECT id, name, type, serialization_format,"
            " typeof(id) = 'integer' AND typeof(name) = 'text' AND typeof(type) = 'text'"
            " AND typeof(serialization_format) = 'text' FROM topics ORDER BY id"
        ).fetchall()
        whole = [row for *row, is_topic in topics if is_topic]
        if len(whole) < len(topics):
            self._damage.note(f"{len(topics) - len(whole):,} of its topics are damaged")
        if not whole and self._database.execute("SELECT 1 FROM messages LIMIT 1").fetchone():
            self._damage.note("it holds messages and no topic that they are of")
        return tuple(
            Connection(key, str(topic), str(kind), str(encoding), *definitions.get(kind, ("", "")))
            for key, topic, kind, encoding in whole
        )

    @property
    def losses(self) -> Sequence[Loss]:
        """What was found damaged so far."""
        return self._damage.losses({})

    def log_times(self, connection_id: int) -> NDArray[np.int64]:
        """The log times of a topic; the first call goes through the whole table."""
        if self._times is None:
            found = [np.empty((2, 0), np.int64)]
            found += [numbers for numbers, _ in self._rows(_TIMES, has_blob=False)]
            keys, times = np.concatenate(found, axis=1)
            self._times = {key: self._since_1970(key, times[at]) for key, at in by_connection(keys)}
            for key in self._times.keys() - {c.id for c in self.connections}:
                count = self._times[key].size
                self._damage.note(f"{count:,} messages of topic {key}, which nothing describes")
        return self._times.get(connection_id, no_times())

    def _since_1970(self, key: int, times: NDArray[np.int64]) -> NDArray[np.int64]:
        early = int(np.count_nonzero(times < 0))
        if early:
            topic = next((c.topic for c in self.connections if c.id == key), "")
            what = f"{early:,} messages have log times before the year 1970: not used"
            self._damage.note(what, topic)
        return times[times >= 0]

    def batches(
        self, connection_ids: Collection[int], start_ns: int | None, end_ns: int | None
    ) -> Iterator[RawBatch]:
        """Messages as stored; a damaged page of the database costs that page."""
        wanted = np.array(sorted(connection_ids), np.int64)
        first = 0 if start_ns is None else max(start_ns, 0)
        last = 2**63 - 1 if end_ns is None else end_ns
        for (keys, times), messages in self._rows(_MESSAGES, has_blob=True):
            length = np.fromiter(map(len, messages), np.int64, len(messages))
            offset = np.cumsum(length) - length
            data = np.frombuffer(b"".join(messages), np.uint8)
            use = np.flatnonzero(np.isin(keys, wanted) & (times >= first) & (times <= last))
            for key, part in by_connection(keys[use]):
                at = use[part]
                yield RawBatch(key, data, offset[at], length[at], times[at])

    def _rows(
        self, query: str, *, has_blob: bool
    ) -> Iterator[tuple[NDArray[np.int64], list[bytes]]]:
        """Topic and time (2, n) and, with `has_blob`, messages, of rows that hold them."""
        for rows in read_rows(self._database, query, self._damage.note, has_blob=has_blob):
            try:
                yield _columns(rows, has_blob=has_blob)
            except (TypeError, ValueError, OverflowError):  # SQLite asks nobody for types
                whole = [row for row in rows if _is_message(row)]
                lost = len(rows) - len(whole)
                self._damage.note(f"{lost:,} rows from row {rows[0][0]} on hold no message")
                yield _columns(whole, has_blob=has_blob)

    def close(self) -> None:
        """Release the file."""
        self._database.close()


def _tear(head: bytes, size: int) -> str | None:
    """What the first page of a database says of the end of its file, where that is torn."""
    page = int.from_bytes(head[16:18], "big")
    page = 2**16 if page == 1 else page
    # the number of pages counts if what changed it last also changed the version behind it
    pages = int.from_bytes(head[28:32], "big") if head[24:28] == head[92:96] else 0
    if not page or not (size % page or pages * page > size):
        return None
    unsure = ", and its last page is torn: what stood there may be altered" if size % page else ""
    return f"breaks off after byte {size:,} of {max(pages * page, size):,}{unsure}"


def _columns(rows: list[Row], *, has_blob: bool) -> tuple[NDArray[np.int64], list[bytes]]:
    numbers = np.array([[row[1] for row in rows], [row[2] for row in rows]], np.int64)
    messages = [row[3] for row in rows] if has_blob else []
    if {*map(type, messages)} - {bytes}:
        raise TypeError("a message that is no blob")
    return numbers, messages


def _is_message(row: Row) -> bool:
    types = tuple(map(type, row))
    return types in ((int, int, int), (int, int, int, bytes))


def _connect(path: Path) -> sqlite3.Connection:
    # immutable reads files on read-only media, but is blind to messages still in a -wal file
    journal = path.with_name(f"{path.name}-wal")
    unfinished = journal.exists() and journal.stat().st_size > 0
    mode = "mode=ro" if unfinished else "mode=ro&immutable=1"
    try:
        database = sqlite3.connect(
            f"{path.absolute().as_uri()}?{mode}", uri=True, check_same_thread=False
        )
        # without it, SQLite refuses a file whose end is torn off; the mode keeps it from writing
        database.execute("PRAGMA writable_schema = ON")
    except sqlite3.Error as error:
        raise LogError(f"{path}: cannot be opened: {error}") from error
    database.text_factory = _decode
    return database


def _decode(text: bytes) -> str:
    return text.decode(errors="replace")
