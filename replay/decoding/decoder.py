"""Decoders: what turns batches of raw messages into frames, and which one a type gets."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import polars as pl

from replay.decoding.batch import RawBatch
from replay.decoding.block import NoPlanError
from replay.decoding.library import ROSBAGS
from replay.decoding.program import compile_program
from replay.decoding.wire import CDR
from replay.readers.fields import OWN_COLUMNS, Field
from replay.readers.message_types import MessageType

#: Takes work, and gives what waits for its end.
Submit: TypeAlias = Callable[[Callable[[], None]], Callable[[], object]]


def at_once(work: Callable[[], None]) -> Callable[[], object]:
    """Do the work, and wait for nothing: a `Submit`."""
    work()
    return lambda: None


@dataclass(frozen=True, slots=True, eq=False)
class Decoded:
    """The rows of a batch, in its order, without the messages that cannot be decoded."""

    frame: pl.DataFrame
    undecodable: int
    #: why the first of them cannot be
    first_fault: str


@dataclass(slots=True)
class Tally:
    """How many messages became rows, how many could not be decoded, and why the first not."""

    rows: int = 0
    undecodable: int = 0
    first_fault: str = ""
    #: by how much the log time falls from one message to the next, in ns, at most
    back_ns: int = 0


class Decoder(Protocol):
    """Knows one type and the fields asked for."""

    def begin(self, batch: RawBatch, submit: Submit) -> Callable[[], Decoded]:
        """Begin to decode messages; what it gives ends that. One that cannot be costs its row.

        Work that needs no lock of the interpreter is submitted, to be done in the meantime.
        """
        ...


def schema_of(fields: Sequence[Field]) -> pl.Schema:
    """The columns that reading `fields` gives."""
    return pl.Schema(
        {**dict.fromkeys(OWN_COLUMNS, pl.Int64()), **{field.name: field.dtype for field in fields}}
    )


def decoder_name(kind: MessageType) -> str:
    """Which decoder a type gets: `columnar`, or the library that decodes message by message."""
    if kind.library is ROSBAGS:
        try:
            compile_program(kind.record, {}, CDR)
        except NoPlanError:
            return ROSBAGS.name
        return "columnar"
    return kind.library.name


def make_decoder(kind: MessageType, fields: Sequence[Field]) -> Decoder:
    """The columnar decoder, or a library's for a type that it cannot express."""
    # numba is slow to import, and a log can be described without it
    if decoder_name(kind) == "columnar":
        from replay.decoding.plan import Plan

        return Plan(kind.record, ros1=kind.ros1, fields=fields)
    from replay.decoding.fallback import MessageByMessage

    return MessageByMessage(kind, fields)
