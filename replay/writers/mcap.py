"""Single MCAP files with ROS 2 messages, compressed and with checksums."""

from pathlib import Path

from analysis.simulation import SimulatedLog
from replay.writers.messages import TOPICS, messages


def write(log: SimulatedLog, path: Path) -> None:
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
