"""Rows of a SQLite table in the order of their ids, over what is damaged."""

import sqlite3
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

LEAST_ID: Final = -(2**63)
MOST_ID: Final = 2**63 - 1
#: A batch ends with either.
_MOST_ROWS: Final = 8192
_MOST_BYTES: Final = 8 * 2**20
#: Rows fetched before their size is looked at.
_MOST_STEP: Final = 32

Row = tuple[Any, ...]


@dataclass(frozen=True, slots=True)
class TableRows:
    """Rows of messages, whose memory may be used again for those after the next."""

    #: holds the messages
    data: NDArray[np.uint8]
    #: (4 or more, n): what `records` gives rows of, and more
    rows: NDArray[np.int64]


#: What a damaged database raises: Python's module stumbles over messages that are no text.
FAULTS: Final = (sqlite3.Error, UnicodeDecodeError, MemoryError)


def read_rows(
    database: sqlite3.Connection,
    query: str,
    after: int,
    note: Callable[[str], None],
    *,
    has_blob: bool,
) -> Iterator[list[Row]]:
    """Rows of a table in batches.

    Args:
        database: opened.
        query: gives rows behind the rowid that is its parameter, ordered by rowid, which is the
            first column.
        after: the rowid behind which rows are read.
        note: told what was lost, a sentence a damaged place.
        has_blob: whether the last column is one, whose size then bounds the batches.
    """
    while True:
        rows: list[Row] = []
        fault: Exception | None = None
        size = 0
        try:
            cursor = database.execute(query, (after,))
            step = _MOST_STEP if has_blob else _MOST_ROWS
            while part := list(islice(cursor, step)):
                rows += part
                if has_blob:
                    fetched = sum([len(row[-1]) for row in part if row[-1].__class__ is bytes])
                    size += fetched
                    step = max(1, min(_MOST_STEP, _MOST_BYTES * len(part) // (fetched + 1)))
                if len(rows) >= _MOST_ROWS or size >= _MOST_BYTES:
                    if not _increases(after, rows):
                        break
                    yield rows
                    after, rows, size = rows[-1][0], [], 0
        except FAULTS as error:
            fault = error
        if rows and not _increases(after, rows):
            whole = list(_increasing(after, rows))
            if whole:
                yield whole
                after = whole[-1][0]
            note(f"the database is damaged behind row {after}: its rows go in circles")
            return
        if rows:
            yield rows
            after = rows[-1][0]
        if fault is None:
            return
        # the rows before the fault that were on their way are lost with it: take them singly
        rows = list(_singly(database, query, after))
        if rows:
            yield rows
            after = rows[-1][0]
        following = _behind_damage(database, query, after)
        until = "on" if following is None else f"to {following}"
        reason = " ".join(str(fault).split())
        note(f"the database is damaged ({reason}): rows from {after + 1} {until} are lost")
        if following is None:
            return
        after = following


def _singly(database: sqlite3.Connection, query: str, after: int) -> Iterator[Row]:
    """Rows up to a fault, at most a batch."""
    for _ in range(_MOST_ROWS):
        try:
            row = database.execute(f"{query} LIMIT 1", (after,)).fetchone()
        except FAULTS:
            return
        if row is None or row[0] <= after:  # a damaged tree may lead back
            return
        yield row
        after = row[0]


def _increases(after: int, rows: list[Row]) -> bool:
    """Whether ids can be as many different ones as there are rows.

    A damaged tree may lead to the same page again and again.
    """
    return rows[0][0] > after and rows[-1][0] - rows[0][0] >= len(rows) - 1


def _increasing(after: int, rows: list[Row]) -> Iterator[Row]:
    """Rows up to one whose id is not behind the one before."""
    for row in rows:
        if row[0] <= after:
            return
        after = row[0]
        yield row


def _behind_damage(database: sqlite3.Connection, query: str, after: int) -> int | None:
    """The id behind which a row can be read again, None where there is none."""

    def first(gap: int) -> int | None:
        beyond = min(after + gap, MOST_ID)
        row = database.execute(f"{query} LIMIT 1", (beyond,)).fetchone()
        if row is not None and row[0] <= beyond:
            raise sqlite3.DatabaseError("the tree leads back")
        return None if row is None else row[0]

    fails, works, found = 0, 0, None
    while not works and fails < 2**63:
        gap = max(1, 2 * fails)
        try:
            found, works = first(gap), gap
        except FAULTS:
            fails = gap
    while works - fails > 1:
        gap = (fails + works) // 2
        try:
            found, works = first(gap), gap
        except FAULTS:
            fails = gap
    return None if found is None else found - 1
