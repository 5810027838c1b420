"""The interface of logs that the rest of payscope uses."""

import weakref
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, ClassVar, Final, Self

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.model.loss import Loss
from estimators.errors import LogError
from estimators.file_digest import file_sha256
from replay.logs.tables import TableHints, TimeAxis

__all__ = ["TABLE", "Log", "LogCheck", "TableHints", "TimeAxis"]

if TYPE_CHECKING:
    from replay.logs.messages.message_types import LeafField

#: Name of the only topic of a table.
TABLE: Final = "table"


@dataclass(frozen=True, slots=True)
class LogCheck:
    """Result of checking a log."""

    messages: int
    #: unpacked size of the messages
    message_bytes: int
    #: number of CRCs that agree; most formats have none
    crcs: int


def _do_nothing() -> None:
    pass


class Log(ABC):
    """An opened log. Open it with `replay.open_log`, use it as a context manager.

    Attributes:
        path: opened file or directory.
        format: name of the format.
    """

    #: the columns of `topics()`
    TOPICS_SCHEMA: ClassVar[pl.Schema] = pl.Schema(
        {
            "topic": pl.String,
            "type": pl.String,
            "encoding": pl.String,
            "messages": pl.Int64,
            "start_ns": pl.Int64,
            "end_ns": pl.Int64,
            "rate_hz": pl.Float64,
            "longest_gap_s": pl.Float64,
            "fields": pl.List(pl.String),
            "problem": pl.String,
            "decoder": pl.String,
        }
    )

    def __init__(
        self, path: Path, log_format: str, close: Callable[[], None] = _do_nothing
    ) -> None:
        """Initialise an open log.

        Args:
            path: opened file or directory.
            log_format: name of the format.
            close: releases the log; it must not be a method of the log itself, which would never be
                freed.
        """
        self.path: Final = path
        self.format: Final = log_format
        # closes a log that its user does not close, as in `run(open_log(path), machine)`
        self._close = weakref.finalize(self, close)

    @property
    @abstractmethod
    def files(self) -> tuple[Path, ...]:
        """Every file of the log, for the provenance."""

    @cached_property
    def digests(self) -> tuple[str, ...]:
        """The SHA-256 of every file, in hexadecimal."""
        return tuple(file_sha256(path) for path in self.files)

    @abstractmethod
    def topics(self) -> pl.DataFrame:
        """List the topics without decoding messages, a row each.

        Columns: topic, type (in ROS 2 spelling, `sensor_msgs/msg/Imu`, also for ROS 1), encoding
        (String), messages (Int64), start_ns, end_ns (Int64 log times, null when empty), rate_hz
        (Float64 mean rate) and longest_gap_s (Float64), null below two messages, fields
        (List[String], dotted leaves; a list shows as `effort[]`), problem (String: why it cannot
        be decoded, else null), decoder (String: columnar, or rosbags, json, protobuf for a type
        that is read message by message, some fifty times slower; null if problem is set).
        """

    def read(
        self,
        topic: str,
        fields: Sequence[str],
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> pl.DataFrame:
        """Read fields of one topic, in log-time order (stable).

        Args:
            topic: name of the topic as in `topics()` (a table has the one topic `table`).
            fields: dotted names (`angular_velocity.z`), an element by index (`covariance[0]`) or,
                in a message with a `name` list, by name (`effort[left]`), or a list as a whole
                (`effort[]`). Checked against the message definition before any message is decoded.
            start_ns: first log time, inclusive.
            end_ns: last log time, inclusive.

        Returns:
            log_time_ns (Int64), header_stamp_ns (Int64, null where there is none), then one column
            per field, named as requested: Float64 for floats, Int64 for integers (UInt64 for
            uint64, so that no value is lost), Int64 nanoseconds for stamps and durations
            (`header.stamp`), Boolean, String. A whole list is a List, nested once for each `[]`,
            in which numbers keep their size (List[Float32], List[UInt8]). An element that a message
            does not have is null. Incomplete messages have no row, whichever fields are requested.

        Raises:
            LogError: no such topic or field (with the choices), or a topic that cannot be decoded.
        """
        return self.read_many({topic: fields}, start_ns, end_ns)[topic]

    def read_many(
        self,
        fields: Mapping[str, Sequence[str]],
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> dict[str, pl.DataFrame]:
        """Read fields of several topics in one pass, each in the format of `read`.

        Args:
            fields: fields by topic.
            start_ns: first log time, inclusive.
            end_ns: last log time, inclusive.

        Raises:
            LogError: as from `read`.
        """
        self._refuse_closed_log()
        return self._read_frames_by_topic(fields, start_ns, end_ns)

    def scan(
        self,
        topic: str,
        fields: Sequence[str],
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> Iterator[pl.DataFrame]:
        """Read fields of one topic like `read`, in batches of rows.

        If the log has an index with the time range of every chunk, only the chunks that overlap in
        time are in memory at once. Batches are in log-time order; a message outside the time range
        that the index gives for its chunk comes late, and is reported as a loss.

        Raises:
            LogError: as `read`.
        """
        self._refuse_closed_log()
        return self._iter_frames_of_topic(topic, fields, start_ns, end_ns)

    def _iter_frames_of_topic(
        self, topic: str, fields: Sequence[str], start_ns: int | None, end_ns: int | None
    ) -> Iterator[pl.DataFrame]:
        """Yield the rows of a topic of an open log; one batch if the format cannot be split."""
        yield self._read_frames_by_topic({topic: fields}, start_ns, end_ns)[topic]

    def scan_many(
        self,
        fields: Mapping[str, Sequence[str]],
        faults: dict[str, str],
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> Iterator[tuple[str, pl.DataFrame]]:
        """Read fields of several topics in one pass, in batches of one topic each.

        Args:
            fields: fields by topic; each topic must be decodable.
            faults: receives, by topic, why none of its messages could be read.
            start_ns: first log time, inclusive.
            end_ns: last log time, inclusive.

        Raises:
            LogError: a topic or field does not exist.
        """
        self._refuse_closed_log()
        return self._iter_frames_of_topics(fields, faults, start_ns, end_ns)

    def _iter_frames_of_topics(
        self,
        fields: Mapping[str, Sequence[str]],
        faults: dict[str, str],
        start_ns: int | None,
        end_ns: int | None,
    ) -> Iterator[tuple[str, pl.DataFrame]]:
        """Yield batches of an open log; topic by topic if the format cannot be read in one pass."""
        del faults  # for these formats, opening the log reports what cannot be read
        for topic, names in fields.items():
            for rows in self._iter_frames_of_topic(topic, names, start_ns, end_ns):
                yield topic, rows

    def definition(self, topic: str) -> str:  # noqa: ARG002
        """Definition of a topic's messages as stored in the log; empty if there is none."""
        return ""

    def topic_names(self) -> list[str]:
        """Names of all topics, decodable or not."""
        return self.topics()["topic"].to_list()

    def leaf_fields(
        self, topic: str, fields: Sequence[str] | None = None
    ) -> "tuple[LeafField, ...]":
        """Describe the columns that `read` returns for fields.

        Args:
            topic: name of the topic.
            fields: as in `read`; None for all fields of `topics()`.

        Raises:
            LogError: as `read`.
        """
        from replay.logs.messages.message_types import LeafField  # its libraries are slow to import

        described = self.topics().filter(topic=topic)["fields"].to_list()
        names = fields if fields is not None else described[0] if described else ()
        read = self.read(topic, names, start_ns=0, end_ns=0)
        return tuple(LeafField(name, read.schema[name]) for name in dict.fromkeys(names))

    @abstractmethod
    def _read_frames_by_topic(
        self, fields: Mapping[str, Sequence[str]], start_ns: int | None, end_ns: int | None
    ) -> dict[str, pl.DataFrame]:
        """Read from an open log; see `read_many`."""

    @abstractmethod
    def losses(self) -> tuple[Loss, ...]:
        """Losses found so far: damaged data, and topics without a decoder."""

    def notes(self) -> tuple[str, ...]:
        """Notes on what was assumed about the log's format, one sentence each."""
        return ()

    def announce_fields_to_read(self, fields: Mapping[str, Sequence[str]]) -> None:  # noqa: B027 most have no use for it
        """Announce the fields that will be read next, by topic.

        A log that must scan all rows for their times reads these fields in the same pass.
        """

    def units(self, topic: str) -> Mapping[str, str]:  # noqa: ARG002
        """Units stated in the log, by field of a topic."""
        return {}

    def machine_ids(self) -> tuple[str, ...]:
        """Serial numbers of machines in the log's metadata; empty if there are none."""
        return ()

    @abstractmethod
    def check(self) -> LogCheck:
        """Read everything without trusting an index; faults are added to the losses.

        Every message of every topic is walked or decoded to its end, every CRC compared, and every
        index compared with the content.
        """

    def _refuse_closed_log(self) -> None:
        if not self._close.alive:
            raise LogError(f"{self.path}: the log was closed; open it again")

    @staticmethod
    def _make_topic_row_of_log_times(log_times: NDArray[np.int64]) -> dict[str, Any]:
        """Columns of `topics()` computed from log times (n,) in ns, in any order."""
        # recorders write messages nearly in order, which timsort exploits
        times = np.sort(log_times, kind="stable")
        count = int(times.size)
        start = int(times[0]) if count else None
        end = int(times[-1]) if count else None
        span_s = (int(times[-1]) - int(times[0])) / 1e9 if count else 0.0
        return {
            "messages": count,
            "start_ns": start,
            "end_ns": end,
            "rate_hz": (count - 1) / span_s if span_s > 0 else None,
            "longest_gap_s": int(np.diff(times).max()) / 1e9 if count > 1 else None,
        }

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._close()
