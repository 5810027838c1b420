"""What every decoder offers: batches of raw messages in, frames out."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import polars as pl

from replay.logs.messages.message_fields import OWN_COLUMNS, Field
from replay.logs.messages.raw_batch import RawBatch

#: Starts work, and returns a function that waits until it is done.
Submit: TypeAlias = Callable[[Callable[[], None]], Callable[[], object]]


def submit_at_once(work: Callable[[], None]) -> Callable[[], object]:
    """Do the work, and wait for nothing: a `Submit`."""
    work()
    return lambda: None


@dataclass(frozen=True, slots=True, eq=False)
class DecodedBatch:
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

    def begin(self, batch: RawBatch, submit: Submit) -> Callable[[], DecodedBatch]:
        """Begin to decode messages; what it gives ends that. One that cannot be costs its row.

        Work that needs no lock of the interpreter is submitted, to be done in the meantime.
        """
        ...


def frame_schema_of_fields(fields: Sequence[Field]) -> pl.Schema:
    """The columns that reading `fields` gives."""
    return pl.Schema(
        {**dict.fromkeys(OWN_COLUMNS, pl.Int64()), **{field.name: field.dtype for field in fields}}
    )
