"""Read table `messages` of a rosbag2 database, from its pages or else by SQLite."""

import sqlite3
from collections.abc import Callable, Collection, Generator, Iterator
from typing import Final

import numpy as np

from estimators.interpreted import is_numba_imported
from replay.logs.sqlite.database_pages import (
    PageLayout,
    RowFilter,
    read_page_layout_of_messages_table,
)
from replay.logs.sqlite.row_query import (
    LEAST_ID,
    Row,
    TableRows,
    convert_sqlite_errors,
    iter_row_batches,
)
from replay.logs.storage import KEY, LENGTH, OFFSET, TIME, FileBytes, prefetch_items_in_thread

_TIMES: Final = "SELECT rowid, topic_id, timestamp FROM messages WHERE rowid > ? ORDER BY rowid"
_MESSAGES: Final = _TIMES.replace("timestamp", "timestamp, data")
#: Bytes of a file below which SQLite reads all rows sooner than the compiled code is loaded.
_LEAST_BYTES: Final = 256 * 2**20
_LEAST_NS: Final = -(2**63)
_MOST_NS: Final = 2**63 - 1


class _NoMessageError(Exception):
    """Raised for a row with values of other types than a message."""


class MessageTable:
    """Rows of the table, in the order of their ids.

    Raises:
        BrokenBytesError: a column of rosbag2 is missing, or SQLite cannot read its own tables.
    """

    def __init__(
        self, database: sqlite3.Connection, file: FileBytes, note: Callable[[str], None]
    ) -> None:
        """Examine how the table is stored.

        Args:
            database: the opened database.
            file: file of the database.
            note: called with a sentence for each damaged place.
        """
        with convert_sqlite_errors():
            database.execute(f"{_MESSAGES} LIMIT 0", (0,)).close()
        self._database = database
        self._file = file
        self._note = note
        self._layout = read_page_layout_of_messages_table(file, database)

    def iter_rows_without_messages(self) -> Iterator[TableRows]:
        """Yield all rows without the bytes of their messages."""
        everything = RowFilter(np.empty(0, np.int64), True, _LEAST_NS, _MOST_NS, False)
        by_sqlite = self._file.size < _LEAST_BYTES and not is_numba_imported()
        if self._layout is not None and by_sqlite:
            faults: list[str] = []
            found = list(self._iter_rows_from_sqlite(LEAST_ID, everything, faults.append))
            # damage is noted once, in the words of the page walk
            return iter(found) if not faults else self._iter_rows(everything)
        return self._iter_rows(everything)

    def iter_rows_of_topics(
        self, topic_ids: Collection[int], first_ns: int, last_ns: int
    ) -> Iterator[TableRows]:
        """Yield rows of some topics in a range of log times in ns, both ends inclusive."""
        keys = np.array(sorted(topic_ids), np.int64)
        first, last = (max(_LEAST_NS, min(each, _MOST_NS)) for each in (first_ns, last_ns))
        return self._iter_rows(RowFilter(keys, False, first, last, True))

    def _iter_rows(self, row_filter: RowFilter) -> Iterator[TableRows]:
        after: int | None = LEAST_ID
        if self._layout is not None:
            after = yield from self._iter_rows_from_pages(self._layout, row_filter)
        if after is not None:
            yield from self._iter_rows_from_sqlite(after, row_filter, self._note)

    def _iter_rows_from_pages(
        self, layout: PageLayout, row_filter: RowFilter
    ) -> Generator[TableRows, None, int | None]:
        from replay.logs.sqlite.page_walk import PageWalk  # compiled code

        walk = PageWalk(self._file, layout, row_filter, self._note)
        yield from prefetch_items_in_thread(iter(walk))
        return walk.left_after

    def _iter_rows_from_sqlite(
        self, after_row_id: int, row_filter: RowFilter, note_damage: Callable[[str], None]
    ) -> Iterator[TableRows]:
        query = _MESSAGES if row_filter.are_messages_read else _TIMES
        has_blob = row_filter.are_messages_read
        for rows in iter_row_batches(
            self._database, query, after_row_id, note_damage, has_blob=has_blob
        ):
            try:
                found = _make_row_columns(rows, has_blob=has_blob)
            except _NoMessageError:  # SQLite permits values of any type
                whole = [row for row in rows if _is_row_a_message(row)]
                lost = len(rows) - len(whole)
                note_damage(f"{lost:,} rows from row {rows[0][0]} on hold no message")
                found = _make_row_columns(whole, has_blob=has_blob)
            time = found.rows[TIME]
            use = (time >= row_filter.first_ns) & (time <= row_filter.last_ns)
            if not row_filter.is_every_topic_requested:
                use &= np.isin(found.rows[KEY], row_filter.topic_ids)
            yield found if use.all() else TableRows(found.data, found.rows[:, use])


def _make_row_columns(rows: list[Row], *, has_blob: bool) -> TableRows:
    messages = [row[3] for row in rows] if has_blob else []
    if {*map(type, messages)} - {bytes}:
        raise _NoMessageError("a message is not a blob")
    columns = np.zeros((4, len(rows)), np.int64)
    for column, place in ((KEY, 1), (TIME, 2)):
        numbers = np.array([row[place] for row in rows])
        if rows and numbers.dtype != np.int64:
            raise _NoMessageError("the topic id or time of a message is not an integer")
        columns[column] = numbers
    if has_blob:
        columns[LENGTH] = [len(message) for message in messages]
        columns[OFFSET] = np.cumsum(columns[LENGTH]) - columns[LENGTH]
    return TableRows(np.frombuffer(b"".join(messages), np.uint8), columns)


def _is_row_a_message(row: Row) -> bool:
    types = tuple(map(type, row))
    return types in ((int, int, int), (int, int, int, bytes))
