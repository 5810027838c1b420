"""Simulated logs as files: ROS 1 bags, MCAP files, rosbag2 directories and tables."""

from pathlib import Path

import polars as pl

from analysis.simulation import SimulatedLog
from replay.writers.ros_messages import TOPICS, messages


def write_bag(log: SimulatedLog, path: Path) -> None:
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


def write_mcap(log: SimulatedLog, path: Path) -> None:
    """Write `log` as an MCAP file at `path`, where nothing is yet."""
    from mcap.writer import Writer
    from rosbags.typesys import Stores, get_typestore

    typestore = get_typestore(Stores.ROS2_HUMBLE)
    with path.open("xb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="payscope")
        channels: dict[str, int] = {}
        for name, topic in TOPICS.items():
            definition, _ = typestore.generate_msgdef(topic.msgtype, ros_version=2)
            schema = writer.register_schema(topic.msgtype, "ros2msg", definition.encode())
            channels[name] = writer.register_channel(topic.name, "cdr", schema)
        for message in messages(log, typestore, ros1=False):
            time_ns = message.log_time_ns
            writer.add_message(channels[message.frame], time_ns, bytes(message.data), time_ns)
        writer.finish()


def write_rosbag2(log: SimulatedLog, path: Path) -> None:
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


def write_csv(log: SimulatedLog, path: Path) -> None:
    """Write `log` as CSV at `path`, where nothing is yet.

    `time_s` counts from the start of the campaign, so that the tables of all loads make one time
    line and every time is exact to the nanosecond, which unix seconds in a double are not. The
    other columns are the machine file's channels, numbers written so that they read back exactly.
    """
    topics = (frame.drop("log_time_ns") for frame in log.topics.values())
    table = next(topics)
    for topic in topics:
        table = table.join(topic, on="header_stamp_ns", how="full", coalesce=True)
    time_s = (pl.col("header_stamp_ns") - log.origin_unix_ns) / 1e9
    table.sort("header_stamp_ns").select(
        time_s.alias("time_s"), pl.exclude("header_stamp_ns")
    ).write_csv(path)
