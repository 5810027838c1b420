"""One pass over a batch: walk some messages, then gather from them what lies at fixed places.

A few hundred messages fit into the processor's nearest caches, and are still there when their
columns are gathered; a batch does not.
"""

from typing import Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from replay.decoding.gather import Source, copy_equal, load, view, words_of
from replay.decoding.together import Gathering
from replay.decoding.walk import Encoding, Layout, Noted, walk

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]

_BLOCK_ROWS: Final = 1024


class Gathered(NamedTuple):
    """What a pass gathers; of `n` rows those of whole messages are filled, the first ones."""

    #: (values, n) 64 bits each, and the same memory as doubles
    values: NDArray[np.uint64]
    floats: NDArray[np.float64]
    #: one array behind the other, n rows of each, and the 64 bits at every byte
    arrays: Bytes
    words: NDArray[np.uint64]
    #: (texts, n, 4) views of strings, and the bytes of those that do not fit into theirs
    views: NDArray[np.uint32]
    long_bytes: Ints


def room_for(gathering: Gathering, rows: int) -> Gathered:
    """Memory for so many rows."""
    values = np.empty((gathering.value_marks.size, rows), np.uint64)
    arrays = np.empty(int(gathering.array_bytes.sum()) * rows, np.uint8)
    texts = gathering.text_marks.size
    return Gathered(
        values,
        values.view(np.float64),
        arrays,
        words_of(arrays),
        np.empty((texts, rows, 4), np.uint32),
        np.zeros(texts, np.int64),
    )


@njit(cache=True, nogil=True)
def one_pass(
    source: Source,
    begins: Ints,
    sizes: Ints,
    encoding: Encoding,
    steps: Ints,
    noted: Noted,
    layout: Layout,
    gathering: Gathering,
    gathered: Gathered,
    faults: NDArray[np.int8],
    places: Ints,
) -> None:
    """Walk and gather messages.

    Args:
        source: what they lie in.
        begins: (n,) where each begins, behind its encapsulation.
        sizes: (n,) bytes of each from there on.
        encoding: of all of them.
        steps: the program.
        noted: takes the marks.
        layout: none remembered.
        gathering: what is gathered.
        gathered: takes it.
        faults: (n,) out, what is wrong with each message, see `walk.FAULTS`.
        places: (n,) out, the byte where it ends or that was found.
    """
    filled = noted.filled
    for first in range(0, begins.size, _BLOCK_ROWS):
        row = filled[0]
        end = min(first + _BLOCK_ROWS, begins.size)
        walk(source, begins, sizes, first, end, encoding, steps, noted, layout, faults, places)
        _gather(source, noted, gathering, gathered, encoding.swap, row, filled[0])


@njit(cache=True, nogil=True)
def _gather(
    source: Source,
    noted: Noted,
    gathering: Gathering,
    gathered: Gathered,
    swap: bool,
    first: int,
    end: int,
) -> None:
    marks, bases = noted.marks, noted.bases
    for k in range(gathering.value_marks.size):
        base = bases[gathering.value_marks[k]]
        load(
            source,
            marks[base + first : base + end],
            gathering.value_offsets[k],
            gathering.value_loads[k],
            swap,
            gathered.values[k, first:end],
            gathered.floats[k, first:end],
        )
    rows = gathered.values.shape[1]
    above = 0
    for k in range(gathering.array_marks.size):
        base, size = bases[gathering.array_marks[k]], gathering.array_bytes[k]
        offset = gathering.array_offsets[k]
        copy_equal(
            source,
            marks[base + first : base + end],
            offset,
            size,
            gathered.arrays,
            gathered.words,
            above + first * size,
        )
        above += rows * size
    nowhere = np.empty(0, np.uint8)
    for k in range(gathering.text_marks.size):
        base, sizes = bases[gathering.text_marks[k]], bases[gathering.text_marks[k] + 1]
        gathered.long_bytes[k] += view(
            source,
            marks[base + first : base + end],
            marks[sizes + first : sizes + end],
            gathered.views[k, first:end],
            nowhere,
        )
