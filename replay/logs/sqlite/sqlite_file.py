"""Container of rosbag2's SQLite storage (`.db3`), with or without its directory."""

import sqlite3
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import ExitStack, closing
from pathlib import Path
from struct import Struct
from typing import Final

import numpy as np
from numpy.typing import NDArray

from analysis.model.loss import Loss
from estimators.errors import LogError
from replay.logs.messages.broken_bytes import BrokenBytesError, describe_file_of_other_format
from replay.logs.messages.raw_batch import RawBatch
from replay.logs.sqlite.database_pages import HEADER_BYTES, MAGIC
from replay.logs.sqlite.messages_table import MessageTable
from replay.logs.sqlite.row_query import fetch_all_rows
from replay.logs.storage import (
    END_NS,
    KEY,
    LENGTH,
    OFFSET,
    TIME,
    UNKNOWN_NS,
    BatchGroup,
    Connection,
    FileBytes,
    FileDamage,
    group_rows_by_connection,
    make_empty_log_times,
)

#: magic, format, page size, number of checkpoints, two salts, two checksums
_HEADER: Final = Struct(">8I")
#: page, pages of the database (0 unless the frame commits), two salts, two checksums
_FRAME: Final = Struct(">6I")
#: First word of a WAL file, for either byte order of its checksums (SQLite file format, 4.1).
_MAGICS: Final = (0x377F0682, 0x377F0683)
#: Bytes of a database below which all rows are read and sorted before the first is returned.
_LEAST_BYTES_TO_ORDER: Final = 64 * 2**20


class Db3File:
    """A `.db3` file; before ROS 2 Iron it has no message definitions."""

    def __init__(self, path: Path) -> None:
        self.files: tuple[Path, ...] = (path,)
        self._damage = FileDamage(path.name)
        self._times: dict[int, NDArray[np.int64]] | None = None
        with ExitStack() as opened:
            file = FileBytes(path)
            opened.callback(file.close)
            head = file.read_bytes(0, HEADER_BYTES)
            if not head.startswith(MAGIC):
                why = describe_file_of_other_format(head, "it is not an SQLite database")
                raise LogError(f"{path}: not a rosbag2 .db3 file; {why}")
            if tear := describe_truncated_database(head, file.size):
                self._damage.add_damage_sentence(tear)
            journal = path.with_name(f"{path.name}-wal")
            unfinished = journal.exists() and journal.stat().st_size > 0
            if unfinished and (unclosed := count_uncommitted_bytes(journal)):
                self._damage.add_damage_sentence(
                    f"the recorder did not finish it: the last {unclosed:,} bytes of "
                    f"{journal.name} are messages that it never committed, and are not read"
                )
            self._size = file.size
            #: largest decrease of log times from the latest so far, in ns; None until known
            self._back_ns: int | None = None
            self._database = open_database_for_reading(path, is_unfinished=unfinished)
            opened.callback(self._database.close)
            try:
                self.connections: tuple[Connection, ...] = read_connections_of_database(
                    self._database, self._damage.add_damage_sentence
                )
                self._table = MessageTable(self._database, file, self._damage.add_damage_sentence)
            except BrokenBytesError as error:
                raise LogError(
                    f"{path}: not readable as a rosbag2 database ({error}); "
                    "it should have the tables 'topics' and 'messages'"
                ) from error
            self._opened = opened.pop_all()

    @property
    def losses(self) -> Sequence[Loss]:
        """Damage found so far."""
        return self._damage.list_losses({})

    def log_times(self, connection_id: int) -> NDArray[np.int64]:
        """Log times of a topic in ns, (n,); the first call reads the whole table."""
        if self._times is None:
            parts: dict[int, list[NDArray[np.int64]]] = {}
            for found in self._table.iter_rows_without_messages():
                for key, at in group_rows_by_connection(found.rows[KEY]):
                    parts.setdefault(key, []).append(found.rows[TIME, at])
            self._times = {
                key: self._drop_times_before_1970(key, np.concatenate(parts[key])) for key in parts
            }
            for key in self._times.keys() - {c.id for c in self.connections}:
                count = self._times[key].size
                self._damage.add_damage_sentence(
                    f"{count:,} messages of topic {key}, which has no definition: not read"
                )
        return self._times.get(connection_id, make_empty_log_times())

    def message_count(self, connection_id: int) -> int:
        """Number of messages of a topic; the first call reads the whole table."""
        return self.log_times(connection_id).size

    def _drop_times_before_1970(
        self, connection_id: int, times: NDArray[np.int64]
    ) -> NDArray[np.int64]:
        """Drop log times before 1970, and note them as damage."""
        early = int(np.count_nonzero(times < 0))
        if early:
            topic = next((c.topic for c in self.connections if c.id == connection_id), "")
            what = f"{early:,} messages have log times before the year 1970: not used"
            self._damage.add_damage_sentence(what, topic)
        return times[times >= 0]

    def iter_batch_groups(
        self, connection_ids: Collection[int], start_ns: int | None, end_ns: int | None
    ) -> Iterator[BatchGroup]:
        """Read messages in stored order; damaged pages are skipped."""
        first = 0 if start_ns is None else max(start_ns, 0)
        last = 2**63 - 1 if end_ns is None else end_ns
        latest = UNKNOWN_NS
        for found in self._table.iter_rows_of_topics(connection_ids, first, last):
            rows = found.rows
            batches = [
                RawBatch(key, found.data, rows[OFFSET, at], rows[LENGTH, at], rows[TIME, at])
                for key, at in group_rows_by_connection(rows[KEY])
            ]
            latest = max(latest, int(rows[TIME].max(initial=UNKNOWN_NS)))
            yield BatchGroup(batches, self._find_earliest_time_after_row_ns(latest))

    def _find_earliest_time_after_row_ns(self, row_time_ns: int) -> int:
        """Lower bound of the log times after a row of log time `row_time_ns`.

        Rows are in the order of recording, without an index by time. By how much times go back is
        known only after a pass over all rows, which is not worth its time for a small database.
        """
        if self._size < _LEAST_BYTES_TO_ORDER or row_time_ns == UNKNOWN_NS:
            return UNKNOWN_NS
        if self._back_ns is None:
            most, back = UNKNOWN_NS, 0
            for found in self._table.iter_rows_without_messages():
                times = found.rows[TIME]
                if times.size:
                    highest = np.maximum(np.maximum.accumulate(times), most)
                    back = max(back, int((highest - times).max()))
                    most = int(highest[-1])
            self._back_ns = back
        return max(row_time_ns - self._back_ns, UNKNOWN_NS)

    def log_time_lower_bound_ns(self) -> int:
        """Lower bound of all log times in ns: the earliest one, as SQLite finds it."""
        try:
            ((earliest,),) = fetch_all_rows(self._database, "SELECT min(timestamp) FROM messages")
        except BrokenBytesError:
            return UNKNOWN_NS
        if earliest is None:
            return END_NS
        return earliest if isinstance(earliest, int) else UNKNOWN_NS

    def check_whole_file_and_count_valid_crcs(self) -> int:
        """Let SQLite check its pages; return 0, since a database has no CRCs."""
        try:
            ((answer,),) = fetch_all_rows(self._database, "PRAGMA quick_check(1)")
        except BrokenBytesError as error:
            answer = str(error)
        if answer != "ok" and not self._damage:
            self._damage.add_damage_sentence(
                f"the database is damaged ({' '.join(answer.split())})"
            )
        return 0

    def close(self) -> None:
        """Release the file."""
        self._opened.close()


def read_connections_of_database(
    database: sqlite3.Connection, note_damage: Callable[[str], None]
) -> tuple[Connection, ...]:
    """Read the topics of a database; `note_damage` is called with a sentence for each fault.

    Raises:
        BrokenBytesError: the database is damaged, or not one of rosbag2.
    """
    found = fetch_all_rows(database, "SELECT name FROM sqlite_master WHERE type = 'table'")
    tables = {name for (name,) in found}
    if not tables >= {"topics", "messages"}:
        raise BrokenBytesError(
            f"its tables are {', '.join(sorted(tables))}" if tables else "it has no tables"
        )
    definitions: dict[str, tuple[str, str]] = {}
    if "message_definitions" in tables:
        definitions = {
            name: (text, encoding)
            for name, text, encoding in fetch_all_rows(
                database,
                "SELECT topic_type, encoded_message_definition, encoding"
                " FROM message_definitions WHERE typeof(encoded_message_definition) = 'text'"
                " AND typeof(encoding) = 'text'",
            )
        }
    topics = fetch_all_rows(
        database,
        "SELECT id, name, type, serialization_format,"
        " typeof(id) = 'integer' AND typeof(name) = 'text' AND typeof(type) = 'text'"
        " AND typeof(serialization_format) = 'text' FROM topics ORDER BY id",
    )
    whole = [row for *row, is_topic in topics if is_topic]
    if len(whole) < len(topics):
        note_damage(f"{len(topics) - len(whole):,} of its topics are damaged")
    if not whole and fetch_all_rows(database, "SELECT 1 FROM messages LIMIT 1"):
        note_damage("it holds messages without their topics")
    return tuple(
        Connection(key, str(topic), str(kind), str(encoding), *definitions.get(kind, ("", "")))
        for key, topic, kind, encoding in whole
    )


def read_metadata_texts(path: Path) -> list[str]:
    """Read the copies of metadata.yaml in a database, newest first; none before ROS 2 Iron."""
    try:
        database = open_database_for_reading(path, is_unfinished=False)
    except LogError:
        return []
    query = "SELECT metadata FROM metadata WHERE typeof(metadata) = 'text' ORDER BY id DESC"
    with closing(database):
        try:
            return [str(text) for (text,) in fetch_all_rows(database, f"{query} LIMIT 1")]
        except BrokenBytesError:
            return []


def open_database_for_reading(path: Path, *, is_unfinished: bool) -> sqlite3.Connection:
    """Open a database for reading; `is_unfinished` if a recorder may still write to it."""
    # immutable allows files on read-only media, but ignores messages still in a -wal file
    mode = "mode=ro" if is_unfinished else "mode=ro&immutable=1"
    try:
        database = sqlite3.connect(
            f"{path.absolute().as_uri()}?{mode}", uri=True, check_same_thread=False
        )
        # without this, SQLite refuses a truncated file; the mode prevents writing
        database.execute("PRAGMA writable_schema = ON")
    except sqlite3.Error as error:
        raise LogError(f"{path}: cannot be opened: {error}") from error
    database.text_factory = _decode_sqlite_text
    return database


def _decode_sqlite_text(text: bytes) -> str:
    return text.decode(errors="replace")


def count_uncommitted_bytes(path: Path) -> int:
    """Count the bytes of a `-wal` file in a transaction that was never committed.

    SQLite silently ignores them, although they may be messages of a crashed recorder. Frames with
    other salts are from before the last checkpoint, and do not count.

    Args:
        path: the `-wal` file.

    Returns:
        Bytes after the last commit, including an incomplete frame.
    """
    with path.open("rb") as file:
        head = file.read(_HEADER.size)
        if len(head) < _HEADER.size:
            return len(head)
        magic, _, page, _, *salts, _, _ = _HEADER.unpack(head)
        if magic not in _MAGICS:
            return 0
        size = file.seek(0, 2)
        at = closed = _HEADER.size
        while at < size:
            file.seek(at)
            frame = file.read(_FRAME.size)
            if len(frame) < _FRAME.size:
                return size - closed
            _, commit, *found, _, _ = _FRAME.unpack(frame)
            if found != salts:
                return at - closed
            at += _FRAME.size + page
            if commit and at <= size:
                closed = at
        return size - closed


def describe_truncated_database(first_page: bytes, file_bytes: int) -> str | None:
    """Say that a database is truncated, by the size in its first page; None if it is complete."""
    page = int.from_bytes(first_page[16:18], "big")
    page = 2**16 if page == 1 else page
    # the number of pages is valid only if the last writer also updated the version number
    pages = (
        int.from_bytes(first_page[28:32], "big") if first_page[24:28] == first_page[92:96] else 0
    )
    if not page or not (file_bytes % page or pages * page > file_bytes):
        return None
    if pages and file_bytes > pages * page:
        return f"has {file_bytes - pages * page:,} bytes after its last page, which were not read"
    unsure = (
        ", and its last page is incomplete: its content may be altered" if file_bytes % page else ""
    )
    return f"breaks off after byte {file_bytes:,} of {max(pages * page, file_bytes):,}{unsure}"
