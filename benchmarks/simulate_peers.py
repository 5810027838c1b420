"""Simulated logs written as a user would: an object a message, with rosbags' and mcap's writers."""

from collections.abc import Iterator
from itertools import repeat
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import Writer as McapWriter
from rosbags.interfaces import Nodetype
from rosbags.rosbag1 import Writer as BagWriter
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as DirectoryWriter
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from analysis.simulation import SimulatedLog
from replay.logs.writers.ros_messages import TOPICS, make_message_columns


def serialised(
    log: SimulatedLog, store: Typestore, *, ros1: bool
) -> Iterator[tuple[int, str, Any]]:
    """Log time, topic's key and bytes of every message, in order."""
    serialize = store.serialize_ros1 if ros1 else store.serialize_cdr
    rows: list[tuple[int, str, Any]] = []
    for name, frame in log.topics.items():
        column = make_message_columns(name, frame, log.scenario)
        made = _objects(store, TOPICS[name].msgtype, column)
        rows += zip(frame["log_time_ns"], repeat(name), made, strict=False)
    rows.sort(key=lambda row: row[0])
    for time_ns, name, message in rows:
        yield time_ns, name, serialize(message, TOPICS[name].msgtype)


def _objects(store: Typestore, name: str, column: Any) -> Iterator[Any]:
    """Messages of a type, without end where all are the same."""
    fields = [
        _values(store, description, None if column is None else column.get(field))
        for field, description in store.fielddefs[name][1]
    ]
    return map(store.types[name], *fields)


def _values(store: Typestore, description: Any, column: Any) -> Iterator[Any]:
    node, detail = description
    if node == Nodetype.NAME:
        return _objects(store, detail, column)
    if isinstance(column, np.ndarray):
        return iter(np.ascontiguousarray(column) if column.ndim == 2 else column.tolist())
    if node == Nodetype.BASE:
        return repeat(column if column is not None else "" if detail[0] == "string" else 0)
    return repeat(np.zeros(detail[1]) if column is None else list(column))


def write_bag(log: SimulatedLog, path: Path) -> None:
    """With rosbags, ROS 1."""
    store = get_typestore(Stores.ROS1_NOETIC)
    with BagWriter(path) as bag:
        keys = {
            name: bag.add_connection(TOPICS[name].name, TOPICS[name].msgtype, typestore=store)
            for name in log.topics
        }
        for time_ns, name, data in serialised(log, store, ros1=True):
            bag.write(keys[name], time_ns, data)


def write_mcap(log: SimulatedLog, path: Path) -> None:
    """With mcap."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    with path.open("xb") as file:
        writer = McapWriter(file)
        writer.start(profile="ros2", library="payscope")
        keys: dict[str, int] = {}
        for name in log.topics:
            kind = TOPICS[name].msgtype
            definition, _ = store.generate_msgdef(kind, ros_version=2)
            schema = writer.register_schema(kind, "ros2msg", definition.encode())
            keys[name] = writer.register_channel(TOPICS[name].name, "cdr", schema)
        for time_ns, name, data in serialised(log, store, ros1=False):
            writer.add_message(keys[name], time_ns, bytes(data), time_ns)
        writer.finish()


def write_directory(log: SimulatedLog, path: Path) -> None:
    """With rosbags, ROS 2 in MCAP storage."""
    _write_directory(log, path, StoragePlugin.MCAP)


def write_database(log: SimulatedLog, path: Path) -> None:
    """With rosbags, ROS 2 in a database, in its directory."""
    _write_directory(log, path, StoragePlugin.SQLITE3)


def _write_directory(log: SimulatedLog, path: Path, plugin: StoragePlugin) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    version = DirectoryWriter.VERSION_LATEST
    with DirectoryWriter(path, version=version, storage_plugin=plugin) as bag:
        keys = {
            name: bag.add_connection(TOPICS[name].name, TOPICS[name].msgtype, typestore=store)
            for name in log.topics
        }
        for time_ns, name, data in serialised(log, store, ros1=False):
            bag.write(keys[name], time_ns, data)
