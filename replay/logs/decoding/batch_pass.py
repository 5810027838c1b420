"""A pass over a batch: the memory that it needs, and the columns that it finds."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from replay.logs.decoding.decode_program import Program
from replay.logs.decoding.direct_fields import DirectFields
from replay.logs.decoding.field_columns import Columns
from replay.logs.decoding.one_pass import one_pass, room_for
from replay.logs.decoding.walk_program import (
    FAULTS,
    Encoding,
    Messages,
    Noted,
    Outcome,
    no_template,
)

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


class BatchPass:
    """A pass over messages of one encapsulation, with the memory that it needs.

    The memory is there before it is done, since it may be done in another thread: what threads
    allocate themselves is kept apart from all else, and used again by none of the others.
    """

    def __init__(
        self,
        program: Program,
        direct: DirectFields,
        data: Bytes,
        begins: Ints,
        sizes: Ints,
        *,
        swap: bool,
    ) -> None:
        """Prepare it.

        Args:
            program: of the messages' type and encoding.
            direct: the fields that are gathered on the way.
            data: (bytes,) what they lie in.
            begins: (n,) where each begins, behind its encapsulation.
            sizes: (n,) bytes of each from there on.
            swap: whether their numbers are big-endian.
        """
        # a definition may say that messages are large, where the data has small ones only
        rows = int(np.count_nonzero(sizes >= program.least_bytes))
        self._program, self._direct, self._swap = program, direct, swap
        self._messages = Messages(data, begins, sizes)
        self._gathered = room_for(direct.gathering, rows)
        self._outcome = Outcome(np.empty(begins.size, np.int8), np.empty(begins.size, np.int64))
        self._room = room = np.full(program.nodes, min(rows * _ELEMENTS, int(sizes.sum())))
        room[0] = rows
        self._noted = _room_for_marks(program, room)

    def execute(self) -> None:
        """Walk and gather; once more where there was too little memory for the marks."""
        program, wire = self._program, self._program.wire
        while True:
            one_pass(
                self._messages, Encoding(wire.cdr, self._swap, wire.counted),
                program.steps, self._noted, no_template(program.nodes),
                self._direct.gathering, self._gathered, self._outcome,
            )  # fmt: skip
            filled = self._noted.filled
            if (filled <= self._room).all():
                return
            self._room = filled
            self._noted = _room_for_marks(program, filled)
            self._gathered.long_bytes[:] = 0

    def result(self) -> WalkedBatch:
        """What it found, once it is done."""
        table, marks, filled, *_ = self._noted
        noted = tuple(marks[base : base + filled[node]] for node, base, _ in table)
        root, rows = self._program.root, int(filled[0])
        columns = Columns(
            self._messages.data, self._swap, root, noted, rows, self._direct, self._gathered
        )
        whole = self._outcome.faults == 0
        if whole.all():
            return WalkedBatch(columns, whole, "")
        first = int(np.argmin(whole))
        where = f"(at its byte {self._outcome.places[first] + self._program.wire.head})"
        return WalkedBatch(columns, whole, f"{FAULTS[self._outcome.faults[first]]} {where}")


def _room_for_marks(program: Program, room: Ints) -> Noted:
    """Memory for the marks of so many elements of each node."""
    nodes = program.mark_nodes
    ends = np.cumsum(room[nodes])
    return Noted(
        np.stack([nodes, ends - room[nodes], room[nodes]], axis=1),
        marks=np.empty(int(ends[-1]) if ends.size else 0, np.int64),
        filled=np.zeros(program.nodes, np.int64),
        kept=np.empty(program.nodes, np.int64),
        left=np.empty(program.depth, np.int64),
    )
