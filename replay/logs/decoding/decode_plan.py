"""Decode plan: decode the requested fields of one type, in every encoding of its messages."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np
import polars as pl
import pyarrow as pa
from numpy.typing import NDArray

from estimators.arrays import Bytes, Ints
from replay.logs.decoding.arrow_arrays import make_time_array
from replay.logs.decoding.decode_program import DecodeProgram, Wanted, compile_decode_program
from replay.logs.decoding.decoder import (
    DecodedBatch,
    Submit,
    make_frame_schema,
    run_work_immediately,
)
from replay.logs.decoding.direct_fields import DirectFields, select_fields_at_fixed_offsets
from replay.logs.decoding.field_columns import ColumnBuilder
from replay.logs.decoding.one_pass import allocate_gathered_rows, locate_and_gather_fields
from replay.logs.decoding.spans import NoPlanError
from replay.logs.decoding.walk_program import (
    FAULTS,
    TOO_SHORT,
    EncodedMessages,
    Encoding,
    WalkNotes,
    WalkOutcome,
    allocate_message_layout_template,
    read_encapsulation_identifiers,
)
from replay.logs.decoding.wire import ENCAPSULATIONS, REFUSED, ROS1, WireEncoding
from replay.logs.messages.message_fields import ALL, OWN_COLUMNS, Field, resolve_message_field
from replay.logs.messages.message_types import RecordType
from replay.logs.messages.raw_batch import RawBatch

#: First guess of the mean number of list elements; if lists have more, the pass is repeated.
_ELEMENTS: Final = 4


@dataclass(frozen=True, slots=True, eq=False)
class WalkedBatch:
    """Columns of the complete messages, and the indices of these messages."""

    columns: ColumnBuilder
    #: (n,) whether each message of the batch is complete
    is_complete: NDArray[np.bool_]
    first_fault: str


class BatchPass:
    """A pass over messages of one encapsulation, with its memory.

    The memory is allocated beforehand, since memory allocated in a thread cannot be reused by
    others.
    """

    def __init__(
        self,
        program: DecodeProgram,
        direct: DirectFields,
        data: Bytes,
        starts: Ints,
        sizes: Ints,
        *,
        swap: bool,
    ) -> None:
        """Allocate the memory of the pass.

        Args:
            program: program for the messages' type and encoding.
            direct: fields gathered during the pass.
            data: (bytes,) bytes that contain the messages.
            starts: (n,) start of each message, after its encapsulation.
            sizes: (n,) bytes of each message, without its encapsulation.
            swap: whether numbers are big-endian.
        """
        # messages too small for the definition are not complete, and need no row
        rows = int(np.count_nonzero(sizes >= program.least_bytes))
        self._program, self._direct, self._swap = program, direct, swap
        self._messages = EncodedMessages(data, starts, sizes)
        self._gathered = allocate_gathered_rows(direct.gather_plan, rows)
        self._outcome = WalkOutcome(np.empty(starts.size, np.int8), np.empty(starts.size, np.int64))
        self._room = room = np.full(program.nodes, min(rows * _ELEMENTS, int(sizes.sum())))
        room[0] = rows
        self._notes = _allocate_walk_notes(program, room)

    def locate_and_gather_fields_of_batch(self) -> None:
        """Locate and gather the fields; repeat if there was too little memory for the marks."""
        program, wire = self._program, self._program.wire
        while True:
            locate_and_gather_fields(
                self._messages, Encoding(wire.cdr, self._swap, wire.length_alignment),
                program.steps, self._notes, allocate_message_layout_template(program.nodes),
                self._direct.gather_plan, self._gathered, self._outcome,
            )  # fmt: skip
            filled = self._notes.filled
            if (filled <= self._room).all():
                return
            self._room = filled
            self._notes = _allocate_walk_notes(program, filled)
            self._gathered.long_bytes[:] = 0

    def finish_batch(self) -> WalkedBatch:
        """Return the columns of the complete messages, and the first fault of the others."""
        table, marks, filled, *_ = self._notes
        mark_values = tuple(marks[base : base + filled[node]] for node, base, _ in table)
        root, rows = self._program.root, int(filled[0])
        columns = ColumnBuilder(
            self._messages.data, self._swap, root, mark_values, rows, self._direct, self._gathered
        )
        whole = self._outcome.faults == 0
        if whole.all():
            return WalkedBatch(columns, whole, "")
        first = int(np.argmin(whole))
        at = self._outcome.places[first] + self._program.wire.encapsulation_size_bytes
        fault = f"{FAULTS[self._outcome.faults[first]]} (at its byte {at})"
        return WalkedBatch(columns, whole, fault)


def _allocate_walk_notes(program: DecodeProgram, elements_of_nodes: Ints) -> WalkNotes:
    """Allocate marks for the given numbers of elements of each node."""
    nodes = program.mark_nodes
    ends = np.cumsum(elements_of_nodes[nodes])
    return WalkNotes(
        np.stack([nodes, ends - elements_of_nodes[nodes], elements_of_nodes[nodes]], axis=1),
        marks=np.empty(int(ends[-1]) if ends.size else 0, np.int64),
        filled=np.zeros(program.nodes, np.int64),
        kept=np.empty(program.nodes, np.int64),
        left=np.empty(program.depth, np.int64),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _DecodedPart:
    """Decoded messages of one encapsulation, with their indices in the batch."""

    frame: pl.DataFrame
    complete: NDArray[np.int64]
    faulty: NDArray[np.int64]
    first_fault: str


class DecodePlan:
    """Plan to decode fields of one type. It holds no decoded data, so threads may share it.

    Raises:
        NoPlanError: the type contains something that no plan can express.
    """

    def __init__(self, record: RecordType, *, ros1: bool, fields: Sequence[Field]) -> None:
        self._fields = tuple(fields)
        self._stamp = resolve_message_field("header.stamp", record) if record.has_header else None
        wanted: Wanted = {}
        for field in (*self._fields, *filter(None, [self._stamp])):
            _add_field_to_wanted_tree(wanted, field)
        self._ros1 = ros1
        self._read_fields = self._fields if self._stamp is None else (self._stamp, *self._fields)
        self._names = [*OWN_COLUMNS, *(field.name for field in self._fields)]
        #: encoding by the first two bytes of the encapsulation, big-endian; ROS 1 has none
        self._wires: dict[int, WireEncoding] = {0: ROS1} if ros1 else ENCAPSULATIONS
        self._record, self._wanted = record, wanted
        self._programs: dict[WireEncoding, _CompiledProgram] = {}
        # a type without a plan in the first encoding is decoded by a library
        self._compile_program_once_per_encoding(next(iter(self._wires.values())))

    def _compile_program_once_per_encoding(self, wire: WireEncoding) -> "_CompiledProgram":
        """Return the program for an encoding, compiled when a message first uses it."""
        if wire not in self._programs:
            program = compile_decode_program(self._record, self._wanted, wire)
            direct = select_fields_at_fixed_offsets(program.root, self._read_fields)
            place_of = {steps: place for place, steps in enumerate(direct.field_paths)}
            places = tuple(place_of.get(field.steps) for field in self._read_fields)
            self._programs[wire] = program, direct, places
        return self._programs[wire]

    def decode(self, batch: RawBatch) -> DecodedBatch:
        """Decode messages; incomplete ones are skipped."""
        return self.begin_decoding(batch, run_work_immediately)()

    def begin_decoding(self, batch: RawBatch, submit: Submit) -> Callable[[], DecodedBatch]:
        """See `Decoder.begin_decoding`."""
        if self._ros1:
            found = np.zeros(batch.message_count, np.int64)
        else:
            found = read_encapsulation_identifiers(batch.data, batch.offsets, batch.lengths)
        if not batch.message_count or (found[0] != found).any() or int(found[0]) not in self._wires:
            return lambda: self._decode_mixed_encapsulations(batch, found)
        finish = self._begin_decoding_one_encapsulation(batch, int(found[0]), submit)

        def finish_decoding() -> DecodedBatch:
            part = finish()
            return DecodedBatch(part.frame, part.faulty.size, part.first_fault)

        return finish_decoding

    def _decode_mixed_encapsulations(
        self, batch: RawBatch, encapsulations: NDArray[np.int64]
    ) -> DecodedBatch:
        """Decode messages of several encapsulations, or of unknown ones, which have no row."""
        chosen = [np.flatnonzero(encapsulations == kind) for kind in self._wires]
        parts = [
            (
                at,
                self._begin_decoding_one_encapsulation(
                    batch.select_messages(at), kind, run_work_immediately
                )(),
            )
            for kind, at in zip(self._wires, chosen, strict=True)
            if at.size
        ]
        frames = [
            pl.DataFrame(schema=make_frame_schema(self._fields)),
            *(part.frame for _, part in parts),
        ]
        # back into the order of the batch
        rows = [at[part.complete] for at, part in parts]
        order = np.argsort(np.concatenate([np.empty(0, np.int64), *rows]))
        faults = [(at[part.faulty], part.first_fault) for at, part in parts if part.faulty.size]
        unknown = np.flatnonzero(~np.isin(encapsulations, list(self._wires)))
        if unknown.size:
            faults.append(
                (unknown, _describe_unknown_encapsulation(int(encapsulations[unknown[0]])))
            )
        _, first_fault = min(faults, key=lambda fault: int(fault[0][0]), default=(unknown, ""))
        return DecodedBatch(pl.concat(frames)[order], sum(at.size for at, _ in faults), first_fault)

    def _begin_decoding_one_encapsulation(
        self, batch: RawBatch, encapsulation: int, submit: Submit
    ) -> Callable[[], _DecodedPart]:
        """Start decoding messages of one encapsulation."""
        wire = self._wires[encapsulation]
        try:
            program, direct, places = self._compile_program_once_per_encoding(wire)
        except NoPlanError as error:
            faulty = _DecodedPart(
                pl.DataFrame(schema=make_frame_schema(self._fields)),
                np.empty(0, np.int64),
                np.arange(batch.message_count),
                str(error),
            )
            return lambda: faulty
        batch_pass = BatchPass(
            program,
            direct,
            batch.data,
            batch.offsets + wire.encapsulation_size_bytes,
            batch.lengths - wire.encapsulation_size_bytes,
            swap=wire.cdr and encapsulation % 2 == 0,
        )
        wait = submit(batch_pass.locate_and_gather_fields_of_batch)

        def finish_part() -> _DecodedPart:
            wait()
            return self._make_frame_of_walked_batch(
                batch_pass.finish_batch(), places, batch.log_times
            )

        return finish_part

    def _make_frame_of_walked_batch(
        self,
        walked: WalkedBatch,
        gathered_indices: tuple[int | None, ...],
        log_times: NDArray[np.int64],
    ) -> _DecodedPart:
        columns, is_complete = walked.columns, walked.is_complete
        faulty = np.flatnonzero(~is_complete)
        log_times = log_times[is_complete] if faulty.size else log_times
        gathered = list(columns.iter_gathered_fields())
        arrays: list[Any] = [
            columns.make_column(field) if place is None else gathered[place]
            for field, place in zip(self._read_fields, gathered_indices, strict=True)
        ]
        if self._stamp is None:
            arrays.insert(0, pa.nulls(log_times.size, pa.int64()))
        table: Any = pa.RecordBatch.from_arrays([make_time_array(log_times), *arrays], self._names)
        return _DecodedPart(
            pl.DataFrame(table), np.flatnonzero(is_complete), faulty, walked.first_fault
        )


#: A program, the fields that it gathers directly, and the index of each field among them, if any.
_CompiledProgram: TypeAlias = tuple[DecodeProgram, DirectFields, tuple[int | None, ...]]


def _add_field_to_wanted_tree(wanted_tree: Wanted, field: Field) -> None:
    """Add the path of a field to the tree of wanted fields."""
    for step in field.steps:
        if isinstance(step.element, str) and step.element != ALL:
            wanted_tree.setdefault("name", {})
        wanted_tree = wanted_tree.setdefault(step.name, {})


def _describe_unknown_encapsulation(encapsulation: int) -> str:
    if encapsulation == TOO_SHORT:
        return "it is too short for its encapsulation"
    name = REFUSED.get(encapsulation, "it begins with")
    return f"no decoder for the encapsulation {name} (0x{encapsulation:04x})"
