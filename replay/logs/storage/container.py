"""Containers: the part of a log that contains raw messages, independent of their types.

A tail is the container of a log that is still being recorded.
"""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from analysis.model.loss import Loss
from replay.logs.messages.raw_batch import RawBatch

#: Most bytes that a chunk or message may declare: recorders write about 1 MB, and damaged data may
#: declare any size.
LARGEST_BYTES: Final = 2**30


@dataclass(frozen=True, slots=True)
class Connection:
    """A stream of messages of one type; a topic may have several."""

    id: int
    topic: str
    #: ROS 2 spelling (`sensor_msgs/msg/Imu`), also for ROS 1.
    type: str
    #: encoding of the messages: `ros1`, `cdr`, `json`, `protobuf`, or another without a decoder
    encoding: str
    definition: str
    #: `ros1msg`, `ros2msg`, `ros2idl`, `jsonschema`, `protobuf`, or empty without a definition
    definition_format: str


class BatchGroup(NamedTuple):
    """Batches in shared memory, with a lower bound of the log times in later groups."""

    batches: list[RawBatch]
    #: log time in ns before which no later message is, unless the index is wrong
    floor_ns: int


class Container(Protocol):
    """Source of raw messages. Its losses grow while it is read."""

    files: tuple[Path, ...]
    connections: tuple[Connection, ...]

    @property
    def losses(self) -> Sequence[Loss]:
        """Damage found so far."""
        ...

    def log_times(self, connection_id: int) -> NDArray[np.int64]:
        """Log times of a connection in ns, from an index if there is one, in any order."""
        ...

    def message_count(self, connection_id: int) -> int:
        """Number of log times of a connection, without collecting them."""
        ...

    def iter_batch_groups(
        self, connection_ids: Collection[int], start_ns: int | None, end_ns: int | None
    ) -> Iterator[BatchGroup]:
        """Yield messages of some connections in file order, in a time range that includes its ends.

        Batches that share memory form a group, which is invalid once the next one is requested.
        Damage is added to `losses` instead of raising an error.
        """
        ...

    def log_time_lower_bound_ns(self) -> int:
        """Lower bound of all log times in ns, as far as known without reading them."""
        ...

    def check_whole_file_and_count_valid_crcs(self) -> int:
        """Check the files from start to end, after all messages were read.

        Returns:
            Number of CRCs that agree, including those of messages.
        """
        ...

    def close(self) -> None:
        """Release the files."""
        ...


#: lower bound of later log times, in ns, if nothing is known about them
UNKNOWN_NS: Final = -(2**63)
#: lower bound of later log times, in ns, if no message follows
END_NS: Final = 2**63 - 1


def make_empty_log_times() -> NDArray[np.int64]:
    """Make the log times of a connection without messages: int64, (0,)."""
    return np.empty(0, np.int64)


class Tail(Protocol):
    """Source of the messages of a growing log, which returns each message once.

    Attributes:
        connections: connections by number; more may appear.
        is_finished: whether the recorder has closed the log and all messages were returned.
    """

    connections: dict[int, Connection]
    is_finished: bool

    @property
    def read_error(self) -> str:
        """Why the last poll could not read the log; empty if it could."""
        ...

    @property
    def losses(self) -> Sequence[Loss]:
        """Damage found so far."""
        ...

    def poll(self) -> list[RawBatch]:
        """Return new complete messages in file order; empty if the log has not grown.

        An incomplete record, chunk or transaction is left for a later call.
        """
        ...

    def finish_and_note_incomplete_end(self) -> None:
        """Note incomplete data at the end of the log as losses, since no more will be written."""
        ...

    def close(self) -> None:
        """Release the file."""
        ...
