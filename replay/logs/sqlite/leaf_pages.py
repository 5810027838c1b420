"""The leaf pages of a SQLite table in the order of its rows, from the pages above them."""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.compiled import compiled
from replay.logs.sqlite.database_pages import LEAF, PageLayout
from replay.logs.sqlite.leaf_cells import big_endian
from replay.logs.storage import FileBytes

#: Kind of an interior page of a table, and bytes of its head (SQLite file format, 1.6).
_INTERIOR: Final = 5
_PAGE_HEAD: Final = 12
#: Pages above leaves that are read at once.
_STEP_BYTES: Final = 2**20


def leaf_pages(file: FileBytes, layout: PageLayout) -> NDArray[np.uint32] | None:
    """Numbers of the leaf pages, None where the tree is damaged.

    No page is met twice, so that a tree that leads back to itself ends here.
    """
    seen = np.zeros(layout.pages + 1, np.bool_)
    # the first holds the list of tables
    seen[[0, 1, layout.root]] = True
    if layout.locked_page <= layout.pages:
        seen[layout.locked_page] = True
    level = np.array([layout.root], np.uint32)
    while True:
        # leaves are all equally far from the root; one of three that differs is damaged
        some = level[[0, level.size // 2, -1]].tolist()
        heads = [file.read((page - 1) * layout.page_bytes, _PAGE_HEAD) for page in some]
        kinds = {head[:1] for head in heads}
        if kinds == {bytes([LEAF])}:
            is_empty = level.size == 1 and heads[0][3:5] == bytes(2)
            return level[:0] if is_empty else level
        if len(kinds) > 1:
            return None
        below = _child_pages(file, layout, level)
        if below is None or below.max() > layout.pages or seen[below].any():
            return None
        met = int(np.count_nonzero(seen))
        seen[below] = True
        if int(np.count_nonzero(seen)) - met != below.size:
            return None
        level = below


def _child_pages(
    file: FileBytes, layout: PageLayout, level: NDArray[np.uint32]
) -> NDArray[np.uint32] | None:
    """The pages below a level of the tree, None where one of it is damaged."""
    found: list[NDArray[np.uint32]] = []
    data = np.empty(max(_STEP_BYTES, layout.page_bytes), np.uint8)
    done = 0
    while done < level.size:
        ranges, slots = page_ranges(level[done:], layout.page_bytes, data.size)
        if not read_ranges(file, ranges, layout.page_bytes, data):
            return None
        # a page holds fewer than its bytes
        children = np.empty(slots.size * (layout.page_bytes // 6 + 1), np.uint32)
        count = _children(data, slots, layout.usable_bytes, children)
        if count < 0:
            return None
        found.append(children[:count].copy())
        done += slots.size
    return np.concatenate(found)


@compiled
def _children(
    data: NDArray[np.uint8], slots: NDArray[np.int64], usable: int, found: NDArray[np.uint32]
) -> int:
    """Pages below those that begin at `slots`; how many there are, -1 where one is damaged."""
    count = 0
    for base in slots:
        cells = big_endian(data, base + 3, 2)
        contents = base + _PAGE_HEAD + 2 * cells
        if data[base] != _INTERIOR or cells == 0 or contents > base + usable:
            return -1
        for cell in range(cells):
            at = base + big_endian(data, base + _PAGE_HEAD + 2 * cell, 2)
            # page and, in at least a byte, the last id below it
            if at < contents or at + 5 > base + usable:
                return -1
            if count == found.size:
                return -1
            found[count] = big_endian(data, at, 4)
            count += 1
        if count == found.size:
            return -1
        found[count] = big_endian(data, base + 8, 4)
        count += 1
    return count


#: Between pages that are wanted, so much is read with them: less than another read costs.
_MOST_BETWEEN: Final = 65_536


class PageRanges(NamedTuple):
    """Ranges of pages, (ranges,) each: the first page of each, how many, and where they go."""

    first: NDArray[np.int64]
    pages: NDArray[np.int64]
    begin: NDArray[np.int64]


def page_ranges(
    pages: NDArray[np.uint32], page_bytes: int, room: int
) -> tuple[PageRanges, NDArray[np.int64]]:
    """Find ranges that hold `pages`, or as many of them as there is room for, at least one.

    Returns:
        The stretches, and (n,) where each of the first n pages will begin.
    """
    numbers = pages[: max(1, room // page_bytes)].astype(np.int64)
    step = np.diff(numbers)
    apart = (step < 1) | ((step - 1) * page_bytes > _MOST_BETWEEN)
    slot = np.concatenate([[0], np.cumsum(np.where(apart, 1, step))])
    count = int(np.searchsorted(slot, room // page_bytes))
    numbers, slot = numbers[:count], slot[:count]
    starts = np.concatenate([[0], np.flatnonzero(apart[: count - 1]) + 1])
    ends = np.concatenate([starts[1:], [count]]) - 1
    ranges = PageRanges(
        numbers[starts], numbers[ends] - numbers[starts] + 1, slot[starts] * page_bytes
    )
    return ranges, slot * page_bytes


def read_ranges(
    file: FileBytes, ranges: PageRanges, page_bytes: int, target: NDArray[np.uint8]
) -> bool:
    """Read ranges of pages to their places in `target`; whether the file has all of them."""
    for first, pages, begin in zip(*(each.tolist() for each in ranges), strict=True):
        part = target[begin : begin + pages * page_bytes]
        if file.read_into((first - 1) * page_bytes, part) < part.size:
            return False
    return True
