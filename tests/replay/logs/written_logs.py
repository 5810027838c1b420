"""Small logs, written with the writers of rosbags and mcap."""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

ROS1 = get_typestore(Stores.ROS1_NOETIC)
ROS2 = get_typestore(Stores.ROS2_HUMBLE)
JOINT_STATE = "sensor_msgs/msg/JointState"


@dataclass(frozen=True)
class Joints:
    """One JointState message, with the stamp of its header and the time of its recording."""

    log_time_ns: int
    effort: dict[str, float] = field(default_factory=dict)
    topic: str = "/joints"
    stamp_ns: int = 0

    def message(self, store: Typestore) -> Any:
        seconds, nanoseconds = divmod(self.stamp_ns, 10**9)
        stamp = store.types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)
        header = store.types["std_msgs/msg/Header"]
        number = {"seq": 0} if store is ROS1 else {}
        return store.types[JOINT_STATE](
            header=header(**number, stamp=stamp, frame_id="base"),
            name=list(self.effort),
            position=np.array([]),
            velocity=np.array([]),
            effort=np.array(list(self.effort.values())),
        )


def write_bag(
    path: Path,
    recorded: Sequence[Joints],
    compression: Writer1.CompressionFormat | None = None,
    chunk_bytes: int | None = None,
) -> None:
    writer = Writer1(path)
    if compression is not None:
        writer.set_compression(compression)
    if chunk_bytes is not None:
        writer.chunk_threshold = chunk_bytes
    with writer:
        connections = {
            topic: writer.add_connection(topic, JOINT_STATE, typestore=ROS1)
            for topic in dict.fromkeys(r.topic for r in recorded)
        }
        for r in recorded:
            data = ROS1.serialize_ros1(r.message(ROS1), JOINT_STATE)
            writer.write(connections[r.topic], r.log_time_ns, data)


def write_rosbag2(
    path: Path, recorded: Sequence[Joints], storage: StoragePlugin, **compression: Any
) -> None:
    writer = Writer2(path, version=9, storage_plugin=storage)
    if compression:
        writer.set_compression(**compression)
    with writer:
        connections = {
            topic: writer.add_connection(topic, JOINT_STATE, typestore=ROS2)
            for topic in dict.fromkeys(r.topic for r in recorded)
        }
        for r in recorded:
            data = ROS2.serialize_cdr(r.message(ROS2), JOINT_STATE)
            writer.write(connections[r.topic], r.log_time_ns, data)


def write_db3(path: Path, recorded: Sequence[Joints]) -> None:
    folder = path.with_suffix("")
    write_rosbag2(folder, recorded, StoragePlugin.SQLITE3)
    shutil.move(folder / f"{folder.name}.db3", path)
    shutil.rmtree(folder)


def write_mcap(
    path: Path, recorded: Sequence[Joints], *, ros1: bool = False, **options: Any
) -> None:
    store = ROS1 if ros1 else ROS2
    text = store.generate_msgdef(JOINT_STATE, ros_version=1 if ros1 else 2)[0]
    with path.open("wb") as file:
        writer = McapWriter(file, **options)
        writer.start(profile="ros1" if ros1 else "ros2", library="test")
        schema = writer.register_schema(
            "sensor_msgs/JointState" if ros1 else JOINT_STATE,
            "ros1msg" if ros1 else "ros2msg",
            text.encode(),
        )
        channels = {
            topic: writer.register_channel(topic, "ros1" if ros1 else "cdr", schema)
            for topic in dict.fromkeys(r.topic for r in recorded)
        }
        serialize = ROS1.serialize_ros1 if ros1 else ROS2.serialize_cdr
        for r in recorded:
            data = bytes(serialize(r.message(store), JOINT_STATE))
            writer.add_message(channels[r.topic], r.log_time_ns, data, r.log_time_ns)
        writer.finish()
