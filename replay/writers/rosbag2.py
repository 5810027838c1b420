"""rosbag2 directories, with MCAP inside."""

from pathlib import Path

from analysis.simulation import SimulatedLog
from replay.writers.messages import TOPICS, messages


def write(log: SimulatedLog, path: Path) -> None:
    """Write `log` as a rosbag2 directory `path`, where nothing is yet."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    typestore = get_typestore(Stores.ROS2_HUMBLE)
    with Writer(path, version=Writer.VERSION_LATEST, storage_plugin=StoragePlugin.MCAP) as bag:
        connections = {
            name: bag.add_connection(topic.name, topic.msgtype, typestore=typestore)
            for name, topic in TOPICS.items()
        }
        for message in messages(log, typestore, ros1=False):
            bag.write(connections[message.frame], message.log_time_ns, message.data)
