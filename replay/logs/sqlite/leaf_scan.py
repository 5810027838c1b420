"""Find the messages in leaf pages of a SQLite table, compiled: some tens of nanoseconds each."""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.compiled import uncounted
from replay.logs.sqlite.database_pages import LEAF, PageLayout, RowFilter
from replay.logs.sqlite.leaf_cells import (
    DAMAGED,
    MESSAGE,
    NO_MESSAGE,
    UNUSUAL,
    big_endian,
    parse_cell,
)
from replay.logs.sqlite.row_query import MOST_ID
from replay.logs.storage import KEY, LENGTH, OFFSET, TIME

#: Bytes of a leaf page's head (SQLite file format, 1.6).
_PAGE_HEAD: Final = 8
#: The row of ids in what `records` gives rows of.
ID: Final = 4
#: Of a spilled row: which it is, where in the leaf its message begins, and how many bytes of it are
#: there; the first overflow page, and how many bytes are on that and those behind it.
ROW, BEGIN, LOCAL, PAGE, REST = range(5)
#: Where a scan is: the leaf, the cell in it, and the id of the row before; what it met: damaged
#: places, whether the last goes on, rows that hold no message, and the id of the first of them.
AT_LEAF, AT_CELL, LAST_ID, GAPS, IN_GAP, ODD, FIRST_ODD = range(7)


class Tables(NamedTuple):
    """What a scan finds."""

    #: (5, n) rows of messages as in `storage.rows`, and their ids
    rows: NDArray[np.int64]
    #: (5, m) rows whose message is not whole in its leaf
    spills: NDArray[np.int64]
    #: (2, g) ids of the rows before and behind damaged places
    gaps: NDArray[np.int64]


@uncounted
def scan_leaves(
    data: NDArray[np.uint8],
    leaves: NDArray[np.int64],
    layout: PageLayout,
    wanted: RowFilter,
    tail: int,
    room: int,
    state: NDArray[np.int64],
    tables: Tables,
) -> tuple[int, int, int, bool]:
    """Wanted rows in leaf pages, until there is no more room or a row is unusual.

    Args:
        data: holds the pages.
        leaves: (pages,) where in `data` each begins.
        layout: of the pages.
        wanted: which rows.
        tail: where in `data` messages from overflow pages will stand.
        room: bytes that these may take, unless it is a single one.
        state: (7,) where to begin, and becomes where it stopped.
        tables: are filled.

    Returns:
        Rows and spilled rows found, bytes behind `tail` that these need, and False if it stopped
        at what is unusual.
    """
    rows, spills, gaps = tables
    keys = wanted.keys
    found = spilled = used = 0
    while state[AT_LEAF] < leaves.size:
        base = int(leaves[state[AT_LEAF]])
        end = base + layout.usable_bytes
        cells = big_endian(data, base + 3, 2)
        contents = base + _PAGE_HEAD + 2 * cells
        if data[base] != LEAF or cells == 0 or contents > end:
            cells = 0
            _open_gap(gaps, state)
        while state[AT_CELL] < cells:
            at = base + big_endian(data, base + _PAGE_HEAD + 2 * int(state[AT_CELL]), 2)
            what, row_id, topic, time, begin, length, local, stop = parse_cell(
                data, at, contents, end, layout, wanted.with_data
            )
            if what == UNUSUAL:
                _close_gap(gaps, state, row_id)
                return found, spilled, used, False
            in_time = wanted.first_ns <= time <= wanted.last_ns
            if what == MESSAGE and in_time and (wanted.every_topic or _holds(keys, topic)):
                if found == rows.shape[1]:
                    return found, spilled, used, True
                offset = begin
                if local < length and wanted.with_data:
                    if spilled == spills.shape[1] or (used and used + length > room):
                        return found, spilled, used, True
                    offset = tail + used
                    used += length
                    spills[ROW, spilled] = found
                    spills[BEGIN, spilled] = begin
                    spills[LOCAL, spilled] = local
                    spills[PAGE, spilled] = big_endian(data, stop, 4)
                    spills[REST, spilled] = length - local
                    spilled += 1
                rows[KEY, found] = topic
                rows[TIME, found] = time
                rows[OFFSET, found] = offset
                rows[LENGTH, found] = length
                rows[ID, found] = row_id
                found += 1
            elif what == NO_MESSAGE:
                _count_odd(state, row_id)
            if what == DAMAGED:
                _open_gap(gaps, state)
            else:
                state[LAST_ID] = row_id
                if state[IN_GAP]:
                    _close_gap(gaps, state, row_id)
            state[AT_CELL] += 1
        state[AT_LEAF] += 1
        state[AT_CELL] = 0
    return found, spilled, used, True


@uncounted
def _holds(keys: NDArray[np.int64], key: int) -> bool:
    """Whether a key is among some that ascend."""
    first, last = 0, keys.size
    while first < last:
        middle = (first + last) // 2
        if keys[middle] < key:
            first = middle + 1
        else:
            last = middle
    return bool(first < keys.size and keys[first] == key)


@uncounted
def _count_odd(state: NDArray[np.int64], row_id: int) -> None:
    """Count a row that holds no message."""
    if state[ODD] == 0:
        state[FIRST_ODD] = row_id
    state[ODD] += 1


@uncounted
def _open_gap(gaps: NDArray[np.int64], state: NDArray[np.int64]) -> None:
    """Nothing can be read here."""
    if state[IN_GAP] == 0:
        if state[GAPS] < gaps.shape[1]:
            gaps[0, state[GAPS]] = state[LAST_ID]
            gaps[1, state[GAPS]] = MOST_ID
        state[GAPS] += 1
        state[IN_GAP] = 1


@uncounted
def _close_gap(gaps: NDArray[np.int64], state: NDArray[np.int64], row_id: int) -> None:
    """Here is a row again."""
    if state[IN_GAP] == 1 and state[GAPS] <= gaps.shape[1]:
        gaps[1, state[GAPS] - 1] = row_id
    state[IN_GAP] = 0
