"""Runs a pass over a batch with the memory that it needs, and hands on what it found."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from replay.decoding.columns import Columns
from replay.decoding.gather import source_of
from replay.decoding.one_pass import one_pass, room_for
from replay.decoding.program import Program
from replay.decoding.together import Together
from replay.decoding.walk import FAULTS, Encoding, Noted, no_layout

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]

#: Elements that lists have on the average, as a first guess; with more, the pass is repeated.
_ELEMENTS: Final = 4


@dataclass(frozen=True, slots=True, eq=False)
class WalkedBatch:
    """The columns of the messages that are whole, and which those are."""

    columns: Columns
    #: (n,)
    whole: NDArray[np.bool_]
    first_fault: str


def walk_batch(
    program: Program, together: Together, data: Bytes, begins: Ints, sizes: Ints, *, swap: bool
) -> WalkedBatch:
    """Walk the messages of one encapsulation.

    Args:
        program: of their type and encoding.
        together: the fields that are gathered on the way.
        data: (bytes,) what they lie in.
        begins: (n,) where each begins, behind its encapsulation.
        sizes: (n,) bytes of each from there on.
        swap: whether their numbers are big-endian.
    """
    wire, nodes, rows = program.wire, program.mark_nodes, begins.size
    source = source_of(data)
    gathered = room_for(together.gathering, rows)
    faults, places = np.empty(rows, np.int8), np.empty(rows, np.int64)
    left, kept = np.empty(program.depth, np.int64), np.empty(program.nodes, np.int64)
    room = np.full(program.nodes, min(rows * _ELEMENTS, int(sizes.sum())))
    room[0] = rows
    while True:
        ends = np.cumsum(room[nodes])
        bases = ends - room[nodes]
        marks = np.empty(int(ends[-1]) if ends.size else 0, np.int64)
        filled = np.zeros(program.nodes, np.int64)
        gathered.long_bytes[:] = 0
        one_pass(
            source, begins, sizes, Encoding(wire.cdr, swap, wire.counted), program.steps,
            Noted(nodes, bases, room, marks, filled, kept, left), no_layout(program.nodes),
            together.gathering, gathered, faults, places,
        )  # fmt: skip
        if (filled <= room).all():
            break
        room = filled
    noted = tuple(
        marks[base : base + filled[node]] for base, node in zip(bases, nodes, strict=True)
    )
    columns = Columns(source, swap, program.root, noted, int(filled[0]), together, gathered)
    whole = faults == 0
    if whole.all():
        return WalkedBatch(columns, whole, "")
    first = int(np.argmin(whole))
    where = f"(at its byte {places[first] + wire.head})"
    return WalkedBatch(columns, whole, f"{FAULTS[faults[first]]} {where}")
