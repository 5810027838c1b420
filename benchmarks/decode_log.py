"""The log that `decode.py` reads, in every container: what a loader's recorder writes in an hour.

Six topics at 100 Hz with headers, a type of the loader's own at 20 Hz, NavSatFix at 10 Hz. Values
have the noise of float sensors, which compresses badly; covariances are constant. Topics are late
by delays of their own, and one message in 500 by a step more: the order is slightly off.
"""

from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.interfaces import Nodetype
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

#: What a loader's own topic looks like: numbers, a state, text, lists of both.
CUSTOM: Final = """std_msgs/Header header
string mode
bool bucket_raised
uint8 gear
int32 engine_rpm
float32[4] tyre_pressure
float64 boom_angle
float64[] cylinder_pressure
string[] warnings
"""
CUSTOM_TYPE: Final = "loader_msgs/msg/State"
#: Type and rate in Hz.
TOPICS: Final = {
    "/imu": ("sensor_msgs/msg/Imu", 100),
    "/odom": ("nav_msgs/msg/Odometry", 100),
    "/joint_states": ("sensor_msgs/msg/JointState", 100),
    "/cmd_vel": ("geometry_msgs/msg/TwistStamped", 100),
    "/arm/wrench": ("geometry_msgs/msg/WrenchStamped", 100),
    "/arm/pose": ("geometry_msgs/msg/PoseStamped", 100),
    "/loader/state": (CUSTOM_TYPE, 20),
    "/fix": ("sensor_msgs/msg/NavSatFix", 10),
}
#: What `run` needs of it: wheels, torques, acceleration.
RUN_FIELDS: Final = {
    "/joint_states": [f"{what}[{side}]" for what in ("velocity", "effort") for side in "ab"],
    "/imu": ["linear_acceleration.x", "angular_velocity.z"],
}
_JOINTS: Final = ["a", "b"]
_BODIES: Final = 3000
_STRAGGLER: Final = 500
_BEGIN_S: Final = 1_700_000_000
_STEPS_HZ: Final = 100


@cache
def store(*, ros1: bool) -> Typestore:
    """The types, with the loader's own."""
    found = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    found.register(get_types_from_msg(CUSTOM, CUSTOM_TYPE))
    return found


def value(types: Typestore, name: str, rng: np.random.Generator) -> Any:
    """A message of a type, its numbers noise."""
    fields = {f: _field(types, f, what, rng) for f, what in types.fielddefs[name][1]}
    return types.types[name](**fields)


def _field(types: Typestore, field: str, description: Any, rng: np.random.Generator) -> Any:
    node, detail = description
    if node == Nodetype.NAME:
        return value(types, detail, rng)
    if node == Nodetype.BASE:
        return "base_link" if detail[0] == "string" else _numbers(detail[0], 1, rng)[0].item()
    element, length = detail
    count = length if node == Nodetype.ARRAY else 2
    if element[0] == Nodetype.BASE and element[1][0] != "string":
        numbers = _numbers(element[1][0], count, rng)
        return np.zeros_like(numbers) if "covariance" in field else numbers
    if field == "name":
        return _JOINTS
    return [_field(types, field, element, rng) for _ in range(count)]


def _numbers(kind: str, count: int, rng: np.random.Generator) -> Any:
    dtype = np.dtype(kind if kind not in ("byte", "char") else "uint8")
    if dtype.kind != "f":
        return np.ones(count, dtype)
    return rng.normal(size=count).astype(np.float32).astype(dtype)


def messages(minutes: float, *, ros1: bool) -> Iterator[tuple[str, int, bytes]]:
    """Topic, log time and bytes, in the order in which they were recorded."""
    types, rng = store(ros1=ros1), np.random.default_rng(1)
    serialize = types.serialize_ros1 if ros1 else types.serialize_cdr
    # the stamp follows ROS 1's sequence number, or CDR's encapsulation
    bodies = {
        topic: [
            bytes(serialize(value(types, kind, rng), kind)) for _ in range(_BODIES * rate // 100)
        ]
        for topic, (kind, rate) in TOPICS.items()
    }
    delays_ns = {topic: int(rng.uniform(0, 2e7)) for topic in TOPICS}
    for step in range(round(minutes * 60 * _STEPS_HZ)):
        for topic, (_, rate) in TOPICS.items():
            number, rest = divmod(step * rate, _STEPS_HZ)
            if rest:
                continue
            second, part = divmod(step, _STEPS_HZ)
            stamp = np.array([_BEGIN_S + second, part * 10**7], "<u4").tobytes()
            body = bodies[topic][number % len(bodies[topic])]
            late_ns = delays_ns[topic] + (12_000_000 if number % _STRAGGLER == 0 else 0)
            time = (_BEGIN_S + second) * 10**9 + part * 10**7 + late_ns
            yield topic, time, body[:4] + stamp + body[12:]


def write_mcap(path: Path, minutes: float, compression: CompressionType) -> None:
    """Chunks, indexes and CRCs as the official writer makes them."""
    types = store(ros1=False)
    with path.open("wb") as file:
        writer = McapWriter(file, compression=compression)
        writer.start("ros2")
        keys: dict[str, int] = {}
        for topic, (name, _) in TOPICS.items():
            text = types.generate_msgdef(name, ros_version=2)[0].encode()
            schema = writer.register_schema(name, "ros2msg", text)
            keys[topic] = writer.register_channel(topic, "cdr", schema)
        for topic, time, data in messages(minutes, ros1=False):
            writer.add_message(keys[topic], time, data, time)
        writer.finish()


def write_bag(path: Path, minutes: float, compression: Any) -> None:
    """ROS 1."""
    writer = Writer1(path)
    if compression is not None:
        writer.set_compression(compression)
    with writer:
        keys = {
            topic: writer.add_connection(topic, name, typestore=store(ros1=True))
            for topic, (name, _) in TOPICS.items()
        }
        for topic, time, data in messages(minutes, ros1=True):
            writer.write(keys[topic], time, data)


def write_db3(path: Path, minutes: float) -> None:
    """rosbag2's SQLite storage, a directory."""
    with Writer2(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        keys = {
            topic: writer.add_connection(topic, name, typestore=store(ros1=False))
            for topic, (name, _) in TOPICS.items()
        }
        for topic, time, data in messages(minutes, ros1=False):
            writer.write(keys[topic], time, data)
