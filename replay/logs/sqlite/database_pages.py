"""Determine the layout of a SQLite file's pages (sqlite.org/fileformat2.html).

Files with an unusual layout are not read directly but by SQLite itself.
"""

import sqlite3
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from replay.logs.sqlite.row_query import fetch_all_rows
from replay.logs.storage import FileBytes

MAGIC: Final = b"SQLite format 3\x00"
#: First byte of a page that contains rows.
LEAF: Final = 13
HEADER_BYTES: Final = 100
#: Fractions of a page, in 255ths, that a cell may take, as fixed by the format.
_FRACTIONS: Final = bytes([64, 32, 32])
#: 1 with a rollback journal, 2 with a write-ahead log
_VERSIONS: Final = (1, 2)
_LEAST_USABLE: Final = 480
#: First of the bytes that SQLite locks; their page contains no data.
_LOCKED_BYTE: Final = 2**30
_TOPIC, _TIME, _DATA = "topic_id", "timestamp", "data"


class PageLayout(NamedTuple):
    """Layout of pages, and of one table's records in them."""

    page_bytes: int
    #: bytes used of each page, from its start; the rest is reserved for extensions
    usable_bytes: int
    #: number of pages, which are numbered from 1
    pages: int
    #: number of the page that never contains data
    locked_page: int
    #: number of the root page of the table
    root: int
    #: number of columns of a record, and indices of topic, time and message
    columns: int
    topic: int
    time: int
    data: int


class RowFilter(NamedTuple):
    """Requested rows, and whether to read their messages."""

    #: topic ids, ascending, unless all are requested
    topic_ids: NDArray[np.int64]
    is_every_topic_requested: bool
    #: first and last log time in ns
    first_ns: int
    last_ns: int
    are_messages_read: bool


def read_page_layout_of_messages_table(
    file: FileBytes, database: sqlite3.Connection
) -> PageLayout | None:
    """Determine the page layout of table `messages`; None if SQLite must read it.

    Raises:
        BrokenBytesError: SQLite cannot read its own tables.
    """
    head = file.read_bytes(0, HEADER_BYTES)
    if len(head) < HEADER_BYTES or _has_uncommitted_writes(file.path):
        return None
    stored = int.from_bytes(head[16:18], "big")
    page_bytes = 65_536 if stored == 1 else stored
    usable = page_bytes - head[20]
    pages = int.from_bytes(head[28:32], "big")
    whole = (
        head.startswith(MAGIC)
        and page_bytes >= 512
        and page_bytes & (page_bytes - 1) == 0
        and head[18] in _VERSIONS
        and head[19] in _VERSIONS
        and usable >= _LEAST_USABLE
        and head[21:24] == _FRACTIONS
        # otherwise the last writer was an old version, which did not update the number of pages
        and head[24:28] == head[92:96]
        and pages * page_bytes == file.size
    )
    record = find_messages_table(database)
    if not whole or record is None or not 1 < record[0] <= pages:
        return None
    return PageLayout(page_bytes, usable, pages, _LOCKED_BYTE // page_bytes + 1, *record)


def _has_uncommitted_writes(path: Path) -> bool:
    """Whether a journal or write-ahead log with content is beside the file."""
    beside = (path.with_name(path.name + suffix) for suffix in ("-wal", "-journal"))
    return any(each.exists() and each.stat().st_size > 0 for each in beside)


class _TableLayout(NamedTuple):
    """Root page of table `messages`, its number of columns, and indices of three of them."""

    root_page: int
    columns: int
    topic_index: int
    time_index: int
    message_index: int


def find_messages_table(database: sqlite3.Connection) -> _TableLayout | None:
    """Find the root page and columns of table `messages`; None if it is defined unusually."""
    found = fetch_all_rows(
        database, "SELECT rootpage FROM sqlite_master WHERE type = 'table' AND name = 'messages'"
    )
    columns = fetch_all_rows(database, "PRAGMA table_xinfo(messages)")
    if not found or type(found[0][0]) is not int:
        return None
    names = [str(name).lower() for _, name, *_ in columns]
    # a column that is the primary key is the row id, and not in the record
    kinds = {str(name).lower(): str(kind) for _, name, kind, _, _, key, _ in columns if not key}
    # in columns that are declared otherwise, SQLite may store integers as floats
    are_integers = all("INT" in kinds.get(name, "").upper() for name in (_TOPIC, _TIME))
    is_computed = any(is_hidden for *_, is_hidden in columns)
    if not are_integers or _DATA not in kinds or is_computed or "rowid" in names:
        return None
    return _TableLayout(
        found[0][0], len(names), names.index(_TOPIC), names.index(_TIME), names.index(_DATA)
    )
