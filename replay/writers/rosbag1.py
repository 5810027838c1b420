"""ROS 1 bags."""

from pathlib import Path

from analysis.simulation import SimulatedLog
from replay.writers.messages import TOPICS, messages


def write(log: SimulatedLog, path: Path) -> None:
    """Write `log` as a ROS 1 bag at `path`, where nothing is yet."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    typestore = get_typestore(Stores.ROS1_NOETIC)
    with Writer(path) as bag:
        connections = {
            name: bag.add_connection(topic.name, topic.msgtype, typestore=typestore)
            for name, topic in TOPICS.items()
        }
        for message in messages(log, typestore, ros1=True):
            bag.write(connections[message.frame], message.log_time_ns, message.data)
