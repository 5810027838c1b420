"""MCAP: with an index, without one, torn, damaged, and with topics that cannot be decoded."""

import struct
from collections.abc import Callable
from pathlib import Path

import pytest
import zstandard
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.records import Channel, ChunkIndex, Message, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter

from estimators.errors import LogError
from replay import open_log
from replay.logs.mcap.mcap_file import McapFile
from replay.logs.mcap.mcap_records import read_indexed_times_of_chunk
from replay.logs.storage.file_bytes import FileBytes
from tests.replay.logs.one_line import one_line_at_most
from tests.replay.logs.stored import stored
from tests.replay.logs.written_logs import JOINT_STATE, ROS2, Joints, write_mcap

DRIVE = [Joints(1000 + k, {"left": float(k)}) for k in range(200)]
SERVICE_DEFINITION = b"int64 a\nint64 b\n---\nint64 sum\n"


@pytest.mark.parametrize(
    "options",
    [
        {"use_chunking": False},
        {"index_types": IndexType.NONE},
        {"index_types": IndexType.CHUNK},
        {"repeat_channels": False},
        {"repeat_schemas": False},
        {"use_statistics": False},
        {"compression": CompressionType.LZ4},
        {"compression": CompressionType.NONE},
        {"chunk_size": 500},
    ],
    ids=str,
)
def test_every_legal_layout_gives_the_same_samples(tmp_path: Path, options: dict) -> None:
    write_mcap(tmp_path / "shift.mcap", DRIVE, **options)
    log = open_log(tmp_path / "shift.mcap")
    assert log.topics()["messages"].to_list() == [200]
    frame = log.read("/joints", ["effort[left]"])
    assert frame["effort[left]"].to_list() == [float(k) for k in range(200)]
    assert log.losses() == ()


@pytest.mark.heavy
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(cut=st.integers(8, 20_000))
def test_a_file_torn_anywhere_keeps_every_complete_chunk_and_states_the_tear(
    tmp_path: Path, cut: int
) -> None:
    whole = tmp_path / "whole.mcap"
    if not whole.exists():
        write_mcap(whole, DRIVE, chunk_size=2000)
    data = whole.read_bytes()
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(data[: min(cut, len(data) - 1)])
    with open_log(torn) as log:
        topics = log.topics()
        if topics.is_empty():
            assert log.losses()
            return
        times = log.read("/joints", ["effort[left]"])["log_time_ns"].to_list()
        assert times == [1000 + k for k in range(len(times))]
        assert topics["messages"].to_list() == [len(times)]
        *_, loss = log.losses()
        behind_the_data = "torn or damaged after the data" in loss.what
        assert ("without a footer" in loss.what) != behind_the_data
        assert len(times) == 200 or not behind_the_data


@pytest.mark.parametrize("chunked", [True, False])
@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (lambda data: data[:-1], "does not end with a footer and the MCAP magic bytes"),
        (lambda data: data[:-8], "does not end with a footer and the MCAP magic bytes"),
        (
            lambda data: data[:-8] + b"no magic",
            "does not end with a footer and the MCAP magic bytes",
        ),
        (lambda data: data + bytes(512), "does not end with a footer and the MCAP magic bytes"),
        (lambda data: data[:-70] + b"\xff" + data[-69:], "the CRC of its summary is wrong"),
    ],
    ids=["a byte less", "no magic", "another magic", "zeros behind", "a wrong summary"],
)
def test_a_tear_behind_the_data_costs_no_message_and_is_a_loss(
    tmp_path: Path, change: Callable[[bytes], bytes], fault: str, chunked: bool
) -> None:
    path = tmp_path / "shift.mcap"
    write_mcap(path, DRIVE, use_chunking=chunked)
    path.write_bytes(change(path.read_bytes()))
    with open_log(path) as log:
        assert log.read("/joints", ["effort[left]"]).height == 200
        assert [loss.what for loss in log.losses()] == [
            f"{fault}: torn or damaged after the data, which is complete and was scanned from "
            "start to end"
        ]


def test_a_damaged_chunk_costs_that_chunk_and_says_which_time(tmp_path: Path) -> None:
    path = tmp_path / "shift.mcap"
    write_mcap(path, DRIVE, chunk_size=2000, compression=CompressionType.NONE)
    with path.open("rb") as file:
        chunks = make_reader(file).get_summary().chunk_indexes
    data = bytearray(path.read_bytes())
    data[chunks[1].chunk_start_offset + chunks[1].chunk_length - 20] ^= 0x10
    path.write_bytes(data)
    log = open_log(path)
    times = set(log.read("/joints", [])["log_time_ns"])
    lost = range(chunks[1].message_start_time, chunks[1].message_end_time + 1)
    assert times == {1000 + k for k in range(200)} - set(lost)
    assert [f"log time 0.{lost[0]:09} s" in loss.what for loss in log.losses()] == [True]


@pytest.mark.heavy
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(at=st.integers(0, 10**6), bit=st.integers(0, 7))
def test_a_flipped_bit_anywhere_is_never_a_traceback_nor_a_silent_loss(
    tmp_path: Path, at: int, bit: int
) -> None:
    whole = tmp_path / "whole.mcap"
    if not whole.exists():
        write_mcap(whole, DRIVE[:50], chunk_size=2000)
    data = bytearray(whole.read_bytes())
    data[at % len(data)] ^= 1 << bit
    (tmp_path / "flipped.mcap").write_bytes(data)
    with one_line_at_most(), open_log(tmp_path / "flipped.mcap") as log:
        log.topics()
        frame = log.read("/joints", ["effort[left]"])
        assert log.losses() or frame["effort[left]"].to_list() == [float(k) for k in range(50)]


@pytest.fixture
def mixed(tmp_path: Path) -> Path:
    """A good topic among topics that have no decoder."""
    path = tmp_path / "mixed.mcap"
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start(profile="ros2", library="test")
        text = ROS2.generate_msgdef(JOINT_STATE, ros_version=2)[0].encode()
        good = writer.register_schema(JOINT_STATE, "ros2msg", text)
        event = writer.register_schema("a/srv/Add_Event", "ros2msg", SERVICE_DEFINITION)
        lacking = writer.register_schema("a/msg/B", "ros2msg", b"c/Missing inner\n")
        circular = writer.register_schema("a/msg/Loop", "ros2msg", b"a/Loop inner\n")
        json = writer.register_schema("a", "jsonschema", b"{}")
        data = bytes(ROS2.serialize_cdr(DRIVE[7].message(ROS2), JOINT_STATE))
        for topic, encoding, schema, content in (
            ("/joints", "cdr", good, data),
            ("/joints", "cdr", good, data),
            ("/joints", "cdr", good, data[:-9]),
            ("/event", "cdr", event, b"\x00\x01\x00\x00"),
            ("/lacking", "cdr", lacking, b"\x00\x01\x00\x00"),
            ("/loop", "cdr", circular, b"\x00\x01\x00\x00"),
            ("/json", "json", json, b"{}"),
            ("/bare", "cdr", 0, b"\x00\x01\x00\x00"),
            ("/both", "cdr", good, data),
            ("/both", "json", json, b"{}"),
            ("/torn", "cdr", good, data[:-9]),
        ):
            channel = writer.register_channel(topic, encoding, schema)
            writer.add_message(channel, 5, content, 5)
        writer.finish()
    return path


def test_a_topic_that_cannot_be_decoded_costs_that_topic_not_the_log(mixed: Path) -> None:
    log = open_log(mixed)
    problems = dict(log.topics().select("topic", "problem").rows())
    assert [topic for topic, problem in problems.items() if problem is None] == ["/joints", "/torn"]
    assert "definition of a service" in problems["/event"]
    assert "the definition of c/msg/Missing" in problems["/lacking"]
    assert "contains itself" in problems["/loop"]
    assert "its JSON schema lists no properties" in problems["/json"]
    assert {loss.topic for loss in log.losses()} == {t for t, p in problems.items() if p}
    with pytest.raises(LogError, match=r"topic '/event' cannot be read: the log holds"):
        log.read("/event", [])


def test_two_connections_of_one_definition_are_one_topic(mixed: Path) -> None:
    log = open_log(mixed)
    assert log.read("/joints", ["effort[left]"])["effort[left]"].to_list() == [7.0, 7.0]
    assert log.losses()[-1].topic == "/joints"
    assert log.losses()[-1].what.startswith("1 of 3 messages cannot be decoded")


def test_connections_whose_definitions_differ_are_not_merged(tmp_path: Path) -> None:
    path = tmp_path / "shift.mcap"
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        for name, text in (("a/msg/A", b"float64 x\n"), ("a/msg/A", b"float32 x\n")):
            schema = writer.register_schema(name, "ros2msg", text)
            writer.add_message(writer.register_channel("/a", "cdr", schema), 5, b"", 5)
        writer.finish()
    assert "2 connections whose definitions differ" in open_log(path).topics()["problem"][0]


def test_a_topic_none_of_whose_messages_fits_is_an_error(mixed: Path) -> None:
    with pytest.raises(LogError, match="none of its 1 messages fits the definition"):
        open_log(mixed).read("/torn", [])


@pytest.mark.parametrize(
    ("kind", "text"),
    [("ros2msg", b"float64 \xff\n"), ("jsonschema", b"\xff"), ("ros2\nmsg\0" * 99, b"float64 x\n")],
)
def test_a_definition_that_is_no_text_costs_its_topic_in_one_line(
    tmp_path: Path, kind: str, text: bytes
) -> None:
    path = tmp_path / "shift.mcap"
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        schema = writer.register_schema("a/msg/A", kind, text)
        writer.add_message(writer.register_channel("/a", "cdr", schema), 5, b"", 5)
        writer.finish()
    with open_log(path) as log:
        problem = log.topics()["problem"][0]
        assert problem.isprintable()
        assert len(problem) < 400
        assert problem in str(log.losses()[0])


def test_message_indexes_that_lie_in_one_another_are_no_index(tmp_path: Path) -> None:
    keys = range(500)
    heads = (struct.pack("<BQHI", 7, 0, key, 16 * (len(keys) - key)) for key in keys)
    section = b"".join(head.ljust(16) for head in heads) + bytes(15)
    path = tmp_path / "index"
    path.write_bytes(section)
    file = FileBytes(path)
    nested = ChunkIndex(0, 0, "", 0, 0, len(section), {key: 16 * key for key in keys}, 0, 0)
    assert read_indexed_times_of_chunk(file, nested) is None
    first = ChunkIndex(0, 0, "", 0, 0, len(section), {0: 0}, 0, 0)
    assert read_indexed_times_of_chunk(file, first)[0].size == len(keys)
    file.close()


def test_large_unsigned_integers_keep_their_value(tmp_path: Path) -> None:
    path = tmp_path / "shift.mcap"
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        schema = writer.register_schema("a/msg/A", "ros2msg", b"uint64 big\nbool on\nint8[2] few\n")
        data = b"\x00\x01\x00\x00" + (2**64 - 1).to_bytes(8, "little") + b"\x01\xff\x02"
        writer.add_message(writer.register_channel("/a", "cdr", schema), 5, data, 5)
        writer.add_message(writer.register_channel("/a", "cdr", schema), 2**64 - 1, data, 5)
        writer.finish()
    log = open_log(path)
    frame = log.read("/a", ["big", "on", "few[0]"])
    assert frame.row(0) == (5, None, 2**64 - 1, True, -1)
    assert "beyond the year 2262" in log.losses()[0].what


def test_the_conformance_suite_holds_what_the_official_reader_finds(data: Path) -> None:
    files = sorted((data / "mcap_conformance").glob("*.mcap"))
    assert len(files) == 104 if data.name != "own" else 72
    for path in files:
        with path.open("rb") as file:
            records = list(StreamReader(file).records)
        schemas = {r.id: (r.name, r.encoding, r.data) for r in records if isinstance(r, Schema)}
        channels = {
            (c.id, c.topic, c.message_encoding, *schemas.get(c.schema_id, ("", "", b"")))
            for c in records
            if isinstance(c, Channel)
        }
        messages = sorted((m.log_time, m.data) for m in records if isinstance(m, Message))
        container = McapFile(path)
        found = {
            (c.id, c.topic, c.encoding, c.type, c.definition_format, c.definition.encode())
            for c in container.connections
        }
        ids = [connection.id for connection in container.connections]
        indexed = sum(container.log_times(key).size for key in ids)
        held = sorted((time, data) for _, time, data in stored(container))
        container.close()
        assert found == channels, path.name
        assert held == messages, path.name
        assert indexed == len(messages), path.name
        assert container.losses == (), path.name


def test_a_chunk_that_declares_what_only_a_bomb_holds_is_not_unpacked(tmp_path: Path) -> None:
    write_mcap(tmp_path / "shift.mcap", DRIVE)
    whole = (tmp_path / "shift.mcap").read_bytes()
    size = 2**29
    packed = zstandard.compress(bytes(size))
    body = (
        struct.pack("<QQQII", 1, 2, size, 0, 4) + b"zstd" + struct.pack("<Q", len(packed)) + packed
    )
    bomb = struct.pack("<BQ", 6, len(body)) + body
    (tmp_path / "bomb.mcap").write_bytes(whole[:8] + bomb + whole[8:])
    with open_log(tmp_path / "bomb.mcap") as log:
        assert log.topics()["messages"].to_list() == [200]
        (loss, *_) = log.losses()
    assert "it declares 536,870,912 bytes, more than 2,000 times its" in loss.what


def test_a_channel_without_a_schema_says_that_its_type_is_unknown(tmp_path: Path) -> None:
    with (tmp_path / "bare.mcap").open("wb") as file:
        writer = McapWriter(file)
        writer.start("ros2")
        writer.add_message(writer.register_channel("/bare", "cdr", 0), 1, b"\0\1\0\0", 1)
        writer.finish()
    with open_log(tmp_path / "bare.mcap") as log:
        (problem,) = log.topics()["problem"]
    assert problem == "the log does not state the message type of this topic"


def test_of_a_torn_chunk_it_is_said_how_many_messages_are_read(tmp_path: Path) -> None:
    write_mcap(tmp_path / "shift.mcap", DRIVE, chunk_size=10_000, compression=CompressionType.NONE)
    data = (tmp_path / "shift.mcap").read_bytes()
    (tmp_path / "torn.mcap").write_bytes(data[:5000])
    with open_log(tmp_path / "torn.mcap") as log:
        (count,) = log.topics()["messages"]
        (loss,) = log.losses()
    assert 0 < count < 200
    assert loss.what.endswith(
        f"bytes are an incomplete chunk, from which {count} messages could be read"
    )
