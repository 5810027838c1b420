"""Join messages that do not fit into their leaf page of a SQLite table from overflow pages."""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.compiled import compiled
from replay.logs.sqlite.database_pages import PageLayout
from replay.logs.sqlite.leaf_cells import big_endian
from replay.logs.sqlite.leaf_pages import PageRanges
from replay.logs.sqlite.leaf_scan import BEGIN, LOCAL, PAGE, REST, ROW
from replay.logs.storage import OFFSET, FileBytes

#: What is read at once of a message whose pages are not at hand.
_MOST_BYTES: Final = 2**20
_FEWEST_PAGES: Final = 4
#: Each page belongs to one message. Damaged files may lead to pages again, but not without end.
_MOST_VISITS: Final = 16
#: Where joining is: the spilled row, the page that goes on, where its bytes go to, how many of the
#: message are left, and how many pages were used.
_SPILL, _NEXT, _TO, _LEFT, _USED = range(5)


class Near(NamedTuple):
    """Pages that were read for one message: the first, how many, and their bytes."""

    first: int
    pages: int
    data: NDArray[np.uint8]


class Chains:
    """Follows overflow pages, of which each names the next."""

    def __init__(self, file: FileBytes, layout: PageLayout) -> None:
        self._file = file
        self._layout = layout
        self._most = max(1, _MOST_BYTES // layout.page_bytes)
        self._at_once = self._most
        self._used = 0
        self._near = Near(0, 0, np.empty(0, np.uint8))

    def join(
        self,
        data: NDArray[np.uint8],
        ranges: PageRanges,
        rows: NDArray[np.int64],
        spills: NDArray[np.int64],
        count: int,
    ) -> None:
        """Put spilled messages where `rows` says; of those that are damaged, `PAGE` becomes 0.

        Args:
            data: holds leaves, other pages that were read with them, and room.
            ranges: which pages those are.
            rows: (5, n) of `scan_leaves`.
            spills: (5, m) likewise.
            count: how many there are of these.
        """
        order = np.argsort(ranges.first, kind="stable")
        at_hand = np.stack([each[order] for each in ranges])
        state = np.array([0, 0, 0, 0, self._used], np.int64)
        while _join(data, at_hand, self._near, self._layout, rows, spills, count, state):
            # where pages do not follow each other, reading many at once is for nothing
            progress = int(state[_USED]) - self._used
            self._at_once = min(self._most, max(_FEWEST_PAGES, 2 * progress))
            self._used = int(state[_USED])
            self._read(int(state[_NEXT]), int(state[_LEFT]))
        self._used = int(state[_USED])

    def _read(self, page: int, left: int) -> None:
        """Read pages from one on that may be those of the bytes that are left of a message."""
        size = self._layout.page_bytes
        needed = -(-left // (self._layout.usable_bytes - 4))
        pages = min(needed, self._at_once, self._layout.pages + 1 - page)
        data = self._near.data
        self._near = Near(page, pages, data if data.size else np.empty(self._most * size, np.uint8))
        target = self._near.data[: pages * size]
        if self._file.read_into((page - 1) * size, target) < target.size:
            raise OSError("the file became shorter")


@compiled
def _find(at_hand: NDArray[np.int64], page: int, page_bytes: int) -> int:
    """Where a page is in the data, -1 where not."""
    found = np.searchsorted(at_hand[0], page, side="right") - 1
    if found < 0 or page >= at_hand[0, found] + at_hand[1, found]:
        return -1
    return at_hand[2, found] + (page - at_hand[0, found]) * page_bytes


@compiled
def _join(
    data: NDArray[np.uint8],
    at_hand: NDArray[np.int64],
    near: Near,
    layout: PageLayout,
    rows: NDArray[np.int64],
    spills: NDArray[np.int64],
    count: int,
    state: NDArray[np.int64],
) -> bool:
    """Join on from `state`, to the end or, then it is true, a page that is not at hand."""
    first_near, near_pages, near_bytes = near
    most = layout.usable_bytes - 4
    while state[_SPILL] < count:
        spill = state[_SPILL]
        if state[_LEFT] == 0:
            begin, to = spills[BEGIN, spill], rows[OFFSET, spills[ROW, spill]]
            local = spills[LOCAL, spill]
            data[to : to + local] = data[begin : begin + local]
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
                following = big_endian(near_bytes, at, 4)
                data[to : to + size] = near_bytes[at + 4 : at + 4 + size]
            else:
                at = _find(at_hand, page, layout.page_bytes)
                if at < 0:
                    return True
                following = big_endian(data, at, 4)
                data[to : to + size] = data[at + 4 : at + 4 + size]
            state[_USED] += 1
            # only the last names none: a chain in a circle has no last
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
