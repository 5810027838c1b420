"""Read rows of a SQLite table by SQLite itself, in the order of their ids, past damage."""

import sqlite3
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from replay.logs.messages.broken_bytes import BrokenBytesError

#: The smallest and the largest rowid of SQLite.
LEAST_ID: Final = -(2**63)
MOST_ID: Final = 2**63 - 1
#: Rows and bytes at which a batch ends, whichever is reached first.
_MOST_ROWS: Final = 8192
_MOST_BYTES: Final = 8 * 2**20
#: Rows with a blob that are fetched before their size is checked.
_MOST_STEP: Final = 32

Row = tuple[Any, ...]


@dataclass(frozen=True, slots=True)
class TableRows:
    """A batch of message rows; its arrays are valid until the next batch is read."""

    #: bytes that contain the messages
    data: NDArray[np.uint8]
    #: (4 or more, n): key, time, offset and length of each message, and values of the reader's own
    rows: NDArray[np.int64]


@contextmanager
def convert_sqlite_errors() -> Generator[None]:
    """Context that converts SQLite's errors on damaged data to `BrokenBytesError`.

    Raises:
        BrokenBytesError: the database is damaged, or has values of a wrong type. Errors of using
            the module wrongly are not converted.
    """
    try:
        yield
    except (sqlite3.ProgrammingError, sqlite3.InterfaceError):
        raise
    except (sqlite3.Error, UnicodeDecodeError, MemoryError) as error:
        raise BrokenBytesError(error) from error


def fetch_all_rows(database: sqlite3.Connection, query: str) -> list[Row]:
    """Fetch all rows of a query.

    Raises:
        BrokenBytesError: the database is damaged.
    """
    with convert_sqlite_errors():
        return database.execute(query).fetchall()


def iter_row_batches(
    database: sqlite3.Connection,
    query: str,
    after_row_id: int,
    note_damage: Callable[[str], None],
    *,
    has_blob: bool,
) -> Iterator[list[Row]]:
    """Yield the rows of a table in batches, past damage.

    Args:
        database: the opened database.
        query: query with a rowid as parameter, for the rows after it in order of rowid, which is
            its first column.
        after_row_id: rowid after which to read.
        note_damage: called with a sentence for each damaged place.
        has_blob: whether the last column is a blob, whose size bounds the batches.
    """
    while True:
        fault: BrokenBytesError | None = None
        try:
            for rows in _iter_row_batches_until_error(
                database, query, after_row_id, has_blob=has_blob
            ):
                whole = (
                    rows
                    if can_each_row_have_its_own_id(after_row_id, rows)
                    else list(_iter_rows_while_ids_increase(after_row_id, rows))
                )
                if whole:
                    yield whole
                    after_row_id = whole[-1][0]
                if len(whole) < len(rows):
                    note_damage(
                        f"the database is damaged after row {after_row_id}: its rows form a loop"
                    )
                    return
        except BrokenBytesError as error:
            fault = error
        if fault is None:
            return
        # the fault also lost the rows fetched with it: fetch them one by one
        rows = list(_read_batch_until_error(database, query, after_row_id))
        if rows:
            yield rows
            after_row_id = rows[-1][0]
        following = find_last_lost_row_id(database, query, after_row_id)
        until = "on" if following is None else f"to {following}"
        note_damage(
            f"the database is damaged ({fault}): rows from {after_row_id + 1} {until} are lost"
        )
        if following is None:
            return
        after_row_id = following


def _iter_row_batches_until_error(
    database: sqlite3.Connection, query: str, after_row_id: int, *, has_blob: bool
) -> Iterator[list[Row]]:
    """Yield rows in batches; an error is raised after the rows before it."""
    rows: list[Row] = []
    size = 0
    step = _MOST_STEP if has_blob else _MOST_ROWS
    with convert_sqlite_errors():
        cursor = database.execute(query, (after_row_id,))
    part: list[Row] | None = None
    while part is None or part:
        try:
            with convert_sqlite_errors():
                part = list(islice(cursor, step))
        except BrokenBytesError:
            if rows:
                yield rows
            raise
        rows += part
        if has_blob:
            fetched = sum([len(row[-1]) for row in part if row[-1].__class__ is bytes])
            size += fetched
            step = max(1, min(_MOST_STEP, _MOST_BYTES * len(part) // (fetched + 1)))
        if rows and (not part or len(rows) >= _MOST_ROWS or size >= _MOST_BYTES):
            yield rows
            rows, size = [], 0


def find_first_row_after(database: sqlite3.Connection, query: str, row_id: int) -> Row | None:
    """Fetch the first row after an id; None if there is none.

    Raises:
        BrokenBytesError: the database is damaged there.
    """
    with convert_sqlite_errors():
        row = database.execute(f"{query} LIMIT 1", (row_id,)).fetchone()
    if row is not None and row[0] <= row_id:
        raise BrokenBytesError("the pages of a table form a loop")
    return row


def _read_batch_until_error(
    database: sqlite3.Connection, query: str, after_row_id: int
) -> Iterator[Row]:
    """Yield rows one by one up to an error, at most one batch."""
    for _ in range(_MOST_ROWS):
        try:
            row = find_first_row_after(database, query, after_row_id)
        except BrokenBytesError:
            return
        if row is None:
            return
        yield row
        after_row_id = row[0]


def can_each_row_have_its_own_id(after_row_id: int, rows: list[Row]) -> bool:
    """Whether the range of ids is large enough for all rows to have different ones.

    A damaged tree may lead to the same page repeatedly.
    """
    return rows[0][0] > after_row_id and rows[-1][0] - rows[0][0] >= len(rows) - 1


def _iter_rows_while_ids_increase(after_row_id: int, rows: list[Row]) -> Iterator[Row]:
    """Yield rows up to the first whose id does not increase."""
    for row in rows:
        if row[0] <= after_row_id:
            return
        after_row_id = row[0]
        yield row


def find_last_lost_row_id(
    database: sqlite3.Connection, query: str, after_row_id: int
) -> int | None:
    """Find the id before the first readable row after damage; None if there is no such row."""

    def find_first_id_after_gap(gap: int) -> int | None:
        row = find_first_row_after(database, query, min(after_row_id + gap, MOST_ID))
        return None if row is None else row[0]

    fails, works, found = 0, 0, None
    while not works and fails < 2**63:
        gap = max(1, 2 * fails)
        try:
            found, works = find_first_id_after_gap(gap), gap
        except BrokenBytesError:
            fails = gap
    while works - fails > 1:
        gap = (fails + works) // 2
        try:
            found, works = find_first_id_after_gap(gap), gap
        except BrokenBytesError:
            fails = gap
    return None if found is None else found - 1
