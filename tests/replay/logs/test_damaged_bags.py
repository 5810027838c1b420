"""Damaged ROS 1 bags: every whole message is kept, and what was lost is said."""

import struct
from pathlib import Path
from typing import Any

import pytest
from rosbags.rosbag1 import Writer as Writer1

from replay import open_log
from replay.logs.bag.bag_file import BagFile
from replay.logs.blocks.block import Block
from tests.replay.logs.damaged import DRIVE, overwrite, without_bag_index
from tests.replay.logs.stored import stored, times
from tests.replay.logs.written_logs import write_bag


def blocks(path: Path) -> list[Block]:
    """The chunks of a bag in its order."""
    container = BagFile(path)
    container.close()
    return container._store._blocks


@pytest.mark.parametrize("compression", [None, *Writer1.CompressionFormat], ids=str)
def test_a_bag_torn_anywhere_keeps_every_whole_chunk_and_the_start_of_the_torn_one(
    tmp_path: Path, compression: Any
) -> None:
    path, torn = tmp_path / "whole.bag", tmp_path / "torn.bag"
    write_bag(path, DRIVE, compression, 3000)
    container = BagFile(path)
    whole = times(stored(container))
    ends = [(b.offset + b.stored_bytes, b.last_ns) for b in container._store._blocks]
    container.close()
    data = path.read_bytes()
    for cut in range(13, len(data), 397):
        torn.write_bytes(data[:cut])
        container = BagFile(torn)
        found = times(stored(container))
        assert found == whole[: len(found)]
        assert len(found) >= max((last - 999 for end, last in ends if end <= cut), default=0)
        assert container.losses
        container.close()


def test_a_bag_without_an_index_is_found_again_behind_damage(tmp_path: Path) -> None:
    path = tmp_path / "shift.bag"
    write_bag(path, DRIVE, None, 3000)
    chunk = blocks(path)[2]
    without_bag_index(path)
    overwrite(path, chunk.record_offset, b"\xff" * 20)
    container = BagFile(path)
    assert times(stored(container)) == [1000 + k for k in range(200)]  # also inside the chunk
    assert any("bytes cannot be read, in 1 place at byte" in loss.what for loss in container.losses)
    container.close()


def test_a_message_that_damage_gave_to_another_topic_is_missed_there(tmp_path: Path) -> None:
    path = tmp_path / "shift.bag"
    write_bag(path, DRIVE, None, 3000)
    data = path.read_bytes()
    time = data.index(struct.pack("<II", 0, 1050))  # of a message of /joints0
    overwrite(path, data.rindex(b"conn=", 0, time) + len(b"conn="), b"\x01")
    with open_log(path) as log:
        assert {t: log.read(t, []).height for t in ("/joints0", "/joints1")} == {
            "/joints0": 99,
            "/joints1": 101,
        }
        assert {loss.topic for loss in log.losses()} == {"/joints0", "/joints1"}
        assert all("where its index counts" in loss.what for loss in log.losses())


def test_damage_in_a_chunk_without_a_crc_costs_the_messages_that_it_hit(tmp_path: Path) -> None:
    path = tmp_path / "shift.bag"
    write_bag(path, DRIVE, None, 3000)
    data = path.read_bytes()
    at = data.index(struct.pack("<II", 0, 1050)) - 9  # the header of one message
    overwrite(path, at, b"\xff" * 30)
    container = BagFile(path)
    assert times(stored(container)) == [1000 + k for k in range(200) if k != 50]
    whats = [loss.what for loss in container.losses]
    assert any("form no complete record" in what for what in whats)
    assert any("where its index counts" in what for what in whats)
    container.close()


@pytest.mark.parametrize("compression", [None, *Writer1.CompressionFormat], ids=str)
def test_a_chunk_before_the_index_that_reaches_out_of_the_bag_is_lost_and_said(
    tmp_path: Path, compression: Any
) -> None:
    path = tmp_path / "shift.bag"
    write_bag(path, DRIVE, compression, 3000)
    container = BagFile(path)
    block = container._store._blocks[2]
    topics = {c.id: c.topic for c in container.connections}
    container.close()
    overwrite(path, block.offset - 4, b"\xff" * 4)
    container = BagFile(path)
    lost = range(block.first_ns, block.last_ns + 1)
    assert set(times(stored(container))) == {1000 + k for k in range(200)} - set(lost)
    (loss,) = container.losses
    for key, count in block.counts.items():
        assert f"{count} of {topics[key]}" in loss.what
    container.close()


@pytest.mark.parametrize("byte", [0, 3, 4, 6, 255])
def test_a_message_of_a_crashed_bag_whose_op_is_damaged_is_missed(
    tmp_path: Path, byte: int
) -> None:
    path = tmp_path / "shift.bag"
    write_bag(path, DRIVE, None, 3000)
    without_bag_index(path)
    data = path.read_bytes()
    time = data.index(struct.pack("<II", 0, 1050))
    overwrite(path, data.rindex(b"op=", 0, time) + 3, bytes([byte]))
    container = BagFile(path)
    assert times(stored(container)) == [1000 + k for k in range(200) if k != 50]
    assert any("form no complete record" in loss.what for loss in container.losses)
    container.close()


def test_a_chunk_of_a_bag_whose_size_takes_thousands_of_bytes_costs_itself(tmp_path: Path) -> None:
    path = tmp_path / "shift.bag"
    write_bag(path, DRIVE, Writer1.CompressionFormat.LZ4, 3000)
    block = blocks(path)[2]
    without_bag_index(path)
    data = path.read_bytes()
    begin = block.record_offset
    (header,) = struct.unpack_from("<I", data, begin)
    size = data.index(b"size=", begin)
    fields = data[begin + 4 : size - 4] + data[size + 9 : begin + 4 + header]
    fields += struct.pack("<I", 5 + 4000) + b"size=" + b"\xff" * 4000
    rest = data[begin + 4 + header :]
    path.write_bytes(data[:begin] + struct.pack("<I", len(fields)) + fields + rest)
    container = BagFile(path)
    assert len(stored(container)) == 200 - sum(block.counts.values())
    (lost, _) = container.losses
    assert "it declares 18,446,744,073,709,551,615 bytes" in lost.what
    container.close()


@pytest.mark.parametrize("byte", [1, 4, 6, 7])
def test_a_chunk_of_a_crashed_bag_whose_op_is_damaged_is_missed(tmp_path: Path, byte: int) -> None:
    path = tmp_path / "shift.bag"
    write_bag(path, DRIVE, Writer1.CompressionFormat.LZ4, 3000)
    block = blocks(path)[2]
    without_bag_index(path)
    overwrite(path, path.read_bytes().index(b"op=\x05", block.record_offset) + 3, bytes([byte]))
    container = BagFile(path)
    lost = range(block.first_ns, block.last_ns + 1)
    assert set(times(stored(container))) == {1000 + k for k in range(200)} - set(lost)
    assert any("bytes cannot be read, in 1 place at byte" in loss.what for loss in container.losses)
    container.close()


def test_a_chunk_whose_compression_is_not_named_gives_no_message_twice(tmp_path: Path) -> None:
    path = tmp_path / "shift.bag"
    write_bag(path, DRIVE, None, 3000)
    without_bag_index(path)
    overwrite(path, path.read_bytes().index(b"compression="), b"K")
    container = BagFile(path)
    assert times(stored(container)) == [1000 + k for k in range(200)]
    container.close()


@pytest.mark.parametrize("change", [-300, 300])
def test_a_chunk_whose_stored_size_is_damaged_gives_no_message_twice(
    tmp_path: Path, change: int
) -> None:
    path = tmp_path / "shift.bag"
    write_bag(path, DRIVE, None, 3000)
    block = blocks(path)[2]
    without_bag_index(path)
    overwrite(path, block.offset - 4, struct.pack("<I", block.stored_bytes + change))
    container = BagFile(path)
    found = times(stored(container))
    assert found == sorted(set(found))
    assert len(found) >= 198
    assert len(container.losses) > 1
    container.close()


def test_a_message_of_a_time_that_the_index_does_not_tell_of_is_said(tmp_path: Path) -> None:
    path = tmp_path / "shift.bag"
    write_bag(path, DRIVE, None, 3000)
    overwrite(path, path.read_bytes().index(struct.pack("<II", 0, 1050)), struct.pack("<I", 7))
    with open_log(path) as log:
        assert log.read("/joints0", [])["log_time_ns"][-1] == 7_000_001_050
        assert "messages outside the times that its index gives" in log.losses()[0].what
