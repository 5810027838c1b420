"""Find the leaf pages of a SQLite table in row order, and scan them for messages.

Interior pages list the leaves. The compiled scan takes some tens of nanoseconds per message.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.compiled import compiled, compiled_without_refcounts
from replay.logs.sqlite.database_pages import LEAF, PageLayout, RowFilter
from replay.logs.sqlite.leaf_cells import (
    DAMAGED,
    MESSAGE,
    NO_MESSAGE,
    UNUSUAL,
    parse_row_cell,
    read_big_endian,
)
from replay.logs.sqlite.row_query import MOST_ID
from replay.logs.storage import KEY, LENGTH, OFFSET, TIME, FileBytes

#: Kind of an interior page of a table, and bytes of its head (SQLite file format, 1.6).
_INTERIOR: Final = 5
_PAGE_HEAD: Final = 12
#: Bytes of interior pages that are read at once.
_STEP_BYTES: Final = 2**20
#: Bytes of a leaf page's head (SQLite file format, 1.6).
_LEAF_HEAD: Final = 8
#: Index of the row ids in `ScannedRows.rows`.
ID: Final = 4
#: Columns of a spilled row: its index, start of its message in the leaf, bytes of it in the leaf,
#: first overflow page, and bytes on overflow pages.
ROW, BEGIN, LOCAL, PAGE, REST = range(5)
#: State of a scan: leaf, cell in it, and id of the previous row; number of gaps by damage, whether
#: the last gap is open, number of rows without a message, and id of the first such row.
AT_LEAF, AT_CELL, LAST_ID, GAPS, IN_GAP, ODD, FIRST_ODD = range(7)


class ScannedRows(NamedTuple):
    """Result of a scan."""

    #: (5, n) rows of messages as in `storage.message_rows`, and their ids
    rows: NDArray[np.int64]
    #: (5, m) rows whose message continues on overflow pages
    spills: NDArray[np.int64]
    #: (2, g) ids of the rows before and after each damaged place
    gaps: NDArray[np.int64]


def find_leaf_pages(file: FileBytes, layout: PageLayout) -> NDArray[np.uint32] | None:
    """Find the numbers of the leaf pages, in row order; None if the tree is damaged.

    No page is visited twice, so a cyclic tree ends here.
    """
    seen = np.zeros(layout.pages + 1, np.bool_)
    # the first page has the list of tables
    seen[[0, 1, layout.root]] = True
    if layout.locked_page <= layout.pages:
        seen[layout.locked_page] = True
    level = np.array([layout.root], np.uint32)
    while True:
        # all leaves are at the same depth: if three pages of a level differ in kind, it is damaged
        some = level[[0, level.size // 2, -1]].tolist()
        heads = [file.read_bytes((page - 1) * layout.page_bytes, _PAGE_HEAD) for page in some]
        kinds = {head[:1] for head in heads}
        if kinds == {bytes([LEAF])}:
            is_empty = level.size == 1 and heads[0][3:5] == bytes(2)
            return level[:0] if is_empty else level
        if len(kinds) > 1:
            return None
        below = list_child_pages(file, layout, level)
        if below is None or below.max() > layout.pages or seen[below].any():
            return None
        met = int(np.count_nonzero(seen))
        seen[below] = True
        if int(np.count_nonzero(seen)) - met != below.size:
            return None
        level = below


def list_child_pages(
    file: FileBytes, layout: PageLayout, level: NDArray[np.uint32]
) -> NDArray[np.uint32] | None:
    """List the child pages of a level of the tree; None if a page of it is damaged."""
    found: list[NDArray[np.uint32]] = []
    data = np.empty(max(_STEP_BYTES, layout.page_bytes), np.uint8)
    done = 0
    while done < level.size:
        ranges, slots = select_page_ranges_within_size(level[done:], layout.page_bytes, data.size)
        if not read_page_ranges_into(file, ranges, layout.page_bytes, data):
            return None
        # upper bound of the children of a page by its size
        children = np.empty(slots.size * (layout.page_bytes // 6 + 1), np.uint32)
        count = read_child_pages_into(data, slots, layout.usable_bytes, children)
        if count < 0:
            return None
        found.append(children[:count].copy())
        done += slots.size
    return np.concatenate(found)


@compiled
def read_child_pages_into(
    data: NDArray[np.uint8],
    pointer_offsets: NDArray[np.int64],
    usable_page_bytes: int,
    out_pages: NDArray[np.uint32],
) -> int:
    """Read the children of the pages at `pointer_offsets`; return their number, -1 if damaged."""
    count = 0
    for base in pointer_offsets:
        cells = read_big_endian(data, base + 3, 2)
        contents = base + _PAGE_HEAD + 2 * cells
        if data[base] != _INTERIOR or cells == 0 or contents > base + usable_page_bytes:
            return -1
        for cell in range(cells):
            at = base + read_big_endian(data, base + _PAGE_HEAD + 2 * cell, 2)
            # child page and, in at least a byte, the largest id below it
            if at < contents or at + 5 > base + usable_page_bytes:
                return -1
            if count == out_pages.size:
                return -1
            out_pages[count] = read_big_endian(data, at, 4)
            count += 1
        if count == out_pages.size:
            return -1
        out_pages[count] = read_big_endian(data, base + 8, 4)
        count += 1
    return count


#: Most bytes between requested pages that are read with them, which costs less than another read.
_MOST_BETWEEN: Final = 65_536


class PageRanges(NamedTuple):
    """Ranges of pages, (ranges,) each: first page, number of pages, and target offset in bytes."""

    first: NDArray[np.int64]
    pages: NDArray[np.int64]
    begin: NDArray[np.int64]


def select_page_ranges_within_size(
    pages: NDArray[np.uint32], page_bytes: int, max_total_bytes: int
) -> tuple[PageRanges, NDArray[np.int64]]:
    """Select ranges that contain as many of the first `pages` as fit into `max_total_bytes`.

    Args:
        pages: (pages,) requested pages.
        page_bytes: size of a page.
        max_total_bytes: room for all ranges, at least one page.

    Returns:
        The ranges, and (n,) the target offset of each of the first n pages.
    """
    numbers = pages[: max_total_bytes // page_bytes].astype(np.int64)
    step = np.diff(numbers)
    apart = (step < 1) | ((step - 1) * page_bytes > _MOST_BETWEEN)
    slot = np.concatenate([[0], np.cumsum(np.where(apart, 1, step))])
    count = int(np.searchsorted(slot, max_total_bytes // page_bytes))
    numbers, slot = numbers[:count], slot[:count]
    starts = np.concatenate([[0], np.flatnonzero(apart[: count - 1]) + 1])
    ends = np.concatenate([starts[1:], [count]]) - 1
    ranges = PageRanges(
        numbers[starts], numbers[ends] - numbers[starts] + 1, slot[starts] * page_bytes
    )
    return ranges, slot * page_bytes


def read_page_ranges_into(
    file: FileBytes, ranges: PageRanges, page_bytes: int, out_bytes: NDArray[np.uint8]
) -> bool:
    """Read ranges of pages into `out_bytes`; return whether the file has all of them."""
    for first, pages, start in zip(*(each.tolist() for each in ranges), strict=True):
        part = out_bytes[start : start + pages * page_bytes]
        if file.read_into((first - 1) * page_bytes, part) < part.size:
            return False
    return True


@compiled_without_refcounts
def scan_requested_rows_of_leaf_pages(
    data: NDArray[np.uint8],
    leaves: NDArray[np.int64],
    layout: PageLayout,
    row_filter: RowFilter,
    overflow_begin: int,
    max_overflow_bytes: int,
    scan_position: NDArray[np.int64],
    out_rows: ScannedRows,
) -> tuple[int, int, int, bool]:
    """Find requested rows in leaf pages, until the output is full or a row is unusual.

    Args:
        data: bytes of the pages.
        leaves: (pages,) offset of each page in `data`.
        layout: layout of the pages.
        row_filter: requested rows.
        overflow_begin: offset in `data` of messages joined from overflow pages.
        max_overflow_bytes: maximum bytes of these messages, unless it is a single one.
        scan_position: (7,) in: where to begin; out: where the scan stopped.
        out_rows: receives the rows.

    Returns:
        Number of rows, number of spilled rows, bytes needed from `overflow_begin` on, and whether
        the scan met no unusual row.
    """
    rows, spills, gaps = out_rows
    keys = row_filter.topic_ids
    found = spilled = used = 0
    while scan_position[AT_LEAF] < leaves.size:
        base = int(leaves[scan_position[AT_LEAF]])
        end = base + layout.usable_bytes
        cells = read_big_endian(data, base + 3, 2)
        contents = base + _LEAF_HEAD + 2 * cells
        if data[base] != LEAF or cells == 0 or contents > end:
            cells = 0
            _begin_row_id_gap(gaps, scan_position)
        while scan_position[AT_CELL] < cells:
            at = base + read_big_endian(
                data, base + _LEAF_HEAD + 2 * int(scan_position[AT_CELL]), 2
            )
            what, row_id, topic, time, start, length, local, stop = parse_row_cell(
                data, at, contents, end, layout, row_filter.are_messages_read
            )
            if what == UNUSUAL:
                _end_row_id_gap(gaps, scan_position, row_id)
                return found, spilled, used, False
            in_time = row_filter.first_ns <= time <= row_filter.last_ns
            if (
                what == MESSAGE
                and in_time
                and (row_filter.is_every_topic_requested or is_key_in_sorted_array(keys, topic))
            ):
                if found == rows.shape[1]:
                    return found, spilled, used, True
                offset = start
                if local < length and row_filter.are_messages_read:
                    if spilled == spills.shape[1] or (used and used + length > max_overflow_bytes):
                        return found, spilled, used, True
                    offset = overflow_begin + used
                    used += length
                    spills[ROW, spilled] = found
                    spills[BEGIN, spilled] = start
                    spills[LOCAL, spilled] = local
                    spills[PAGE, spilled] = read_big_endian(data, stop, 4)
                    spills[REST, spilled] = length - local
                    spilled += 1
                rows[KEY, found] = topic
                rows[TIME, found] = time
                rows[OFFSET, found] = offset
                rows[LENGTH, found] = length
                rows[ID, found] = row_id
                found += 1
            elif what == NO_MESSAGE:
                _count_row_without_message(scan_position, row_id)
            if what == DAMAGED:
                _begin_row_id_gap(gaps, scan_position)
            else:
                scan_position[LAST_ID] = row_id
                if scan_position[IN_GAP]:
                    _end_row_id_gap(gaps, scan_position, row_id)
            scan_position[AT_CELL] += 1
        scan_position[AT_LEAF] += 1
        scan_position[AT_CELL] = 0
    return found, spilled, used, True


@compiled_without_refcounts
def is_key_in_sorted_array(sorted_ids: NDArray[np.int64], wanted_id: int) -> bool:
    """Whether an id is in a sorted array."""
    first, last = 0, sorted_ids.size
    while first < last:
        middle = (first + last) // 2
        if sorted_ids[middle] < wanted_id:
            first = middle + 1
        else:
            last = middle
    return bool(first < sorted_ids.size and sorted_ids[first] == wanted_id)


@compiled_without_refcounts
def _count_row_without_message(state: NDArray[np.int64], row_id: int) -> None:
    """Count a row without a message in the state of the scan, and keep the id of the first."""
    if state[ODD] == 0:
        state[FIRST_ODD] = row_id
    state[ODD] += 1


@compiled_without_refcounts
def _begin_row_id_gap(gaps: NDArray[np.int64], state: NDArray[np.int64]) -> None:
    """Begin a gap of damaged rows after the last row read, unless one is open."""
    if state[IN_GAP] == 0:
        if state[GAPS] < gaps.shape[1]:
            gaps[0, state[GAPS]] = state[LAST_ID]
            gaps[1, state[GAPS]] = MOST_ID
        state[GAPS] += 1
        state[IN_GAP] = 1


@compiled_without_refcounts
def _end_row_id_gap(gaps: NDArray[np.int64], state: NDArray[np.int64], row_id: int) -> None:
    """End the open gap, if any, at a readable row."""
    if state[IN_GAP] == 1 and state[GAPS] <= gaps.shape[1]:
        gaps[1, state[GAPS] - 1] = row_id
    state[IN_GAP] = 0
