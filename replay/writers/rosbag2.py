"""Simulated logs as rosbag2 directories, with MCAP storage."""

from pathlib import Path
from typing import TYPE_CHECKING, Final

from mcap.records import Metadata
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from analysis.simulation import SimulatedLog
from replay.writers.in_order import RecordedTopic
from replay.writers.mcap import ChannelOf, ColumnMcap, channel_of, envelope
from replay.writers.ros_messages import TOPICS, recorded_topics

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.rosbag2.enums import CompressionMode


def write_rosbag2(log: SimulatedLog, path: Path) -> None:
    """Write `log` as a rosbag2 directory `path`, where nothing is yet."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    with _ColumnWriter(path, version=Writer.VERSION_LATEST, storage_plugin=_PLUGIN) as bag:
        numbers = {
            name: bag.add_connection(TOPICS[name].name, TOPICS[name].msgtype, typestore=store).id
            for name in log.topics
        }
        bag.write_topics(recorded_topics(log, store, numbers, envelope, ros1=False))


_PLUGIN: Final = StoragePlugin.MCAP
#: What rosbags' writer calls it.
METADATA: Final = "metadata.yaml"


class _Storage:
    """A storage of rosbags' writer that takes all messages at once."""

    def __init__(self, path: Path, compression: "CompressionMode") -> None:
        del compression  # none is asked for
        self.path = path / f"{path.name}.mcap"
        self._file = self.path.open("xb")
        self._channels: list[ChannelOf] = []
        self._mcap = ColumnMcap(self._file, self._channels, packed=False)

    def add_msgtype(self, connection: "Connection") -> None:
        """Nothing: each channel has a schema of its own."""

    def add_connection(self, connection: "Connection", offered_qos_profiles: str) -> None:
        self._channels.append(
            channel_of(
                connection.id,
                connection.topic,
                connection.msgtype,
                connection.msgdef.data,
                {"offered_qos_profiles": offered_qos_profiles},
            )
        )

    def write(self, connection: "Connection", timestamp: int, data: bytes | memoryview) -> None:
        raise NotImplementedError("messages come by columns")

    def write_topics(self, topics: list[RecordedTopic]) -> ColumnMcap:
        self._mcap.write(topics)
        return self._mcap

    def close(self, version: int, metadata: str) -> None:
        del version  # in the text
        self._mcap.finish([Metadata("rosbag2", {"serialized_metadata": metadata})])
        self._file.close()

    def abort(self) -> None:
        self._file.close()


class _ColumnWriter(Writer):
    """rosbags' writer of the directory and its metadata.yaml."""

    STORAGE_PLUGINS = {_PLUGIN: _Storage}  # noqa: RUF012 - as the class that it extends

    def write_topics(self, topics: list[RecordedTopic]) -> None:
        assert isinstance(self.storage, _Storage)
        written = self.storage.write_topics(topics).statistics
        for number, count in written.channel_message_counts.items():
            self.counts[number] = count
        if written.message_count:
            self.min_timestamp = written.message_start_time
            self.max_timestamp = written.message_end_time
