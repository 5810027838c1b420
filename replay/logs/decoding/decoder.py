"""Interface of decoders, which convert batches of raw messages to frames."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import polars as pl

from replay.logs.messages.message_fields import OWN_COLUMNS, Field
from replay.logs.messages.raw_batch import RawBatch

#: Function that starts work, and returns a function that waits until it is done.
Submit: TypeAlias = Callable[[Callable[[], None]], Callable[[], object]]


def run_work_immediately(work: Callable[[], None]) -> Callable[[], object]:
    """A `Submit` that does the work immediately."""
    work()
    return lambda: None


@dataclass(frozen=True, slots=True, eq=False)
class DecodedBatch:
    """Rows of the decodable messages of a batch, in order."""

    frame: pl.DataFrame
    undecodable: int
    #: why the first undecodable message cannot be decoded; "" if there is none
    first_fault: str


@dataclass(slots=True)
class DecodeTally:
    """Numbers of decoded and undecodable messages, and the first reason."""

    rows: int = 0
    undecodable: int = 0
    first_fault: str = ""
    #: largest decrease of log time from one message to the next, in ns
    back_ns: int = 0


class Decoder(Protocol):
    """Decoder for the requested fields of one type."""

    def begin_decoding(self, batch: RawBatch, submit: Submit) -> Callable[[], DecodedBatch]:
        """Start decoding messages; the returned function waits for the rows and returns them.

        Messages that cannot be decoded have no row. Work that does not need the interpreter's lock
        is submitted to run in the meantime.
        """
        ...


def make_frame_schema(fields: Sequence[Field]) -> pl.Schema:
    """Schema of the frame with these fields."""
    return pl.Schema(
        {
            **dict.fromkeys(OWN_COLUMNS, pl.Int64()),
            **{field.name: field.column_dtype for field in fields},
        }
    )
