"""What every log reader offers; nothing else of a reader is used."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

import polars as pl

from analysis.run import Loss


@dataclass(frozen=True, slots=True)
class Checked:
    """What was read to check a log."""

    messages: int
    #: of the messages, unpacked
    message_bytes: int
    #: that agree; most formats have none
    crcs: int


class Log(Protocol):
    """An opened log. Open it with `replay.open_log`, use it as a context manager."""

    @property
    def path(self) -> Path:
        """What was opened: a file, or a rosbag2 directory."""
        ...

    @property
    def files(self) -> tuple[Path, ...]:
        """Every file that is read, for the provenance."""
        ...

    def topics(self) -> pl.DataFrame:
        """What is in the log, a row a topic, without decoding a message.

        Columns: topic, type (in ROS 2 spelling, `sensor_msgs/msg/Imu`, also for ROS 1), encoding
        (String), messages (Int64), start_ns, end_ns (Int64 log times, null when empty), rate_hz
        (Float64 mean rate, null below two messages), longest_gap_s (Float64, likewise), fields
        (List[String], dotted leaves; a list shows as `effort[]`), problem (String: why it cannot
        be decoded, else null), decoder (String: columnar, or rosbags, json, protobuf for a type
        that is read message by message, some fifty times slower; null where there is a problem).
        """
        ...

    def read(
        self,
        topic: str,
        fields: Sequence[str],
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> pl.DataFrame:
        """Read fields of one topic, in log-time order (stable).

        Args:
            topic: its name, as `topics()` lists it (a table has the one topic `table`).
            fields: dotted names (`angular_velocity.z`), an element by index (`covariance[0]`) or,
                in a message with a `name` list, by name (`effort[left]`), or a list as a whole
                (`effort[]`). Checked against the message definition before any message is decoded.
            start_ns: first log time, inclusive.
            end_ns: last log time, inclusive.

        Returns:
            log_time_ns (Int64), header_stamp_ns (Int64, null where there is none), then a column
            a field, named as asked: Float64 for floats, Int64 for integers (UInt64 for uint64,
            so that no value is lost), Int64 nanoseconds for stamps and durations
            (`header.stamp`), Boolean, String. A whole list is a List, one in another for each
            `[]`, in which numbers keep their size (List[Float32], List[UInt8]). An element that a
            message does not have is null. Messages that are not whole have no row, whichever
            fields are asked for.

        Raises:
            LogError: no such topic or field (with the choices), or a topic that cannot be decoded.
        """
        ...

    def read_many(
        self,
        fields: Mapping[str, Sequence[str]],
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> dict[str, pl.DataFrame]:
        """Read fields of several topics in one pass over the log, each as `read` gives it.

        Args:
            fields: by topic.
            start_ns: first log time, inclusive.
            end_ns: last log time, inclusive.

        Raises:
            LogError: as `read`.
        """
        ...

    def losses(self) -> tuple[Loss, ...]:
        """What could not be read so far: damage, topics without a decoder."""
        ...

    def check(self) -> Checked:
        """Read everything and believe no index; what is wrong is then among the losses.

        Every message of every topic is walked or decoded to its end, every CRC compared, and what
        an index says compared with what is there.
        """
        ...

    def __enter__(self) -> Self: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...


@dataclass(frozen=True, slots=True)
class TimeAxis:
    """Where a table keeps its time: the column, and its unit (s, ms, us, ns)."""

    column: str
    unit: str = "s"
