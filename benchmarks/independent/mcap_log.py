"""Readings as an MCAP file of ROS 2 messages, serialised by columns.

One message of a topic is serialised by rosbags with a number of its own in a field that varies;
where that number lies in the bytes is where the column goes. Chunks are not compressed.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO, Final, NamedTuple

import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, DataEnd, Footer, Header, McapRecord, Schema
from numba import njit
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore

from benchmarks.independent.sensors import Ints, Readings

Bytes = NDArray[np.uint8]

_MAGIC: Final = b"\x89MCAP0\r\n"
#: Messages of one chunk.
_CHUNK_MESSAGES: Final = 20_000
#: What stands before a message: opcode, length, channel, number, times of recording and publishing.
_BEFORE: Final = np.dtype(
    [("op", "u1"), ("size", "<u8"), ("channel", "<u2"), ("number", "<u4"), ("times", "<u8", 2)]
)
#: Bytes of a message record that its length does not count: opcode and length.
_UNCOUNTED: Final = 9
#: Seconds and nanoseconds of the stamp lie behind the four bytes that say how it is serialised.
_STAMP_AT: Final = 4
_STAMP: Final = np.dtype([("sec", "<i4"), ("nanosec", "<u4")])
#: Stands for a value until the column comes: no sensor says it.
_MARK: Final = 1.2345678901234567e123
_NS: Final = 10**9

_STORE: Final = get_typestore(Stores.ROS2_HUMBLE)
_JOINTS: Final = "sensor_msgs/msg/JointState"


class Layout(NamedTuple):
    """How a topic's readings are written.

    Attributes:
        topic: its name.
        msgtype: its ROS 2 type.
        fields: of each reading, the field that has it; an item of a list by its number.
    """

    topic: str
    msgtype: str
    fields: Mapping[str, str]


LAYOUTS: Final = {
    "torques": Layout("/drive/torque", _JOINTS, {"left": "effort.0", "right": "effort.1"}),
    "force": Layout("/drive/force", "geometry_msgs/msg/WrenchStamped", {"force": "wrench.force.x"}),
    "imu": Layout(
        "/imu/raw",
        "sensor_msgs/msg/Imu",
        {
            "x": "linear_acceleration.x",
            "z": "linear_acceleration.z",
            "yaw_rate": "angular_velocity.z",
        },
    ),
    "wheels": Layout("/drive/wheels", _JOINTS, {"left": "velocity.0", "right": "velocity.1"}),
    "speed": Layout("/drive/speed", "geometry_msgs/msg/TwistStamped", {"speed": "twist.linear.x"}),
    "pitch": Layout("/inclinometer", "geometry_msgs/msg/Vector3Stamped", {"angle": "vector.y"}),
    "boom": Layout("/boom", _JOINTS, {"angle": "position.0"}),
}


def layout_of(name: str, readings: Readings) -> Layout:
    """How a topic of `measured` is written: force and speed come in one piece or as two sides."""
    sides = {"force": "torques", "speed": "wheels"}
    return LAYOUTS[sides.get(name, name) if "left" in readings.values else name]


def _zero(kind: tuple[Nodetype, Any], names: list[str]) -> Any:
    """A value of a field's type: numbers zero, lists as long as there are names."""
    node, inner = kind
    if node == Nodetype.NAME:
        fields = _STORE.fielddefs[inner][1]
        return _STORE.types[inner](**{name: _zero(each, names) for name, each in fields})
    if node == Nodetype.BASE:
        return "base" if inner[0] == "string" else 0
    element, count = inner
    if element[1][0] == "string":
        return names
    return np.zeros(count or len(names))


def _set(message: Any, field: str, value: float) -> None:
    *path, last = field.split(".")
    for part in path:
        message = getattr(message, part)
    if last.isdigit():
        message[int(last)] = value
    else:
        object.__setattr__(message, last, value)


def _serialised(layout: Layout, names: list[str], marked: str = "") -> bytes:
    message = _zero((Nodetype.NAME, layout.msgtype), names)
    if marked:
        _set(message, marked, _MARK)
    return bytes(_STORE.serialize_cdr(message, layout.msgtype))


def _messages(number: int, layout: Layout, readings: Readings) -> Bytes:
    """(n, bytes) records of all messages of a topic."""
    names = list(readings.values) if layout.msgtype == _JOINTS else []
    blank = _serialised(layout, names)
    mark = np.float64(_MARK).tobytes()
    count, head = readings.stamp_ns.size, _BEFORE.itemsize
    rows = np.empty((count, head + len(blank)), np.uint8)
    rows[:, head:] = np.frombuffer(blank, np.uint8)
    before = np.zeros(count, _BEFORE)
    before["op"], before["size"] = Opcode.MESSAGE, rows.shape[1] - _UNCOUNTED
    before["channel"], before["number"] = number, np.arange(count)
    before["times"] = readings.log_ns[:, None]
    rows[:, :head] = _as_bytes(before)
    stamps = np.empty(count, _STAMP)
    stamps["sec"], stamps["nanosec"] = readings.stamp_ns // _NS, readings.stamp_ns % _NS
    at = head + _STAMP_AT
    rows[:, at : at + _STAMP.itemsize] = _as_bytes(stamps)
    for name, values in readings.values.items():
        at = head + _serialised(layout, names, layout.fields[name]).index(mark)
        rows[:, at : at + 8] = _as_bytes(values.astype("<f8"))
    return rows


def _as_bytes(column: NDArray[Any]) -> Bytes:
    return column.view(np.uint8).reshape(column.size, column.dtype.itemsize)


@njit(cache=True)
def _scatter(rows: Bytes, offsets: Ints, out: Bytes) -> None:
    for row in range(rows.shape[0]):
        begin = offsets[row]
        for byte in range(rows.shape[1]):
            out[begin + byte] = rows[row, byte]


def _record(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()


def write_mcap(topics: Mapping[str, Readings], path: Path) -> None:
    """Write all messages in the order of their recording.

    Args:
        topics: as `measured` gives them.
        path: of the file, which is replaced.
    """
    layouts = [layout_of(name, readings) for name, readings in topics.items()]
    tables = [
        _messages(number, layout, readings)
        for number, (layout, readings) in enumerate(zip(layouts, topics.values(), strict=True), 1)
    ]
    log_ns = np.concatenate([readings.log_ns for readings in topics.values()])
    sizes = np.repeat([t.shape[1] for t in tables], [t.shape[0] for t in tables])
    order = np.argsort(log_ns, kind="stable")
    ends = np.cumsum(sizes[order])
    offsets = np.empty(order.size, np.int64)
    offsets[order] = ends - sizes[order]
    data, first = np.empty(int(ends[-1]), np.uint8), 0
    for table in tables:
        _scatter(table, offsets[first : first + table.shape[0]], data)
        first += table.shape[0]
    with path.open("wb") as file:
        file.write(_MAGIC + _record(Header("ros2", "independent bench")))
        for number, layout in enumerate(layouts, 1):
            _declare(file, number, layout)
        _write_chunks(file, data, ends, log_ns[order])
        file.write(_record(DataEnd(0)) + _record(Footer(0, 0, 0)) + _MAGIC)


def _declare(file: BinaryIO, number: int, layout: Layout) -> None:
    definition, _ = _STORE.generate_msgdef(layout.msgtype, ros_version=2)
    file.write(_record(Schema(number, definition.encode(), "ros2msg", layout.msgtype)))
    file.write(_record(Channel(number, layout.topic, "cdr", {}, number)))


def _write_chunks(file: BinaryIO, data: Bytes, ends: Ints, log_ns: Ints) -> None:
    for first in range(0, ends.size, _CHUNK_MESSAGES):
        last = min(first + _CHUNK_MESSAGES, ends.size) - 1
        begin = int(ends[first - 1]) if first else 0
        part = data[begin : int(ends[last])]
        span = (int(log_ns[first]), int(log_ns[last]))
        file.write(_record(Chunk("", part.tobytes(), span[1], span[0], 0, part.size)))
