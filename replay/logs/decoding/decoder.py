"""Interface of decoders: batches of raw messages in, frames out."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import polars as pl

from replay.logs.messages.message_fields import OWN_COLUMNS, Field
from replay.logs.messages.raw_batch import RawBatch

#: Starts work, and returns a function that waits until it is done.
Submit: TypeAlias = Callable[[Callable[[], None]], Callable[[], object]]


def run_work_immediately(work: Callable[[], None]) -> Callable[[], object]:
    """A `Submit` that does the work immediately."""
    work()
    return lambda: None


@dataclass(frozen=True, slots=True, eq=False)
class DecodedBatch:
    """Rows of a batch in order, without messages that cannot be decoded."""

    frame: pl.DataFrame
    undecodable: int
    #: why the first of them cannot be
    first_fault: str


@dataclass(slots=True)
class DecodeTally:
    """Numbers of decoded and undecodable messages, and the first reason."""

    rows: int = 0
    undecodable: int = 0
    first_fault: str = ""
    #: by how much the log time falls from one message to the next, in ns, at most
    back_ns: int = 0


class Decoder(Protocol):
    """Decoder for the requested fields of one type."""

    def begin_decoding(self, batch: RawBatch, submit: Submit) -> Callable[[], DecodedBatch]:
        """Start decoding messages; the returned function finishes and gives the rows.

        Messages that cannot be decoded have no row. Work without the interpreter's lock is
        submitted to run meanwhile.
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
