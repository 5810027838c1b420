"""Columns of messages become the bytes that rosbags gives each of them."""

import os
from collections.abc import Sequence
from random import Random
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from replay.logs.decoding.wire import CDR, ROS1
from replay.logs.writers.message_columns import Column, RaggedColumn
from replay.logs.writers.serialise_messages import SameLayout, serialise_messages
from tests.replay.logs.decoding.random_types import Sample, Types, random_message, types
from tests.twins import mark_heavy_after

TYPES = int(os.environ.get("PAYSCOPE_RANDOM_TYPES", "35"))
RANDOM_TYPES = settings(
    max_examples=TYPES, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True
)
IN_USE = (
    "sensor_msgs/msg/Imu",
    "sensor_msgs/msg/JointState",
    "nav_msgs/msg/Odometry",
    "sensor_msgs/msg/NavSatFix",
    "diagnostic_msgs/msg/DiagnosticArray",
    "std_msgs/msg/Empty",
)


def columns(store: Typestore, name: str, messages: Sequence[Any]) -> dict[str, Column]:
    """Messages by column, each field as it comes."""
    return {
        field: _column(store, description, [getattr(message, field) for message in messages])
        for field, description in store.fielddefs[name][1]
    }


def _column(store: Typestore, description: Any, values: Sequence[Any]) -> Column:
    node, detail = description
    if node == Nodetype.NAME:
        return columns(store, detail, values)
    if node == Nodetype.BASE:
        return (
            RaggedColumn.from_texts(values)
            if detail[0] == "string"
            else np.array(values, _dtype(detail))
        )
    element, _ = detail
    lengths = np.array([len(each) for each in values], np.int64)
    inside = [one for each in values for one in each]
    return RaggedColumn(lengths, _column(store, element, inside))


def _dtype(detail: tuple[str, int]) -> str:
    return {"byte": "int8", "char": "uint8"}.get(detail[0], detail[0])


def messages_of(made: Sequence[SameLayout], count: int) -> list[bytes]:
    """The messages one by one, in order."""
    found = [b""] * count
    for same in made:
        chosen = range(count) if same.chosen is None else same.chosen.tolist()
        for number, row in zip(chosen, same.rows, strict=True):
            found[number] = row.tobytes()
    return found


@pytest.mark.parametrize("encoding", mark_heavy_after(1, ["cdr_le", "ros1"]))
@RANDOM_TYPES
@given(types=types(), seed=st.integers(0, 2**32))
def test_messages_of_a_random_type_are_those_of_rosbags(
    encoding: str, types: Types, seed: int
) -> None:
    sample = Sample(types, encoding, seed)
    wire = ROS1 if sample.ros1 else CDR
    column = columns(sample.store, "t/msg/A", sample.values)
    made = serialise_messages(sample.store, "t/msg/A", column, sample.count, wire)
    assert messages_of(made, sample.count) == sample.stored(encoding)


@pytest.mark.parametrize("name", IN_USE)
@pytest.mark.parametrize("release", [Stores.ROS1_NOETIC, Stores.ROS2_HUMBLE])
def test_messages_of_the_types_in_use_are_those_of_rosbags(release: Stores, name: str) -> None:
    store, rng = get_typestore(release), Random(7)
    ros1 = release is Stores.ROS1_NOETIC
    values = [random_message(store, name, rng) for _ in range(40)]
    serialize = store.serialize_ros1 if ros1 else store.serialize_cdr
    made = serialise_messages(store, name, columns(store, name, values), 40, ROS1 if ros1 else CDR)
    assert messages_of(made, 40) == [bytes(serialize(value, name)) for value in values]


@pytest.mark.parametrize("release", [Stores.ROS1_NOETIC, Stores.ROS2_HUMBLE])
def test_what_all_messages_share_is_said_once_and_what_is_left_out_is_empty(
    release: Stores,
) -> None:
    store = get_typestore(release)
    ros1 = release is Stores.ROS1_NOETIC
    kinds, name = store.types, "sensor_msgs/msg/JointState"
    efforts = np.array([[1.0, 2.0], [3.0, 4.0]])
    column: dict[str, Column] = {
        "header": {"frame_id": "base_link", "stamp": {"sec": np.array([5, 6]), "nanosec": 7}},
        "name": ("left", "right"),
        "effort": efforts,
    }
    made = serialise_messages(store, name, column, 2, ROS1 if ros1 else CDR)
    serialize = store.serialize_ros1 if ros1 else store.serialize_cdr
    expected: list[bytes] = []
    for number in range(2):
        stamp = kinds["builtin_interfaces/msg/Time"](sec=5 + number, nanosec=7)
        seq = {"seq": 0} if ros1 else {}
        header = kinds["std_msgs/msg/Header"](stamp=stamp, frame_id="base_link", **seq)
        none = np.zeros(0)
        message = kinds[name](header, ["left", "right"], none, none, efforts[number])
        expected.append(bytes(serialize(message, name)))
    assert messages_of(made, 2) == expected
    assert len(made) == 1


def test_messages_of_the_same_lengths_are_one_layout() -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    texts = ["a", "bc", "d", "ef", "a"]
    made = serialise_messages(
        store, "std_msgs/msg/String", {"data": RaggedColumn.from_texts(texts)}, 5, CDR
    )
    assert [None if same.chosen is None else same.chosen.tolist() for same in made] == [
        [0, 2, 4],
        [1, 3],
    ]


def test_an_envelope_stands_before_each_message_and_moves_no_alignment() -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    values = np.array([1.5, -2.5])
    plain = serialise_messages(store, "std_msgs/msg/Float64", {"data": values}, 2, CDR)
    times = np.array([10, 20])
    made = serialise_messages(
        store,
        "std_msgs/msg/Float64",
        {"data": values},
        2,
        CDR,
        lambda size: [b"x" * 3, ("<u8", times), bytes([size])],
    )
    for number in range(2):
        before = b"xxx" + int(times[number]).to_bytes(8, "little") + bytes([12])
        assert made[0].rows[number].tobytes() == before + plain[0].rows[number].tobytes()
