"""Messages of no fields: topics with times, in every encoding."""

from pathlib import Path

import pytest
from google.protobuf import descriptor_pb2, empty_pb2
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as BagWriter
from rosbags.typesys import Stores, get_typestore

from replay.logs import open_log

TIMES = [1_000_000_000, 2_000_000_000, 5_000_000_000]
ENCAPSULATED = b"\0\1\0\0\0"


def protobuf_empty() -> bytes:
    files = descriptor_pb2.FileDescriptorSet()
    empty_pb2.DESCRIPTOR.CopyToProto(files.file.add())
    return files.SerializeToString()


def write_mcap(
    path: Path, name: str, schema: tuple[str, bytes], message: tuple[str, bytes]
) -> None:
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start("ros2" if message[0] == "cdr" else "")
        schema_id = writer.register_schema(name, *schema)
        channel = writer.register_channel("/stop", message[0], schema_id)
        for stamp in TIMES:
            writer.add_message(channel, stamp, message[1], stamp)
        writer.finish()


@pytest.mark.parametrize(
    ("name", "schema", "message"),
    [
        ("std_msgs/msg/Empty", ("ros2msg", b""), ("cdr", ENCAPSULATED)),
        ("my_pkg/msg/Empty", ("ros2msg", b""), ("cdr", ENCAPSULATED)),
        ("my_pkg/msg/Stop", ("ros2msg", b"# nothing\n"), ("cdr", ENCAPSULATED)),
        (
            "my_pkg/msg/Stop",
            ("ros2idl", b"module my_pkg { module msg { struct Stop { }; }; };"),
            ("cdr", ENCAPSULATED),
        ),
        ("Stop", ("jsonschema", b'{"type":"object"}'), ("json", b"{}")),
        ("google.protobuf.Empty", ("protobuf", protobuf_empty()), ("protobuf", b"")),
    ],
    ids=["std_msgs", "own", "comment", "idl", "json", "protobuf"],
)
def test_an_empty_type_is_a_topic_with_times(
    tmp_path: Path, name: str, schema: tuple[str, bytes], message: tuple[str, bytes]
) -> None:
    write_mcap(tmp_path / "log.mcap", name, schema, message)
    with open_log(tmp_path / "log.mcap") as log:
        row = log.topics().row(0, named=True)
        assert (row["fields"], row["problem"], row["messages"]) == ([], None, 3)
        assert log.read("/stop", [])["log_time_ns"].to_list() == TIMES
        assert log.check().messages == 3
        assert log.losses() == ()


def test_an_empty_type_of_a_bag_is_one_too(tmp_path: Path) -> None:
    store = get_typestore(Stores.ROS1_NOETIC)
    with BagWriter(tmp_path / "log.bag") as writer:
        connection = writer.add_connection("/stop", "std_msgs/msg/Empty", typestore=store)
        for stamp in TIMES:
            writer.write(connection, stamp, b"")
    with open_log(tmp_path / "log.bag") as log:
        assert log.topics()["problem"].to_list() == [None]
        assert log.read("/stop", [])["log_time_ns"].to_list() == TIMES
