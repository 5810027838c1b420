"""JSON and protobuf messages in MCAP, each through its own library."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from google.protobuf.descriptor_pb2 import DescriptorProto, FieldDescriptorProto, FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from google.protobuf.timestamp_pb2 import DESCRIPTOR as TIMESTAMP
from mcap.writer import Writer

from estimators.errors import LogError
from replay import open_log
from tests.replay.logs.one_line import one_line_at_most

SCHEMA = {
    "type": "object",
    "title": "Drive",
    "properties": {
        "stamp": {"type": "object", "properties": {"sec": {}, "nsec": {}}},
        "speed": {"type": ["number", "null"]},
        "gear": {"type": "integer"},
        "on": {"type": "boolean"},
        "name": {"type": "array", "items": {"type": "string"}},
        "effort": {"type": "array", "items": {"$ref": "#/$defs/newton"}},
        "imu": {"properties": {"z": {"type": "number"}}},
        "either": {"anyOf": [{"type": "string"}, {"type": "number"}]},
        "any": {},
    },
    "$defs": {"newton": {"type": "number"}},
}
MESSAGES = [
    {
        "stamp": {"sec": 3, "nsec": 5},
        "speed": 1.5,
        "gear": 2,
        "on": True,
        "name": ["left", "right"],
        "effort": [1, 2.5],
        "imu": {"z": 9.8},
    },
    {"speed": None, "gear": -1, "name": ["right"], "effort": [4]},
]
FIELDS = ["stamp", "speed", "gear", "on", "effort[left]", "effort[1]", "effort[]", "imu.z"]


def write(path: Path, encoding: str, name: str, schema: bytes, messages: Sequence[bytes]) -> Path:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        kind = writer.register_schema(name, {"json": "jsonschema"}.get(encoding, encoding), schema)
        channel = writer.register_channel("/drive", encoding, kind)
        for time, message in enumerate(messages):
            writer.add_message(channel, time, message, time)
        writer.finish()
    return path


def test_json_messages_become_columns_of_their_schema(tmp_path: Path) -> None:
    stored = [json.dumps(message).encode() for message in MESSAGES]
    path = write(tmp_path / "a.mcap", "json", "Drive", json.dumps(SCHEMA).encode(), stored)
    with open_log(path) as log:
        row = log.topics().row(0, named=True)
        assert (row["type"], row["encoding"], row["decoder"]) == ("Drive", "json", "json")
        assert row["fields"] == ["stamp", "speed", "gear", "on", "name[]", "effort[]", "imu.z"]
        frame = log.read("/drive", FIELDS)
        assert frame.row(0) == (
            *(0, None, 3_000_000_005, 1.5, 2, True),
            *(1.0, 2.5, [1.0, 2.5], 9.8),
        )
        assert frame.row(1) == (1, None, None, None, -1, None, None, None, [4.0], None)


@pytest.mark.parametrize(
    "broken",
    [
        b"{",
        b"[" * 100_000,
        b'{"gear": 99999999999999999999}',
        b'{"gear": "two"}',
        b'{"gear": 1, "name": ["\\ud800"]}',
        b'{"gear": 1, "stamp": 5}',
        b'{"gear": 1, "stamp": {"sec": [], "nsec": 5}}',
        b"7",
    ],
)
def test_a_json_message_that_does_not_fit_costs_its_row(tmp_path: Path, broken: bytes) -> None:
    stored = [json.dumps(MESSAGES[0]).encode(), broken]
    path = write(tmp_path / "a.mcap", "json", "Drive", json.dumps(SCHEMA).encode(), stored)
    with open_log(path) as log:
        frame = log.read("/drive", ["gear", "name[]", "stamp"])
        assert frame["gear"].to_list() == [2]
        assert "1 of 2 messages cannot be decoded" in log.losses()[0].what


@pytest.mark.parametrize(
    "schema",
    [
        b"{}",
        b"[1]",
        b'{"properties": [1]}',
        b'{"type": [{}]}',
        b"{",
        b'{"$ref": "#"}',
        b'{"$ref": "#/$ref"}',
        b'{"properties": {"\\ud800": {"type": "number"}}}',
        b"\xff",
    ],
)
def test_a_json_schema_of_no_use_costs_its_topic(tmp_path: Path, schema: bytes) -> None:
    path = write(tmp_path / "a.mcap", "json", "Drive", schema, [b"{}"])
    with open_log(path) as log:
        assert "the definition of Drive cannot be used" in log.topics()["problem"][0]
        with pytest.raises(LogError, match="cannot be read"):
            log.read("/drive", [])


def descriptors() -> FileDescriptorSet:
    kinds = FieldDescriptorProto
    file = FileDescriptorSet().file.add(name="drive.proto", package="own", syntax="proto3")
    file.dependency.append(TIMESTAMP.name)
    imu = DescriptorProto(name="Imu")
    imu.field.add(name="z", number=1, type=kinds.TYPE_DOUBLE, label=kinds.LABEL_OPTIONAL)
    imu.field.add(name="again", number=2, type=kinds.TYPE_MESSAGE, label=1, type_name=".own.Imu")
    drive = DescriptorProto(name="Drive")
    for number, (name, kind, label, type_name) in enumerate(
        [
            ("stamp", kinds.TYPE_MESSAGE, 1, ".google.protobuf.Timestamp"),
            ("speed", kinds.TYPE_FLOAT, 1, ""),
            ("gear", kinds.TYPE_SINT32, 1, ""),
            ("on", kinds.TYPE_BOOL, 1, ""),
            ("name", kinds.TYPE_STRING, 3, ""),
            ("effort", kinds.TYPE_DOUBLE, 3, ""),
            ("imu", kinds.TYPE_MESSAGE, 1, ".own.Imu"),
            ("raw", kinds.TYPE_BYTES, 1, ""),
            ("big", kinds.TYPE_UINT64, 1, ""),
        ],
        1,
    ):
        field = drive.field.add(name=name, number=number, type=kind, label=label)
        if type_name:
            field.type_name = type_name
    file.message_type.extend([drive, imu])
    stamp = FileDescriptorSet().file.add()
    TIMESTAMP.CopyToProto(stamp)
    return FileDescriptorSet(file=[file, stamp])  # the dependency comes last


def protobuf_messages() -> list[bytes]:
    pool = DescriptorPool()
    for file in reversed(descriptors().file):
        pool.Add(file)
    drive: Any = GetMessageClass(pool.FindMessageTypeByName("own.Drive"))
    full = drive(speed=1.5, gear=2, on=True, name=["left", "right"], effort=[1, 2.5])
    full.stamp.seconds, full.stamp.nanos = 3, 5
    full.imu.z, full.raw, full.big = 9.8, b"\x01\xff", 2**64 - 1
    return [full.SerializeToString(), drive(name=["right"], effort=[4]).SerializeToString()]


def test_protobuf_messages_become_columns_of_their_descriptors(tmp_path: Path) -> None:
    schema = descriptors().SerializeToString()
    path = write(tmp_path / "a.mcap", "protobuf", "own.Drive", schema, protobuf_messages())
    with open_log(path) as log:
        row = log.topics().row(0, named=True)
        assert (row["problem"], row["decoder"]) == (None, "protobuf")
        assert {"stamp", "effort[]", "imu.z", "raw[]"} <= set(row["fields"])
        frame = log.read("/drive", [*FIELDS, "raw[]", "big"])
        assert frame.row(0) == (
            *(0, None, 3_000_000_005, 1.5, 2, True),
            *(1.0, 2.5, [1.0, 2.5], 9.8, [1, 255], 2**64 - 1),
        )
        assert frame.row(1) == (1, None, None, 0.0, 0, False, None, None, [4.0], None, [], 0)


def test_a_protobuf_message_that_is_torn_costs_its_row(tmp_path: Path) -> None:
    schema = descriptors().SerializeToString()
    stored = [protobuf_messages()[0], protobuf_messages()[0][:-3]]
    path = write(tmp_path / "a.mcap", "protobuf", "own.Drive", schema, stored)
    with open_log(path) as log:
        assert log.read("/drive", ["gear"])["gear"].to_list() == [2]
        assert "1 of 2 messages cannot be decoded" in log.losses()[0].what


@pytest.mark.parametrize("schema", [b"", b"\xff\xff", descriptors().file[0].SerializeToString()])
def test_descriptors_of_no_use_cost_their_topic(tmp_path: Path, schema: bytes) -> None:
    path = write(tmp_path / "a.mcap", "protobuf", "own.Drive", schema, [b""])
    with open_log(path) as log:
        assert "its protobuf descriptors cannot be used" in log.topics()["problem"][0]


@pytest.mark.parametrize("change", ["renamed", "text", "repeated"])
def test_a_timestamp_that_is_described_otherwise_is_a_message_like_others(
    tmp_path: Path, change: str
) -> None:
    files = descriptors()
    seconds = next(file for file in files.file if file.package == "google.protobuf")
    field = seconds.message_type[0].field[0]
    if change == "renamed":
        field.name = "secants"
    elif change == "text":
        field.type = FieldDescriptorProto.TYPE_STRING
    else:
        field.label = FieldDescriptorProto.LABEL_REPEATED
    schema = files.SerializeToString()
    path = write(tmp_path / "a.mcap", "protobuf", "own.Drive", schema, protobuf_messages())
    with one_line_at_most(), open_log(path) as log:
        fields = log.topics()["fields"][0].to_list()
        assert "stamp" not in fields
        assert "stamp.nanos" in fields
        log.read("/drive", fields)
