"""Logs of our own and of others, against rosbags' AnyReader, which decodes whole files."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from estimators.errors import LogError
from replay import open_log
from replay.logs import Log
from replay.logs.bag.bag_file import BagFile
from replay.logs.decoding.decoder_choice import PerMessageDecoder
from replay.logs.mcap.mcap_file import McapFile
from replay.logs.message_log import MessageLog
from replay.logs.messages.message_fields import resolve_message_field
from replay.logs.messages.raw_batch import make_batch_of_messages
from replay.logs.rosbag2.rosbag2_directory import Rosbag2Directory
from replay.logs.sqlite.sqlite_file import Db3File
from tests.conftest import WHOSE
from tests.one_line import assert_one_line
from tests.replay.logs.decoding.random_types import every_field
from tests.replay.logs.decoding.test_equality import same

CONTAINERS = {".bag": BagFile, ".db3": Db3File, ".mcap": McapFile, "": Rosbag2Directory}

#: Files that AnyReader reads as a whole, each with a topic and fields to compare: our own,
OWN = {
    "bags/plain.bag": ("/gps", ["header.seq", "status.status"]),
    "bags/lz4.bag": ("/joints", ["header.seq", "header.frame_id"]),
    "bags/bz2.bag": ("chatter", ["data"]),
    "bags/unsorted-chunks.bag": ("chatter", ["data"]),
    "bags/since-boot.bag": ("/imu", ["header.seq"]),
    "bags/zstd.mcap": ("/gps", ["status.service", "position_covariance_type"]),
    "bags/lz4.mcap": ("/joints", ["header.frame_id"]),
    "bags/plain.mcap": ("chatter", ["data"]),
    "bags/with-definitions.db3": ("chatter", ["data"]),
    "logs/husky_asphalt.bag": ("/drives", ["effort[0]", "effort[1]"]),
    "logs/husky_asphalt_ros2": ("/imu/data", ["linear_acceleration.x"]),
    "logs/linear_axis.bag": ("/axis", ["position[0]", "effort[0]"]),
    "logs/linear_axis_ros2": ("/axis", ["position[0]", "effort[0]"]),
}
#: and those of others.
OTHERS = {
    "bags/example-bz2.bag": ("/turtle1/pose", ["x", "theta"]),
    "bags/example-lz4.bag": ("/turtle1/cmd_vel", ["linear.x", "angular.z"]),
    "bags/example-unsorted-chunks.bag": ("foo", ["data"]),
    "bags/fake_joint_state.bag": ("/fake_joints_state", ["header.seq", "position[0]"]),
    "bags/jackal_imu_odom.bag": ("/imu/data", ["angular_velocity.z", "orientation_covariance[8]"]),
    "bags/rosbag2_test_0.db3": ("/imu", ["linear_acceleration.x", "header.frame_id"]),
    "bags/talker.mcap": ("/rosout", ["level", "msg", "line"]),
    "bags/tilt_laser.bag": ("/position_gps", ["latitude", "status.status"]),
    "bags/wbag_0.mcap": ("AAA", ["data"]),
    "logs/husky_asphalt.bag": ("/drives", ["effort[0]", "effort[1]"]),
    "logs/husky_asphalt_ros2": ("/imu/data", ["linear_acceleration.x"]),
    "logs/linear_axis.bag": ("/axis", ["position[0]", "effort[0]"]),
    "logs/linear_axis_ros2": ("/axis", ["position[0]", "effort[0]"]),
}


HELD = {"own": OWN, "others": OTHERS}
#: Drives of which our own are of the same containers and types: the others for `make slow`.
ALIKE = {("others", name) for name in OTHERS if name in OWN}


@pytest.fixture(
    params=[
        pytest.param(each, marks=pytest.mark.slow if each in ALIKE else (), id=" ".join(each))
        for each in ((whose, name) for whose in WHOSE for name in HELD[whose])
    ]
)
def log_path(request: pytest.FixtureRequest) -> Path:
    whose, name = request.param
    return request.getfixturevalue("own_data" if whose == "own" else "shared_data") / name


def oracle(path: Path, topic: str) -> Iterator[tuple[int, Any]]:
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        for connection, time, data in reader.messages(reader.topics[topic].connections):
            yield time, reader.deserialize(data, connection.msgtype)


def value(message: Any, field: str) -> Any:
    for step in field.replace("[", ".[").split("."):
        message = message[int(step[1:-1])] if step[0] == "[" else getattr(message, step)
    return message


def test_topics_and_counts_are_those_of_anyreader(log_path: Path) -> None:
    with AnyReader([log_path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        expected = {name: (t.msgtype, t.msgcount) for name, t in reader.topics.items()}
        ends = (reader.start_time, reader.end_time - 1)
    log = open_log(log_path)
    topics = log.topics()
    found = {name: (kind, n) for name, kind, n in topics.select("topic", "type", "messages").rows()}
    assert found == expected
    assert (topics["start_ns"].min(), topics["end_ns"].max()) == ends
    assert topics["problem"].null_count() == topics.height
    assert log.losses() == ()


def test_fields_are_those_of_anyreader(log_path: Path) -> None:
    readable = OWN if log_path.parent.parent.name == "own" else OTHERS
    topic, fields = readable["/".join(log_path.parts[-2:])]
    frame = open_log(log_path).read(topic, fields)
    messages = sorted(oracle(log_path, topic), key=lambda pair: pair[0])
    assert frame["log_time_ns"].to_list() == [time for time, _ in messages]
    for field in fields:
        assert frame[field].to_list() == [value(message, field) for _, message in messages]
    if hasattr(messages[0][1], "header"):
        stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for _, m in messages]
        assert frame["header_stamp_ns"].to_list() == stamps
    else:
        assert frame["header_stamp_ns"].null_count() == frame.height


def _deserialize(reader: AnyReader, msgtype: str, data: bytes) -> Any:
    return reader.deserialize(data, msgtype)


@pytest.mark.heavy
def test_every_field_of_every_topic_is_that_of_rosbags(log_path: Path) -> None:
    log = MessageLog(log_path, "log of messages", CONTAINERS[log_path.suffix])
    for topic, found in log._topics.items():
        assert found.kind is not None
        names = sorted(set(every_field(found.kind.record)))
        with AnyReader([log_path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            stored = sorted(
                (
                    (time, bytes(data))
                    for _, time, data in reader.messages(reader.topics[topic].connections)
                ),
                key=lambda message: message[0],
            )
            decode = partial(_deserialize, reader, found.kind.record.name)
            kind = replace(found.kind, decode=decode)
            oracle = PerMessageDecoder(kind, [resolve_message_field(n, kind.record) for n in names])
            batch = make_batch_of_messages(
                0, [time for time, _ in stored], [data for _, data in stored]
            )
            expected = oracle.decode(batch).frame
        assert same(log.read(topic, names), expected)


def test_csv_bag_and_rosbag2_of_one_run_hold_the_same_samples(data: Path) -> None:
    logs = data / "logs"
    table = open_log(logs / "linear_axis.csv").read("table", ["position_m", "force_N"])
    fields = ["position[slide]", "effort[slide]"]
    for name in ("linear_axis.bag", "linear_axis_ros2"):
        frame = open_log(logs / name).read("/axis", fields)
        assert np.array_equal(
            frame["log_time_ns"] - 1_700_000_000_000_000_000, table["log_time_ns"]
        )
        assert frame["header_stamp_ns"].equals(frame["log_time_ns"].alias("header_stamp_ns"))
        assert frame.select(fields).rows() == table.select("position_m", "force_N").rows()


def test_the_wheels_of_the_husky_are_found_by_name(data: Path) -> None:
    fields = ["velocity[left]", "velocity[right]", "effort[left]"]
    frame = open_log(data / "logs/husky_asphalt.bag").read("/drives", fields)
    assert frame.height == 338
    assert frame.select(pl.col(fields).null_count()).row(0) == (0, 0, 0)


def test_service_events_cost_their_topic_only(data: Path) -> None:
    log = open_log(data / "bags/topics_and_services.mcap")
    problems = dict(log.topics().select("topic", "problem").rows())
    assert problems["/parameter_events"] is None
    assert "definition of a service" in problems["/add_two_ints/_service_event"]
    field = {"own": "data"}.get(data.name, "node")
    assert log.read("/parameter_events", [field]).height == 7
    assert [loss.topic for loss in log.losses()] == ["/add_two_ints/_service_event"]


def test_definitions_that_are_placeholders_cost_their_topics_only(data: Path) -> None:
    log = open_log(data / "bags/talker.db3")
    assert log.read("/topic", ["data"])["data"][0] == "Hello, world! 0"
    with pytest.raises(LogError, match="none of its 10 messages fits the definition"):
        log.read("/rosout", [])


def test_an_empty_file_says_so_in_one_line(data: Path) -> None:
    with pytest.raises(LogError, match=r"the file is empty \(0 bytes\)") as caught:
        open_log(data / "bags" / "empty-file.bag")
    assert_one_line(caught.value)


def test_a_bag_of_which_bytes_are_missing_is_read_but_for_what_they_tore(shared_data: Path) -> None:
    """Ten bytes of its only chunk are missing, so that its index points beside the records."""
    whole = dict(counts(open_log(shared_data / "bags/example-lz4.bag")))
    log = open_log(shared_data / "bags/example.bag")
    found = dict(counts(log))
    assert sum(found.values()) == sum(whole.values()) - 8
    assert all(found[topic] <= whole[topic] for topic in found)
    assert any("the index is damaged" in loss.what for loss in log.losses())
    assert any("bytes in the chunk at byte 4117" in loss.what for loss in log.losses())


def test_files_of_our_own_that_are_torn_are_read_but_for_what_the_tear_cost(own_data: Path) -> None:
    for torn, whole in (("torn.bag", "plain.bag"), ("torn.mcap", "zstd.mcap")):
        held = dict(counts(open_log(own_data / "bags" / whole)))
        log = open_log(own_data / "bags" / torn)
        found = dict(counts(log))
        assert 0 < sum(found.values()) < sum(held.values())
        assert all(found[topic] <= held[topic] for topic in found)
        assert log.losses()


def counts(log: Log) -> list[tuple[str, int]]:
    return log.topics().select("topic", "messages").rows()


def test_a_bag_without_messages_has_no_topics(data: Path) -> None:
    log = open_log(data / "bags/no-messages.bag")
    assert log.topics().is_empty()
    with pytest.raises(LogError, match="no topic '/imu'; known: none"):
        log.read("/imu", [])
