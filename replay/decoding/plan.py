"""A decode plan: the fields asked for of one type, in every encoding its messages may have."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from replay.decoding.batch import RawBatch
from replay.decoding.decoder import Decoded, schema_of
from replay.decoding.program import Wanted, compile_program
from replay.decoding.walked import walk_batch
from replay.decoding.wire import ENCAPSULATIONS, REFUSED, ROS1, Wire
from replay.readers.fields import ALL, Field, resolve
from replay.readers.message_types import Record

#: What stands in the place of an encapsulation that a message is too short for.
_NONE: Final = -1


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """What came of the messages of one encapsulation, by their places in the batch."""

    frame: pl.DataFrame
    rows: NDArray[np.int64]
    faulty: NDArray[np.int64]
    first_fault: str


class Plan:
    """How to read fields of one type. It keeps nothing of what it decodes: threads may share it.

    Raises:
        NoPlanError: the type has something that no plan can express.
    """

    def __init__(self, record: Record, *, ros1: bool, fields: Sequence[Field]) -> None:
        self._fields = tuple(fields)
        self._stamp = resolve("header.stamp", record) if record.has_header else None
        wanted: Wanted = {}
        for field in (*self._fields, *filter(None, [self._stamp])):
            _want(wanted, field)
        self._ros1 = ros1
        #: by the two bytes of the encapsulation, most significant first; ROS 1 has none
        self._wires: dict[int, Wire] = {0: ROS1} if ros1 else ENCAPSULATIONS
        self._programs = {
            wire: compile_program(record, wanted, wire)
            for wire in dict.fromkeys(self._wires.values())
        }

    def decode(self, batch: RawBatch) -> Decoded:
        """Decode messages at once; one that is not whole costs its row."""
        kinds = np.zeros(batch.rows, np.int64) if self._ros1 else _encapsulations(batch)
        parts = [
            self._part(batch, np.flatnonzero(kinds == kind), kind)
            for kind in self._wires
            if kind in kinds
        ]
        frames = [part.frame for part in parts] or [pl.DataFrame(schema=schema_of(self._fields))]
        if len(frames) > 1:
            # back into the order of the batch
            order = np.argsort(np.concatenate([part.rows for part in parts]))
            frames = [pl.concat(frames)[order]]
        unknown = np.flatnonzero(~np.isin(kinds, list(self._wires)))
        faults = [(part.faulty, part.first_fault) for part in parts if part.faulty.size]
        if unknown.size:
            faults.append((unknown, _why_not(int(kinds[unknown[0]]))))
        _, first_fault = min(faults, key=lambda fault: int(fault[0][0]), default=(unknown, ""))
        return Decoded(frames[0], sum(rows.size for rows, _ in faults), first_fault)

    def _part(self, batch: RawBatch, rows: NDArray[np.int64], kind: int) -> _Part:
        """Decode the messages of one encapsulation."""
        wire = self._wires[kind]
        walked = walk_batch(
            self._programs[wire],
            batch.data,
            batch.offsets[rows] + wire.head,
            batch.lengths[rows] - wire.head,
            swap=wire.cdr and kind % 2 == 0,
        )
        whole = walked.whole
        log_times = pl.Series("log_time_ns", batch.log_times[rows[whole]])
        if self._stamp is None:
            stamps = pl.repeat(None, log_times.len(), dtype=pl.Int64, eager=True)
        else:
            stamps = walked.columns.column(self._stamp)
        fields = map(walked.columns.column, self._fields)
        frame = pl.DataFrame([log_times, stamps.alias("header_stamp_ns"), *fields])
        return _Part(frame, rows[whole], rows[~whole], walked.first_fault)


def _want(wanted: Wanted, field: Field) -> None:
    for step in field.steps:
        if isinstance(step.element, str) and step.element != ALL:
            wanted.setdefault("name", {})
        wanted = wanted.setdefault(step.name, {})


def _encapsulations(batch: RawBatch) -> NDArray[np.int64]:
    """The two bytes that name each message's encoding."""
    long = batch.lengths >= 4
    kinds = np.full(batch.rows, _NONE)
    at = batch.offsets[long]
    kinds[long] = batch.data[at].astype(np.int64) << 8 | batch.data[at + 1]
    return kinds


def _why_not(kind: int) -> str:
    if kind == _NONE:
        return "it is too short for its encapsulation"
    return f"no decoder for the encapsulation {REFUSED.get(kind, 'it begins with')} (0x{kind:04x})"
