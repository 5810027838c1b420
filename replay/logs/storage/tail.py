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
        is_finished: whether the recorder has closed the log, and all of it was given.
    """

    connections: dict[int, Connection]
    is_finished: bool

    @property
    def losses(self) -> Sequence[Loss]:
        """Damage found so far."""
        ...

    def poll(self) -> list[RawBatch]:
        """The messages that became whole since, in file order; none where the log has not grown.

        A record, chunk or transaction with missing bytes is left for a later call.
        """
        ...

    def end(self) -> None:
        """Nothing comes any more: what is not whole by now is a loss."""
        ...

    def close(self) -> None:
        """Release the file."""
        ...
