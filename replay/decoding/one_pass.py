"""One pass over a batch: walk some messages, then gather from them what lies at fixed places.

About a thousand messages fit into the processor's near caches, and are still there when their
columns are gathered; a batch does not.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.compiled import compiled
from replay.decoding.gather import copy_equal, load, view
from replay.decoding.together import Gathering
from replay.decoding.walk import Encoding, Layout, Noted, walk

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]

_BLOCK_ROWS: Final = 1024


class Gathered(NamedTuple):
    """What a pass gathers; of `n` rows those of whole messages are filled, the first ones."""

    #: (values, n) 64 bits each
    values: Ints
    #: one array behind the other, n rows of each
    arrays: Bytes
    #: (texts, n, 4) views of strings, and the bytes of those that do not fit into theirs
    views: NDArray[np.uint32]
    long_bytes: Ints


def room_for(gathering: Gathering, rows: int) -> Gathered:
    """Memory for so many rows."""
    texts = gathering.text_marks.size
    return Gathered(
        np.empty((gathering.value_marks.size, rows), np.int64),
        np.empty(int(gathering.array_bytes.sum()) * rows, np.uint8),
        np.empty((texts, rows, 4), np.uint32),
        np.zeros(texts, np.int64),
    )


@compiled
def one_pass(
    data: Bytes,
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
        data: (bytes,) what they lie in.
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
        walk(data, begins, sizes, first, end, encoding, steps, noted, layout, faults, places)
        _gather(data, noted, gathering, gathered, encoding.swap, row, filled[0])


@compiled
def _gather(
    data: Bytes,
    noted: Noted,
    gathering: Gathering,
    gathered: Gathered,
    swap: bool,
    first: int,
    end: int,
) -> None:
    # unpacked once: in a loop, each time would count references to all
    _, bases, _, marks, _, _, _ = noted
    value_marks, value_offsets, value_loads = gathering[:3]
    array_marks, array_offsets, array_bytes, text_marks = gathering[3:]
    values, arrays, views, long_bytes = gathered
    for k in range(value_marks.size):
        base = bases[value_marks[k]]
        positions = marks[base + first : base + end]
        load(data, positions, value_offsets[k], value_loads[k], swap, values[k, first:end])
    rows = values.shape[1]
    above = 0
    for k in range(array_marks.size):
        base, size = bases[array_marks[k]], array_bytes[k]
        positions = marks[base + first : base + end]
        out = arrays[above + first * size : above + end * size]
        copy_equal(data, positions, array_offsets[k], size, out)
        above += rows * size
    nowhere = np.empty(0, np.uint8)
    for k in range(text_marks.size):
        base, sizes = bases[text_marks[k]], bases[text_marks[k] + 1]
        long_bytes[k] += view(
            data,
            marks[base + first : base + end],
            marks[sizes + first : sizes + end],
            views[k, first:end],
            nowhere,
        )
