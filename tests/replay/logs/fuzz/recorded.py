"""What the logs of the campaign hold: messages of every kind that a reader takes apart."""

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from random import Random
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from tests.replay.logs.decoding.test_decoder import LONG_DOUBLE
from tests.replay.logs.test_self_described import MESSAGES, SCHEMA, descriptors, protobuf_messages

START_NS = 1_700_000_000_000_000_000
STEP_NS = 50_000_000
STEPS = 60

WHEELS, STATE, CONTACT = "own_msgs/msg/Wheels", "own_msgs/msg/State", "own_msgs/msg/Contact"
DEFINITIONS = {
    CONTACT: "string surface\nfloat32 slip\nfloat64[2] force\n",
    WHEELS: "std_msgs/Header header\nstring[] name\nfloat64[] effort\n"
    "own_msgs/Contact[] contacts\n",
    STATE: "int64 count\nfloat64 speed\nfloat32[3] acceleration\nbool on\nuint8 gear\n",
}


@dataclass(frozen=True)
class Recorded:
    """One message as it is stored, and what its topic's connection says."""

    topic: str
    log_time_ns: int
    data: bytes
    type: str
    encoding: str
    definition: bytes
    definition_format: str


@cache
def store(*, ros1: bool) -> Typestore:
    """A release with the types of this campaign."""
    made = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    for name, text in DEFINITIONS.items():
        made.register(get_types_from_msg(text, name))
    return made


@cache
def ros(*, ros1: bool) -> tuple[Recorded, ...]:
    """Fixed messages, strings, and lists of messages."""
    return tuple(_ros(Random(7), ros1=ros1))


@cache
def every_encoding() -> tuple[Recorded, ...]:
    """What MCAP can hold besides: ROS 1, JSON, protobuf, and a type that rosbags decodes."""
    recorded = [*ros(ros1=False), *_self_described(), *_long_doubles()]
    recorded += [
        Recorded("/ros1", r.log_time_ns, r.data, r.type, r.encoding, r.definition, "ros1msg")
        for r in ros(ros1=True)
        if r.topic == "/wheels"
    ]
    return tuple(sorted(recorded, key=lambda each: each.log_time_ns))


def _ros(rng: Random, *, ros1: bool) -> Iterator[Recorded]:
    types = store(ros1=ros1)
    for step in range(STEPS):
        t = step * STEP_NS / 1e9
        push = math.sin(3 * t)
        yield _serialized("/wheels", step, _wheels(types, step, push, rng, ros1=ros1), ros1=ros1)
        acceleration = np.array([push, 0, 9.81], np.float32)
        state = types.types[STATE](step, 1 - math.cos(3 * t), acceleration, step % 2 == 0, 200)
        yield _serialized("/state", step, state, ros1=ros1)
        if step % 3 == 0:
            text = types.types["std_msgs/msg/String"](rng.choice(("", "Größe", "dig " * 9)))
            yield _serialized("/text", step, text, ros1=ros1)


def _wheels(types: Typestore, step: int, push: float, rng: Random, *, ros1: bool) -> Any:
    stamp_ns = START_NS + step * STEP_NS
    stamp = types.types["builtin_interfaces/msg/Time"](stamp_ns // 10**9, stamp_ns % 10**9)
    number = {"seq": step} if ros1 else {}
    header = types.types["std_msgs/msg/Header"](**number, stamp=stamp, frame_id="base")
    contacts = [
        types.types[CONTACT](rng.choice(("mud", "asphalt")), rng.random(), np.array([push, 1.0]))
        for _ in range(rng.randrange(3))
    ]
    effort = np.array([900 * push + rng.gauss(0, 3), 900 * push])
    return types.types[WHEELS](header, ["left", "right"], effort, contacts)


def _serialized(topic: str, step: int, message: Any, *, ros1: bool) -> Recorded:
    types, name = store(ros1=ros1), message.__msgtype__
    serialize = types.serialize_ros1 if ros1 else types.serialize_cdr
    text, _ = types.generate_msgdef(name, ros_version=1 if ros1 else 2)
    return Recorded(
        topic,
        START_NS + step * STEP_NS,
        bytes(serialize(message, name)),
        name,
        "ros1" if ros1 else "cdr",
        text.encode(),
        "ros1msg" if ros1 else "ros2msg",
    )


def _self_described() -> Iterator[Recorded]:
    schema, protobuf = json.dumps(SCHEMA).encode(), descriptors().SerializeToString()
    drives = [json.dumps(message).encode() for message in MESSAGES]
    for step in range(0, STEPS, 4):
        time = START_NS + step * STEP_NS
        for data in drives:
            yield Recorded("/json", time, data, "Drive", "json", schema, "jsonschema")
        for data in protobuf_messages():
            yield Recorded("/proto", time, data, "own.Drive", "protobuf", protobuf, "protobuf")


def _long_doubles() -> Iterator[Recorded]:
    if np.finfo(np.longdouble).nmant != 63:  # rosbags reads them as the machine's own
        return
    # 1.5 and -2.5, with the unused bytes empty, so that each file is the same every time
    numbers = bytes.fromhex(f"{'00' * 7}c0ff3f{'00' * 6}{'00' * 7}a000c0{'00' * 6}")
    idl = LONG_DOUBLE.encode()
    for step in range(0, STEPS, 6):
        data = b"\0\1\0\0" + numbers + bytes([step])
        time = START_NS + step * STEP_NS
        yield Recorded("/long", time, data, "t/msg/A", "cdr", idl, "ros2idl")
