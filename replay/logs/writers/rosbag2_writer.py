"""Write simulated logs as rosbag2 directories with MCAP storage, and as bare databases."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from mcap.records import Metadata
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Writer
from rosbags.typesys import Stores, get_typestore

from analysis.simulation import SimulatedLog
from estimators.arrays import Ints
from replay.logs.writers.mcap_writer import (
    McapColumnWriter,
    SchemaAndChannel,
    make_mcap_message_envelope,
    make_schema_and_channel,
)
from replay.logs.writers.recorded_order import RecordedTopic, iter_records_in_time_order
from replay.logs.writers.ros_messages import TOPICS, make_recorded_topics
from replay.logs.writers.serialise_messages import Envelope

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.rosbag2.enums import CompressionMode

#: Name that rosbags' writer gives the metadata file.
METADATA: Final = "metadata.yaml"


def write_rosbag2(log: SimulatedLog, path: Path) -> None:
    """Write `log` as a rosbag2 directory at `path`, which must not exist."""
    _write_rosbag2_with_plugin(log, path, StoragePlugin.MCAP)


def write_db3(log: SimulatedLog, path: Path) -> None:
    """Write `log` as a bare database of rosbag2 at `path`, which must not exist."""
    folder = path.with_name(f"{path.stem}.folder")
    _write_rosbag2_with_plugin(log, folder, StoragePlugin.SQLITE3)
    (folder / f"{folder.name}.db3").rename(path)
    (folder / METADATA).unlink()
    folder.rmdir()


def _write_rosbag2_with_plugin(log: SimulatedLog, path: Path, plugin: StoragePlugin) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    before = (
        make_mcap_message_envelope if plugin is StoragePlugin.MCAP else make_empty_message_envelope
    )
    with _ColumnWriter(path, version=Writer.VERSION_LATEST, storage_plugin=plugin) as bag:
        numbers = {
            name: bag.add_connection(TOPICS[name].name, TOPICS[name].msgtype, typestore=store).id
            for name in log.topics
        }
        bag.write_topics(make_recorded_topics(log, store, numbers, before, ros1=False))
        if log.scenario.log.machine_id:
            bag.set_custom_data("machine_id", log.scenario.log.machine_id)


def make_empty_message_envelope(_connection: int, _times: Ints) -> Envelope:
    """Make an empty envelope, since a database stores nothing before a message."""
    return lambda _size: ()


class _MessageCounts(NamedTuple):
    """Number of messages by connection, and first and last log time of all."""

    counts: dict[int, int]
    start_ns: int
    end_ns: int


class _Storage:
    """Storage of rosbags' writer that receives all messages at once."""

    def __init__(self, path: Path, compression: "CompressionMode") -> None:
        del compression  # none is requested
        self.path = path / f"{path.name}.mcap"
        self._file = self.path.open("xb")
        self._channels: list[SchemaAndChannel] = []
        self._mcap = McapColumnWriter(self._file, self._channels, packed=False)

    def add_msgtype(self, connection: "Connection") -> None:
        """Do nothing, since each channel has its own schema."""

    def add_connection(self, connection: "Connection", offered_qos_profiles: str) -> None:
        self._channels.append(
            make_schema_and_channel(
                connection.id,
                connection.topic,
                connection.msgtype,
                connection.msgdef.data,
                {"offered_qos_profiles": offered_qos_profiles},
            )
        )

    def write(self, connection: "Connection", timestamp: int, data: bytes | memoryview) -> None:
        raise NotImplementedError("this writer writes whole topics; call write_topics")

    def write_topics(self, topics: Sequence[RecordedTopic]) -> _MessageCounts:
        self._mcap.write_all_messages(topics)
        made = self._mcap.statistics
        counts = made.channel_message_counts
        return _MessageCounts(counts, made.message_start_time, made.message_end_time)

    def close(self, version: int, metadata: str) -> None:
        del version  # the text has it
        self._mcap.write_summary_and_close([Metadata("rosbag2", {"serialized_metadata": metadata})])
        self._file.close()

    def abort(self) -> None:
        self._file.close()


class _Database(Sqlite3Writer):
    """Database of rosbags that receives all messages at once."""

    def write_topics(self, topics: Sequence[RecordedTopic]) -> _MessageCounts:
        self.conn.executemany(
            "INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)",
            _iter_messages_of_topics(topics),
        )
        times = [topic.log_time_ns for topic in topics if topic.log_time_ns.size]
        return _MessageCounts(
            {topic.connection: topic.log_time_ns.size for topic in topics},
            min((int(each[0]) for each in times), default=0),
            max((int(each[-1]) for each in times), default=0),
        )


def _iter_messages_of_topics(
    topics: Sequence[RecordedTopic],
) -> Iterator[tuple[int, int, memoryview]]:
    for block in iter_records_in_time_order(topics):
        data = memoryview(block.data.data)
        starts = np.concatenate([[0], block.ends[:-1]]).tolist()
        parts = zip(starts, block.ends.tolist(), strict=True)
        numbers, times = block.connections.tolist(), block.log_times.tolist()
        for number, time_ns, (start, end) in zip(numbers, times, parts, strict=True):
            yield number, time_ns, data[start:end]


class _ColumnWriter(Writer):
    """Writer of rosbags for the directory and its metadata.yaml."""

    STORAGE_PLUGINS = {  # noqa: RUF012 - as the class that it extends
        StoragePlugin.MCAP: _Storage,
        StoragePlugin.SQLITE3: _Database,
    }

    def write_topics(self, topics: Sequence[RecordedTopic]) -> None:
        assert isinstance(self.storage, _Storage | _Database)
        written = self.storage.write_topics(topics)
        self.counts.update(written.counts)
        if any(written.counts.values()):
            self.min_timestamp, self.max_timestamp = written.start_ns, written.end_ns
