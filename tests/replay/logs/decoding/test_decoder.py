"""Which decoder a type gets, and how batches go through it."""

from collections.abc import Iterator
from datetime import UTC
from pathlib import Path
from random import Random

import numpy as np
import pytest
from mcap.writer import Writer
from rich.console import Console
from rosbags.typesys import Stores, get_typestore

from replay import open_log
from replay.commands.info import print_log_info
from replay.init.describe_log import describe_log_by_index
from replay.logs.decoding.batch_stream import TopicStream, feed_batches_to_streams
from replay.logs.decoding.decode_plan import DecodePlan
from replay.logs.decoding.decoder import make_frame_schema
from replay.logs.decoding.decoder_choice import (
    PerMessageDecoder,
    choose_decoder_name_of_type,
    make_decoder_of_fields,
)
from replay.logs.message_definitions import make_message_type_of_connection
from replay.logs.messages.message_fields import resolve_message_field
from replay.logs.messages.message_types import iter_leaf_paths_of_message_type
from replay.logs.messages.raw_batch import BATCH_BYTES, BATCH_ROWS, RawBatch
from replay.logs.storage.container import Connection
from tests.replay.logs.decoding.random_types import batch_of, encode, random_message
from tests.replay.logs.decoding.test_equality import same
from tests.twins import mark_slow_after

LONG_DOUBLE = "module t { module msg { struct A { long double a[2]; octet b; }; }; };"


@pytest.mark.heavy
@pytest.mark.parametrize("release", mark_slow_after(1, [Stores.ROS2_HUMBLE, Stores.ROS1_NOETIC]))
def test_every_type_of_a_release_is_columnar_and_equal_to_rosbags(release: Stores) -> None:
    store = get_typestore(release)
    ros1 = release == Stores.ROS1_NOETIC
    encoding, text_format = ("ros1", "ros1msg") if ros1 else ("cdr", "ros2msg")
    for name in sorted(store.fielddefs):
        text, _ = store.generate_msgdef(name, ros_version=1 if ros1 else 2)
        kind = make_message_type_of_connection(
            Connection(0, "/t", name, encoding, text, text_format)
        )
        assert choose_decoder_name_of_type(kind) == "columnar", name
        rng = Random(0)
        messages = [random_message(store, name, rng) for _ in range(2)]
        batch = batch_of([encode(store, m, "ros1" if ros1 else "cdr_le") for m in messages])
        fields = [
            resolve_message_field(leaf, kind.record)
            for leaf in iter_leaf_paths_of_message_type(kind.record)
        ]
        decoded = DecodePlan(kind.record, ros1=ros1, fields=fields).decode(batch)
        assert same(decoded.frame, PerMessageDecoder(kind, fields).decode(batch).frame), name


def write_long_doubles(path: Path) -> None:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="test")
        schema = writer.register_schema("t/msg/A", "ros2idl", LONG_DOUBLE.encode())
        channel = writer.register_channel("/long", "cdr", schema)
        numbers = np.array([1.5, -2.5], np.longdouble).tobytes()
        for k in range(3):
            writer.add_message(channel, k, b"\0\1\0\0" + numbers + bytes([k]), k)
        writer.finish()


@pytest.mark.skipif(np.dtype(np.longdouble).itemsize != 16, reason="no long double of 16 bytes")
def test_a_type_without_a_plan_is_read_by_rosbags_and_info_says_so(tmp_path: Path) -> None:
    write_long_doubles(path := tmp_path / "long.mcap")
    with open_log(path) as log:
        assert log.topics()["decoder"].to_list() == ["rosbags"]
        frame = log.read("/long", ["a[]", "a[1]", "b"])
        assert frame.rows() == [(k, None, [1.5, -2.5], -2.5, k) for k in range(3)]
        assert log.losses() == ()
        console = Console(width=200, color_system=None)
        with console.capture() as capture:
            print_log_info(describe_log_by_index(log), UTC, console)
    assert "! /long: read message by message with rosbags, which is slow" in capture.get()


def test_large_batches_are_split_by_messages_and_by_bytes() -> None:
    def rows(count: int, size: int) -> list[int]:
        lengths = np.full(count, size)
        times = np.arange(count)
        data = np.zeros(size, np.uint8)
        return [
            part.message_count
            for part in RawBatch(0, data, 0 * times, lengths, times).split_to_bounded_batches()
        ]

    assert rows(2 * BATCH_ROWS + 1, 10) == [BATCH_ROWS, BATCH_ROWS, 1]
    assert rows(5, BATCH_BYTES // 2) == [2, 2, 1]
    assert rows(2, BATCH_BYTES + 1) == [1, 1]
    assert rows(0, 10) == []


def test_batches_of_any_size_give_the_rows_in_their_order_and_a_tally() -> None:
    text = "string[] name\nfloat64[] effort\n"
    kind = make_message_type_of_connection(Connection(0, "/t", "t/msg/A", "ros1", text, "ros1msg"))
    good = b"\1\0\0\0\4\0\0\0left\1\0\0\0" + np.array([0.5]).tobytes()
    whole = np.frombuffer(good, np.uint8)
    memory = np.zeros(1000, np.uint8)

    def batches() -> Iterator[RawBatch]:
        yield batch_of([good, b"torn", good])
        stored = batch_of([good] * 2)
        yield RawBatch(0, stored.data, stored.offsets, stored.lengths, np.array([5, 6]))
        for k in range(7, 5007):  # a message each, always in the same memory
            place = np.array([k % 100])
            memory[:] = 255
            memory[k % 100 : k % 100 + len(good)] = whole
            yield RawBatch(0, memory, place, np.array([len(good)]), np.array([k]))
        many = np.zeros(2 * BATCH_ROWS + 1, np.int64)
        yield RawBatch(0, whole, many, many + len(good), np.arange(5007, 5007 + many.size))

    fields = [resolve_message_field("effort[left]", kind.record)]
    stream = TopicStream(make_decoder_of_fields(kind, fields), make_frame_schema(fields))
    feed_batches_to_streams(([batch] for batch in batches()), {0: stream})
    frame, tally = stream.drain_all_rows(), stream.tally
    assert frame["log_time_ns"].to_list() == [0, 2, 5, *range(6, 5007 + 2 * BATCH_ROWS + 1)]
    assert set(frame["effort[left]"]) == {0.5}
    assert frame["effort[left]"].n_chunks() < 8
    assert (tally.rows, tally.undecodable) == (frame.height, 1)
    assert tally.first_fault.startswith("a list is longer than the rest of the message")


@pytest.mark.heavy
def test_describing_a_log_does_not_wait_for_the_compiler(own_data: Path) -> None:
    import subprocess
    import sys

    code = (
        "import sys; from replay import open_log; open_log(sys.argv[1]).topics(); "
        "print([name for name in ('numba', 'pyarrow') if name in sys.modules])"
    )
    log = own_data / "logs/husky_asphalt.bag"
    command = [sys.executable, "-c", code, str(log)]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == "[]\n"


def test_a_type_with_a_plan_in_one_encoding_alone_is_decoded_in_that() -> None:
    # in XCDR2 a list of records has its size before it, which has no place in an array of nothing
    ruler = "=" * 80
    definition = f"int8 n\nB[0] b\n{ruler}\nMSG: t/B\nint8 y\nC[2] c\n{ruler}\nMSG: t/C\nint8 z\n"
    kind = make_message_type_of_connection(
        Connection(0, "/t", "t/msg/A", "cdr", definition, "ros2msg")
    )
    plan = DecodePlan(kind.record, ros1=False, fields=[resolve_message_field("n", kind.record)])
    cdr, xcdr2 = (plan.decode(batch_of([head + b"\x05"])) for head in (b"\0\1\0\0", b"\0\7\0\0"))
    assert cdr.frame["n"].to_list() == [5]
    assert (xcdr2.frame.height, xcdr2.undecodable) == (0, 1)
    assert "length 0" in xcdr2.first_fault
