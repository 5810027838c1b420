"""Read a SQLite table page by page."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.compiled import compiled
from replay.logs.sqlite.database_pages import PageLayout, RowFilter
from replay.logs.sqlite.leaf_cells import read_big_endian
from replay.logs.sqlite.leaf_pages import (
    AT_LEAF,
    BEGIN,
    FIRST_ODD,
    GAPS,
    ID,
    LAST_ID,
    LOCAL,
    ODD,
    PAGE,
    REST,
    ROW,
    PageRanges,
    ScannedRows,
    find_leaf_pages,
    read_page_ranges_into,
    scan_requested_rows_of_leaf_pages,
    select_page_ranges_within_size,
)
from replay.logs.sqlite.row_query import LEAST_ID, MOST_ID, TableRows
from replay.logs.storage import OFFSET, FileBytes

#: Most bytes of a message's overflow pages that are read at once.
_MOST_BYTES: Final = 2**20
_FEWEST_PAGES: Final = 4
#: Bound of page visits over the number of pages: in a damaged file, several messages may share one.
_MOST_VISITS: Final = 16
#: State of joining: spilled row, next page, target of its bytes, bytes left of the message, and
#: number of pages used.
_SPILL, _NEXT, _TO, _LEFT, _USED = range(5)
#: Bytes of leaves that are read at once, so that they are decoded from the processor's cache; twice
#: or half of it takes a tenth longer.
_LEAF_BYTES: Final = 2 * 2**20
#: Most bytes of messages joined from overflow pages at once, unless a single one is larger.
_JOINED_BYTES: Final = 4 * 2**20
_MOST_ROWS: Final = 65_536
_MOST_SPILLED: Final = 8192
_MOST_GAPS: Final = 1024
_FIRST_LEAVES: Final = 64


@dataclass(slots=True)
class _PageBuffers:
    data: NDArray[np.uint8] = field(
        default_factory=lambda: np.empty(_LEAF_BYTES + _JOINED_BYTES, np.uint8)
    )
    rows: NDArray[np.int64] = field(default_factory=lambda: np.empty((5, _MOST_ROWS), np.int64))


class _LeafRows(NamedTuple):
    """Rows of leaf pages, and whether no row of unusual layout was met."""

    rows: TableRows
    is_usual_after: bool


class PageWalk:
    """Reader of a table's rows in the order of their ids, past damage, up to an unusual row."""

    def __init__(
        self,
        file: FileBytes,
        layout: PageLayout,
        row_filter: RowFilter,
        note: Callable[[str], None],
    ) -> None:
        """Start at the first row.

        Args:
            file: the database.
            layout: layout of its pages.
            row_filter: requested rows.
            note: called with a sentence for each damaged place.
        """
        self._file = file
        self._layout = layout
        self._wanted = row_filter
        self._note = note
        self._chains = OverflowPageReader(file, layout)
        self._spills = np.empty((5, _MOST_SPILLED), np.int64)
        self._gaps = np.empty((2, _MOST_GAPS), np.int64)
        self._state = np.zeros(7, np.int64)
        self._state[LAST_ID] = LEAST_ID
        self._torn = self._first_torn = 0
        #: after the walk: id after which rows are left to SQLite; None if all were read
        self.left_after: int | None = LEAST_ID

    def __iter__(self) -> Iterator[TableRows]:
        try:
            leaves = find_leaf_pages(self._file, self._layout)
            if leaves is not None:
                yield from self._iter_rows_by_leaf(leaves)
        except (OSError, MemoryError):
            pass  # SQLite reports the damage, or can read the rows otherwise
        self._note_lost_rows()

    def _iter_rows_by_leaf(self, leaves: NDArray[np.uint32]) -> Iterator[TableRows]:
        """Yield rows in steps of several leaves, whose number doubles from step to step."""
        memories = (_PageBuffers(), _PageBuffers())
        at, step, reach = 0, 0, _FIRST_LEAVES
        is_usual = True
        while is_usual and at < leaves.size:
            rows, is_usual = self._read_rows_of_leaves(leaves[at : at + reach], memories[step % 2])
            self.left_after = int(self._state[LAST_ID])
            yield rows
            # large messages fill a step from few leaves, and reading more of them is wasted
            done = int(self._state[AT_LEAF])
            reach = 2 * (done + 1)
            at += done
            step += 1
        if is_usual:
            self.left_after = None

    def _read_rows_of_leaves(
        self, leaves: NDArray[np.uint32], page_memory: _PageBuffers
    ) -> _LeafRows:
        """Read the rows of the first of the leaves, as many as fit into the memory."""
        size = self._layout.page_bytes
        ranges, slots = select_page_ranges_within_size(leaves, size, _LEAF_BYTES)
        if not read_page_ranges_into(self._file, ranges, size, page_memory.data):
            raise OSError("the file was truncated while it was read; read it again")
        tail = int(ranges.begin[-1] + ranges.pages[-1] * size)
        self._state[AT_LEAF] = 0
        found, spilled, joined_bytes, is_usual = scan_requested_rows_of_leaf_pages(
            page_memory.data,
            slots,
            self._layout,
            self._wanted,
            tail,
            _JOINED_BYTES,
            self._state,
            ScannedRows(page_memory.rows, self._spills, self._gaps),
        )
        data, rows = page_memory.data, page_memory.rows[:, :found]
        if spilled:
            if tail + joined_bytes > data.size:
                data = np.empty(tail + joined_bytes, np.uint8)
                data[:tail] = page_memory.data[:tail]
            self._chains.join_spilled_messages(
                data, ranges, page_memory.rows, self._spills, spilled
            )
            rows = self._drop_rows_with_damaged_pages(rows, self._spills[:, :spilled])
        return _LeafRows(TableRows(data, rows), is_usual)

    def _drop_rows_with_damaged_pages(
        self, rows: NDArray[np.int64], spills: NDArray[np.int64]
    ) -> NDArray[np.int64]:
        """Drop rows whose overflow pages are damaged, and count them."""
        torn = spills[ROW, spills[PAGE] == 0]
        if not torn.size:
            return rows
        if not self._torn:
            self._first_torn = int(rows[ID, torn[0]])
        self._torn += torn.size
        return np.delete(rows, torn, axis=1)

    def _note_lost_rows(self) -> None:
        found, odd, first_odd = self._state[[GAPS, ODD, FIRST_ODD]].tolist()
        for before, until in self._gaps[:, :found].T.tolist():
            self._note(f"the database is damaged: {_describe_lost_rows(before, until)} lost")
        if found > _MOST_GAPS:
            self._note(f"{found - _MOST_GAPS:,} more places of the database are damaged")
        if self._torn:
            what = f"the database is damaged: {self._torn:,} messages are torn and lost"
            self._note(f"{what}, the first is of row {self._first_torn}")
        if odd:
            self._note(f"{odd:,} rows from row {first_odd} on hold no message")


def _describe_lost_rows(last_id_before: int, next_id: int) -> str:
    """Clause that names the rows lost between two ids, as far as the ids show it."""
    if next_id == MOST_ID:
        return (
            "all rows are"
            if last_id_before == LEAST_ID
            else f"rows from {last_id_before + 1} on are"
        )
    if last_id_before == LEAST_ID:
        return f"rows before {next_id} are"
    if next_id == last_id_before + 2:
        return f"row {last_id_before + 1} is"
    # ids that are out of order are themselves damaged
    in_order = next_id > last_id_before + 1
    return (
        f"rows from {last_id_before + 1} to {next_id - 1} are"
        if in_order
        else f"rows near row {last_id_before} are"
    )


class PagesOfMessage(NamedTuple):
    """Pages read for one message: the first page, the number of pages, and their bytes."""

    first: int
    pages: int
    data: NDArray[np.uint8]


class OverflowPageReader:
    """Reader of overflow pages, each of which has the number of the next."""

    def __init__(self, file: FileBytes, layout: PageLayout) -> None:
        self._file = file
        self._layout = layout
        self._most = max(1, _MOST_BYTES // layout.page_bytes)
        self._at_once = self._most
        self._used = 0
        self._near = PagesOfMessage(0, 0, np.empty(0, np.uint8))

    def join_spilled_messages(
        self,
        data: NDArray[np.uint8],
        ranges: PageRanges,
        rows: NDArray[np.int64],
        spills: NDArray[np.int64],
        spill_count: int,
    ) -> None:
        """Store spilled messages at their places in `rows`; damaged ones get `PAGE` 0.

        Args:
            data: bytes of leaves and other pages, with room for the messages.
            ranges: ranges of the pages in `data`.
            rows: (5, n) output of `scan_requested_rows_of_leaf_pages`.
            spills: (5, m) output of `scan_requested_rows_of_leaf_pages`.
            spill_count: number of spilled messages.
        """
        order = np.argsort(ranges.first, kind="stable")
        at_hand = np.stack([each[order] for each in ranges])
        state = np.array([0, 0, 0, 0, self._used], np.int64)
        while _join_overflow_chains(
            data, at_hand, self._near, self._layout, rows, spills, spill_count, state
        ):
            # if the pages of a message are not consecutive, reading many at once is wasted
            progress = int(state[_USED]) - self._used
            self._at_once = min(self._most, max(_FEWEST_PAGES, 2 * progress))
            self._used = int(state[_USED])
            self._read_likely_pages_of_message(int(state[_NEXT]), int(state[_LEFT]))
        self._used = int(state[_USED])

    def _read_likely_pages_of_message(self, page: int, bytes_left: int) -> None:
        """Read the pages from `page` on that probably contain the rest of a message."""
        size = self._layout.page_bytes
        needed = -(-bytes_left // (self._layout.usable_bytes - 4))
        pages = min(needed, self._at_once, self._layout.pages + 1 - page)
        data = self._near.data
        self._near = PagesOfMessage(
            page, pages, data if data.size else np.empty(self._most * size, np.uint8)
        )
        target = self._near.data[: pages * size]
        if self._file.read_into((page - 1) * size, target) < target.size:
            raise OSError("the file was truncated while it was read; read it again")


@compiled
def find_offset_of_loaded_page(loaded_pages: NDArray[np.int64], page: int, page_bytes: int) -> int:
    """Find the offset of a page in the data; -1 if it is not loaded."""
    found = np.searchsorted(loaded_pages[0], page, side="right") - 1
    if found < 0 or page >= loaded_pages[0, found] + loaded_pages[1, found]:
        return -1
    return loaded_pages[2, found] + (page - loaded_pages[0, found]) * page_bytes


@compiled
def _join_overflow_chains(
    data: NDArray[np.uint8],
    loaded_pages: NDArray[np.int64],
    loaded_ranges: PagesOfMessage,
    layout: PageLayout,
    rows: NDArray[np.int64],
    spills: NDArray[np.int64],
    count: int,
    state: NDArray[np.int64],
) -> bool:
    """Continue joining from `state`; return True if a page must be read first, False if done."""
    first_near, near_pages, near_bytes = loaded_ranges
    most = layout.usable_bytes - 4
    while state[_SPILL] < count:
        spill = state[_SPILL]
        if state[_LEFT] == 0:
            start, to = spills[BEGIN, spill], rows[OFFSET, spills[ROW, spill]]
            local = spills[LOCAL, spill]
            data[to : to + local] = data[start : start + local]
            state[_NEXT] = spills[PAGE, spill]
            state[_TO] = to + spills[LOCAL, spill]
            state[_LEFT] = spills[REST, spill]
        while state[_LEFT] > 0:
            page = state[_NEXT]
            visits_left = state[_USED] < _MOST_VISITS * layout.pages
            if page < 2 or page > layout.pages or page == layout.locked_page or not visits_left:
                break
            size = min(most, state[_LEFT])
            to = state[_TO]
            if first_near <= page < first_near + near_pages:
                at = (page - first_near) * layout.page_bytes
                following = read_big_endian(near_bytes, at, 4)
                data[to : to + size] = near_bytes[at + 4 : at + 4 + size]
            else:
                at = find_offset_of_loaded_page(loaded_pages, page, layout.page_bytes)
                if at < 0:
                    return True
                following = read_big_endian(data, at, 4)
                data[to : to + size] = data[at + 4 : at + 4 + size]
            state[_USED] += 1
            # only the last page has no next one: a cyclic chain has no last page
            if (following == 0) != (size == state[_LEFT]):
                break
            state[_NEXT] = following
            state[_TO] += size
            state[_LEFT] -= size
        if state[_LEFT] > 0:
            spills[PAGE, spill] = 0
            state[_LEFT] = 0
        state[_SPILL] += 1
    return False
