"""Records of a slab: what a format's scan finds, as columns."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from replay.readers.containers.block import Block

#: (data, begin, end, rows, row) -> (rows found, where the first record begins that is not whole):
#: scan [begin, end) of a slab, and fill rows from `row` on, as many as there is room for.
Scan = Callable[
    [NDArray[np.uint8], int, int, NDArray[np.int64], int],
    tuple[int, int],
]
#: (data, begin, end, limit) -> where in [begin, end) records go on after damage, or -1: a few in a
#: row are no accident. `limit` is where the last of them may end, at or behind `end`.
Find = Callable[[NDArray[np.uint8], int, int, int], int]


class Grammar(NamedTuple):
    """How records of a format are found in bytes."""

    scan: Scan
    find: Find


#: Columns of a row. Of a record that is no message, `KEY` is -1 - opcode, and `OFFSET` and
#: `LENGTH` tell where all of it lies.
KEY, TIME, OFFSET, LENGTH = range(4)


@dataclass(frozen=True, slots=True)
class Slab:
    """Blocks unpacked side by side, and their records."""

    data: NDArray[np.uint8]
    #: (4, n): connection, log time (its 64 bits), offset and length of the message in `data`
    rows: NDArray[np.int64]
    #: a block, its first row, the row behind its last, and its bytes that are no records
    parts: tuple[tuple[Block, int, int, int], ...]
    damaged: tuple[tuple[Block, str], ...]


class Rows:
    """The rows of a slab, which are found block by block: each is still in the caches then."""

    def __init__(self, grammar: Grammar, data: NDArray[np.uint8], expected: int) -> None:
        """Begin without rows.

        Args:
            grammar: of the records.
            data: (bytes,) of the slab.
            expected: how many records there are, if that is known; where there are more, a block
                is scanned twice.
        """
        self._grammar, self._data = grammar, data
        self._rows = np.empty((4, expected), np.int64)
        self._count = 0

    @property
    def found(self) -> NDArray[np.int64]:
        """All so far; see `Slab.rows`."""
        return np.ascontiguousarray(self._rows[:, : self._count])

    def scan(self, begin: int, end: int) -> tuple[int, int, int]:
        """Add those of a span: its first row, the one behind its last, its bytes that are none."""
        first = self._count
        count, unread = self._scan(begin, end)
        if first + count > self._rows.shape[1]:
            grown = np.empty((4, max(first + count, 2 * first)), np.int64)
            grown[:, :first] = self._rows[:, :first]
            self._rows = grown
            self._scan(begin, end)
        self._count = first + count
        return first, self._count, unread

    def _scan(self, begin: int, end: int) -> tuple[int, int]:
        row, unread, at = self._count, end - begin, begin
        while 0 <= at < end:
            count, stop = self._grammar.scan(self._data, at, end, self._rows, row)
            row += count
            unread -= stop - at
            at = self._grammar.find(self._data, stop + 1, end, end) if stop < end else end
        return row - self._count, unread
