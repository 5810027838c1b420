"""A container: the part of a log that holds raw messages and knows nothing of their types."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from analysis.model.loss import Loss
from replay.logs.messages.raw_batch import RawBatch

#: No chunk and no message may declare more: recorders write about 1 MB, and a declared size costs
#: nothing to lie.
LARGEST_BYTES: Final = 2**30


@dataclass(frozen=True, slots=True)
class Connection:
    """One stream of messages of one type; a topic may have several."""

    id: int
    topic: str
    #: ROS 2 spelling (`sensor_msgs/msg/Imu`), also for ROS 1.
    type: str
    #: of the messages: `ros1`, `cdr`, `json`, `protobuf`, or another that has no decoder here
    encoding: str
    definition: str
    #: `ros1msg`, `ros2msg`, `ros2idl`, `jsonschema`, `protobuf`, or empty where there is none
    definition_format: str


class BatchGroup(NamedTuple):
    """Batches that lie in the same memory, and what may still follow them."""

    batches: list[RawBatch]
    #: no later message has an earlier log time, unless the index lies
    floor_ns: int


class Container(Protocol):
    """Where messages come from. Losses grow while it is read."""

    files: tuple[Path, ...]
    connections: tuple[Connection, ...]

    @property
    def losses(self) -> Sequence[Loss]:
        """Damage found so far."""
        ...

    def log_times(self, connection_id: int) -> NDArray[np.int64]:
        """The log times of a connection in ns, from the index where there is one, in any order."""
        ...

    def message_count(self, connection_id: int) -> int:
        """How many log times a connection has, without putting them side by side."""
        ...

    def read_message_groups(
        self, connection_ids: Collection[int], start_ns: int | None, end_ns: int | None
    ) -> Iterator[BatchGroup]:
        """Messages of some connections in file order, both bounds inclusive.

        Batches of several connections that lie in the same memory come together. They are done
        with when the next ones are asked for: their memory is used again. Damage ends up in
        `losses`; it raises nothing.
        """
        ...

    def earliest_ns(self) -> int:
        """A log time that no message precedes, as far as that is known without reading them."""
        ...

    def check(self) -> int:
        """Once all messages were read: check the rest of the files.

        Returns:
            How many CRCs agree, those of the messages among them.
        """
        ...

    def close(self) -> None:
        """Release the files."""
        ...


#: nothing is known of what follows
UNKNOWN_NS: Final = -(2**63)
#: nothing follows
END_NS: Final = 2**63 - 1


def make_empty_times() -> NDArray[np.int64]:
    """The log times of a connection without messages."""
    return np.empty(0, np.int64)
