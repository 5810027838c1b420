"""Runs the walk over a batch with the memory that it needs, and hands on what it found."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from replay.decoding.columns import Columns
from replay.decoding.program import Program
from replay.decoding.walk import FAULTS, walk

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]

#: Elements that lists have on the average, as a first guess; with more, the walk is repeated.
_ELEMENTS: Final = 4


@dataclass(frozen=True, slots=True, eq=False)
class WalkedBatch:
    """The marks of the messages that are whole, and which those are."""

    columns: Columns
    #: (n,)
    whole: NDArray[np.bool_]
    first_fault: str


def walk_batch(
    program: Program, data: Bytes, begins: Ints, sizes: Ints, *, swap: bool
) -> WalkedBatch:
    """Walk the messages of one encapsulation.

    Args:
        program: of their type and encoding.
        data: (bytes,) what they lie in.
        begins: (n,) where each begins, behind its encapsulation.
        sizes: (n,) bytes of each from there on.
        swap: whether their numbers are big-endian.
    """
    wire = program.wire
    faults = np.empty(begins.size, np.int8)
    places = np.empty(begins.size, np.int64)
    left, kept = np.empty(program.depth, np.int64), np.empty(program.nodes, np.int64)
    room = np.full(program.nodes, min(begins.size * _ELEMENTS, int(sizes.sum())))
    room[0] = begins.size
    while True:
        ends = np.cumsum(room[program.mark_nodes])
        bases = ends - room[program.mark_nodes]
        marks = np.empty(int(ends[-1]) if ends.size else 0, np.int64)
        filled = np.zeros(program.nodes, np.int64)
        walk(
            data, begins, sizes, wire.cdr, swap, wire.counted, program.steps,
            bases, room, marks, filled, kept, left, faults, places,
        )  # fmt: skip
        if (filled <= room).all():
            break
        room = filled
    noted = tuple(
        marks[base : base + filled[node]]
        for base, node in zip(bases, program.mark_nodes, strict=True)
    )
    first = int(np.argmax(faults != 0)) if faults.size else 0
    fault = FAULTS[faults[first]] if faults.size else ""
    return WalkedBatch(
        Columns(data, swap, program.root, marks, bases, noted),
        faults == 0,
        f"{fault} (at its byte {places[first] + wire.head})" if fault else "",
    )
