"""Logs of our own making, laid out and named like those of others in `shared/data`.

    python -m tests.own_logs FOLDER

A linear axis with dry friction and a skid-steer with unsigned currents, as tables, bags and rosbag2
directories; and bags of random messages in each container. The same bytes every time.
"""

import shutil
import sqlite3
import sys
from collections.abc import Iterable, Iterator
from contextlib import closing
from itertools import product
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import polars as pl
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from tests.replay.logs.decoding.random_types import random_message

ROS1 = get_typestore(Stores.ROS1_NOETIC)
ROS2 = get_typestore(Stores.ROS2_HUMBLE)
START_NS = 1_700_000_000_000_000_000
JOINTS = "sensor_msgs/msg/JointState"
IMU = "sensor_msgs/msg/Imu"
#: Of the bags of random messages: topic, type and how many.
TOPICS = (
    ("/imu", IMU, 20),
    ("/pose", "geometry_msgs/msg/PoseStamped", 15),
    ("/gps", "sensor_msgs/msg/NavSatFix", 10),
    ("/joints", JOINTS, 20),
    ("chatter", "std_msgs/msg/String", 10),
)

#: topic, type, log time in ns, message
Stored = tuple[str, str, int, Any]


def make(folder: Path) -> Path:
    """Write every log into `folder`/logs and `folder`/bags."""
    logs, bags = folder / "logs", folder / "bags"
    for each in (logs, bags):
        each.mkdir(parents=True)
    axis = linear_axis()
    axis.write_csv(logs / "linear_axis.csv")
    _bag(logs / "linear_axis.bag", axis_messages(axis, ROS1), Writer1.CompressionFormat.LZ4)
    _rosbag2(logs / "linear_axis_ros2", axis_messages(axis, ROS2))
    _bag(logs / "husky_asphalt.bag", skid_steer(ROS1))
    _rosbag2(logs / "husky_asphalt_ros2", skid_steer(ROS2))
    _bag(bags / "plain.bag", strangers(ROS1, "plain"))
    _bag(bags / "lz4.bag", strangers(ROS1, "lz4"), Writer1.CompressionFormat.LZ4)
    _bag(bags / "bz2.bag", strangers(ROS1, "bz2"), Writer1.CompressionFormat.BZ2)
    _bag(bags / "unsorted-chunks.bag", reversed(list(strangers(ROS1, "unsorted"))))
    _bag(bags / "since-boot.bag", strangers(ROS1, "boot", start_ns=47_580_000_000))
    whole = (bags / "plain.bag").read_bytes()
    # ten bytes of its third chunk are missing: what follows lies where no index says
    (bags / "torn.bag").write_bytes(whole[:14_000] + whole[14_010:])
    _bag(bags / "no-messages.bag", [])
    (bags / "empty-file.bag").touch()
    _mcap(bags / "zstd.mcap", strangers(ROS2, "zstd"))
    _mcap(bags / "data-crc.mcap", strangers(ROS2, "crc"), enable_data_crcs=True)
    _mcap(bags / "lz4.mcap", strangers(ROS2, "lz4"), compression=CompressionType.LZ4)
    _mcap(bags / "plain.mcap", strangers(ROS2, "plain"), compression=CompressionType.NONE)
    _mcap(bags / "unchunked.mcap", strangers(ROS2, "unchunked"), use_chunking=False)
    _mcap(
        bags / "no-index.mcap",
        strangers(ROS2, "no index"),
        index_types=IndexType.NONE,
        use_statistics=False,
    )
    whole = (bags / "zstd.mcap").read_bytes()
    (bags / "torn.mcap").write_bytes(whole[: len(whole) * 2 // 3])
    _services(bags / "topics_and_services.mcap")
    _conformance(folder / "mcap_conformance")
    _db3(bags / "with-definitions.db3", strangers(ROS2, "db3"))
    _db3(bags / "without-definitions.db3", strangers(ROS2, "old"))
    with closing(sqlite3.connect(bags / "without-definitions.db3")) as database:
        database.execute("DROP TABLE message_definitions")
    _placeholders(bags / "talker.db3")
    return folder


def linear_axis(seconds: float = 24.0, rate_hz: float = 500.0) -> pl.DataFrame:
    """A sledge driven to and fro: 95.11 kg, 203.5 N·s/m, 20.4 N, at a drive offset of -3.2 N.

    Six seconds of quick strokes, six of slower ones with a rest, and so on; no two as fast.
    """
    rng = np.random.default_rng(15)
    t = np.arange(round(seconds * rate_hz)) / rate_hz
    quick = t % 12.0 < 6.0
    stroke, since = np.divmod(t, np.where(quick, 0.65, 1.2))
    moving, ramp = np.where(quick, 0.6, 1.0), np.where(quick, 0.28, 0.3)
    top = np.where(quick, 0.25, 0.1) + 0.1 * rng.random(int(stroke.max()) + 1)[stroke.astype(int)]
    top = np.where(stroke % 2 == 0, top, -top)
    rising = np.clip(np.minimum(since, moving - since) / ramp, 0.0, 1.0)
    speed = top * (0.5 - 0.5 * np.cos(np.pi * rising))
    acc = np.gradient(speed, 1.0 / rate_hz)
    position = np.cumsum(speed) / rate_hz
    force = 95.11 * acc + 203.5 * speed + 20.4 * np.sign(speed) - 3.2
    ripple = _lagging(rng.normal(0.0, 20.0, t.size), 0.05)
    return pl.DataFrame(
        {
            "time_s": t,
            "position_m": np.round(position, 6),
            "force_N": np.round(force + ripple, 4),
        }
    )


def axis_messages(table: pl.DataFrame, store: Typestore) -> Iterator[Stored]:
    """The table as JointState messages of one joint."""
    for time_s, position, force in table.iter_rows():
        time_ns = START_NS + round(time_s * 1e9)
        values = {"position": np.array([position]), "effort": np.array([force])}
        yield "/axis", JOINTS, time_ns, _joints(store, time_ns, ["slide"], **values)


def skid_steer(store: Typestore, seconds: float = 52.0) -> Iterator[Stored]:
    """Currents without a sign at 6.5 Hz, an IMU that shows a tenth of the motion at 100 Hz.

    It starts, drives arcs, creeps while it turns, and brakes, never in reverse. Its currents follow
    the resistance to turning and the ground, hardly the mass.
    """
    rng = np.random.default_rng(5)
    t = np.arange(round(seconds * 100.0)) / 100.0
    stage = (t // 4.0).astype(int)
    tops = np.array([0.0, 0.9, 0.8, 0.15, 0.2, 0.7, 0.9, 0.1, 0.8, 0.6, 0.15, 0.8, 0.0])
    turns = np.array([0.0, 0.0, 0.5, 0.6, -0.7, 0.0, -0.4, 0.8, 0.0, 0.5, -0.6, 0.3, 0.0])
    speed, yaw_rate = (_lagging(wanted[stage], 0.35) for wanted in (tops, turns))
    acc = np.gradient(speed, 0.01)
    shaken = 0.4 * rng.normal(size=t.size) * (np.abs(speed) > 0.05)
    header = store.types["std_msgs/msg/Header"]
    types = store.types
    vector, quaternion = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"]
    unknown = np.zeros(9)
    current = 2.0 + 6.0 * np.abs(yaw_rate) + 3.0 * np.abs(speed) + _lagging(8.0 * shaken, 0.3)
    due = 0.0
    for k in range(t.size):
        if t[k] >= due:
            time_ns = START_NS + round(due * 1e9)
            due += 1.0 / 6.5
            sides = np.array([-0.2725, 0.2725]) * yaw_rate[k]
            values = {
                "velocity": speed[k] + sides + 0.01 * rng.normal(size=2),
                "effort": np.abs(current[k] + rng.normal(size=2)),
            }
            yield "/drives", JOINTS, time_ns, _joints(store, time_ns, ["left", "right"], **values)
        time_ns = START_NS + round(t[k] * 1e9)
        imu = types[IMU](
            header=header(**_sequence(store), stamp=_stamp(store, time_ns), frame_id="imu"),
            orientation=quaternion(x=0.0, y=0.0, z=0.0, w=1.0),
            orientation_covariance=unknown,
            angular_velocity=vector(x=0.0, y=0.0, z=yaw_rate[k] + 0.01 * rng.normal()),
            angular_velocity_covariance=unknown,
            linear_acceleration=vector(x=0.1 * acc[k] + shaken[k], y=0.0, z=9.81),
            linear_acceleration_covariance=unknown,
        )
        yield "/imu/data", IMU, time_ns, imu


def _lagging(wanted: np.ndarray, lag_s: float) -> np.ndarray:
    out = np.empty(wanted.size)
    now = wanted[0]
    for k in range(wanted.size):
        now += (wanted[k] - now) * 0.01 / lag_s
        out[k] = now
    return out


def strangers(store: Typestore, seed: str, start_ns: int = START_NS) -> Iterator[Stored]:
    """Random messages of several types, one every 10 ms in turn."""
    rng = Random(seed)
    turns = [(topic, kind) for topic, kind, count in TOPICS for _ in range(count)]
    rng.shuffle(turns)
    for k, (topic, kind) in enumerate(turns):
        time_ns = start_ns + k * 10_000_000
        message = random_message(store, kind, rng)
        if hasattr(message, "header"):
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(time_ns, 10**9)
        yield topic, kind, time_ns, message


def _sequence(store: Typestore) -> dict[str, int]:
    return {"seq": 0} if store is ROS1 else {}


def _stamp(store: Typestore, time_ns: int) -> Any:
    seconds, nanoseconds = divmod(time_ns, 10**9)
    return store.types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)


def _joints(store: Typestore, time_ns: int, names: list[str], **values: np.ndarray) -> Any:
    header = store.types["std_msgs/msg/Header"]
    none = np.array([])
    return store.types[JOINTS](
        header=header(**_sequence(store), stamp=_stamp(store, time_ns), frame_id="base"),
        name=names,
        **{field: values.get(field, none) for field in ("position", "velocity", "effort")},
    )


def _bag(
    path: Path, stored: Iterable[Stored], compression: Writer1.CompressionFormat | None = None
) -> None:
    writer = Writer1(path)
    if compression is not None:
        writer.set_compression(compression)
    if path.parent.name == "bags":
        writer.chunk_threshold = 4000
    with writer:
        connections: dict[str, Any] = {}
        for topic, kind, time_ns, message in stored:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=ROS1)
            writer.write(connections[topic], time_ns, ROS1.serialize_ros1(message, kind))


def _rosbag2(
    path: Path, stored: Iterable[Stored], storage: StoragePlugin = StoragePlugin.MCAP
) -> None:
    with Writer2(path, version=9, storage_plugin=storage) as writer:
        connections: dict[str, Any] = {}
        for topic, kind, time_ns, message in stored:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=ROS2)
            writer.write(connections[topic], time_ns, ROS2.serialize_cdr(message, kind))


def _db3(path: Path, stored: Iterable[Stored]) -> None:
    """The one file of a rosbag2 directory."""
    folder = path.with_suffix("")
    _rosbag2(folder, stored, StoragePlugin.SQLITE3)
    shutil.move(folder / f"{folder.name}.db3", path)
    shutil.rmtree(folder)


def _placeholders(path: Path) -> None:
    """As converted from a release without definitions: one holds a type's first field alone."""
    log, text = "rcl_interfaces/msg/Log", "std_msgs/msg/String"
    hello = [ROS2.types[text](data=f"Hello, world! {k}") for k in range(10)]
    _db3(path, [("/topic", text, START_NS + k, message) for k, message in enumerate(hello)])
    with closing(sqlite3.connect(path)) as database, database:
        database.execute(
            "INSERT INTO topics SELECT 2, '/rosout', ?, serialization_format, offered_qos_profiles,"
            " type_description_hash FROM topics",
            (log,),
        )
        database.execute("INSERT INTO messages SELECT id + 10, 2, timestamp, data FROM messages")
        database.execute(
            "INSERT INTO message_definitions SELECT 2, ?, encoding, 'uint8 level', ''"
            " FROM message_definitions",
            (log,),
        )


def _mcap(path: Path, stored: Iterable[Stored], **options: Any) -> None:
    with path.open("wb") as file:
        writer = McapWriter(file, chunk_size=4000, **options)
        writer.start(profile="ros2", library="test")
        channels: dict[str, int] = {}
        for topic, kind, time_ns, message in stored:
            if topic not in channels:
                text = ROS2.generate_msgdef(kind, ros_version=2)[0].encode()
                schema = writer.register_schema(kind, "ros2msg", text)
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            data = bytes(ROS2.serialize_cdr(message, kind))
            writer.add_message(channels[topic], time_ns, data, time_ns)
        writer.finish()


def _conformance(folder: Path) -> None:
    """A file a way to write nothing, a message or an attachment, as MCAP's own suite has them."""
    folder.mkdir()
    chunked, repeated, statistics = ([True, False] for _ in range(3))
    indexes = [IndexType.ALL, IndexType.NONE, IndexType.CHUNK]
    held = ["nothing", "message", "attachment"]
    ways = product(held, chunked, indexes, repeated, statistics)
    for number, (what, use_chunking, index_types, repeat, use_statistics) in enumerate(ways):
        with (folder / f"{number:02}-{what}.mcap").open("wb") as file:
            writer = McapWriter(
                file,
                use_chunking=use_chunking,
                index_types=index_types,
                repeat_channels=repeat,
                repeat_schemas=repeat,
                use_statistics=use_statistics,
                use_summary_offsets=repeat,
            )
            writer.start()
            if what == "message":
                schema = writer.register_schema("Example", "c", b"\4\5\6")
                channel = writer.register_channel("example", "a", schema, {"foo": "bar"})
                writer.add_message(channel, 2, b"\1\2\3", 1, sequence=10)
            elif what == "attachment":
                writer.add_attachment(2, 1, "myFile", "application/octet-stream", b"\1\2\3")
            writer.finish()


def _services(path: Path) -> None:
    """A topic, and two of service events, whose definition is that of a service."""
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start(profile="ros2", library="test")
        text = ROS2.generate_msgdef("std_msgs/msg/String", ros_version=2)[0].encode()
        good = writer.register_schema("std_msgs/msg/String", "ros2msg", text)
        service = b"int64 a\nint64 b\n---\nint64 sum\n"
        event = writer.register_schema("own/srv/Add_Event", "ros2msg", service)
        topic = writer.register_channel("/parameter_events", "cdr", good)
        called = writer.register_channel("/add_two_ints/_service_event", "cdr", event)
        writer.register_channel("/add_two_ints2/_service_event", "cdr", event)
        for k in range(7):
            message = ROS2.types["std_msgs/msg/String"](data=f"Hello, world! {k}")
            data = bytes(ROS2.serialize_cdr(message, "std_msgs/msg/String"))
            writer.add_message(topic, START_NS + k, data, START_NS + k)
        writer.add_message(called, START_NS + 7, b"\0\1\0\0" + bytes(8), START_NS + 7)
        writer.finish()


if __name__ == "__main__":
    make(Path(sys.argv[1]))
