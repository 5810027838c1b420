"""A tail: messages of a log that is still being recorded, as they become complete."""

from collections.abc import Sequence
from typing import Protocol

from analysis.model.loss import Loss
from replay.logs.messages.raw_batch import RawBatch
from replay.logs.storage.container import Connection


class Tail(Protocol):
    """Source of the messages of a growing log, each once.

    Attributes:
        connections: connections by number; more may appear.
        is_finished: whether the recorder has closed the log and all messages were returned.
    """

    connections: dict[int, Connection]
    is_finished: bool

    @property
    def losses(self) -> Sequence[Loss]:
        """Damage found so far."""
        ...

    def poll(self) -> list[RawBatch]:
        """New complete messages in file order; empty if the log has not grown.

        A record, chunk or transaction with missing bytes is left for a later call.
        """
        ...

    def end(self) -> None:
        """Finish the log: incomplete data become losses."""
        ...

    def close(self) -> None:
        """Release the file."""
        ...
