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


def scan_rows(
    grammar: Grammar, data: NDArray[np.uint8], spans: list[tuple[int, int]], expected: int = 0
) -> tuple[NDArray[np.int64], list[tuple[int, int, int]]]:
    """Rows of several spans of `data`; for each its first row, the end, and its unread bytes.

    Args:
        grammar: of the records.
        data: (bytes,) of a slab.
        spans: from, to.
        expected: how many records there are, if that is known; with another number the spans are
            scanned twice.
    """
    rows = np.empty((4, expected), np.int64)
    parts: list[tuple[int, int, int]] = []
    row = 0
    for begin, end in spans:
        first, unread, at = row, end - begin, begin
        while 0 <= at < end:
            count, stop = grammar.scan(data, at, end, rows, row)
            row += count
            unread -= stop - at
            at = grammar.find(data, stop + 1, end, end) if stop < end else end
        parts.append((first, row, unread))
    return (rows, parts) if row == expected else scan_rows(grammar, data, spans, row)
