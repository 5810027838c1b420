"""Damage is a normal case: every whole message is kept, and what was lost is said."""

import sqlite3
import struct
import tracemalloc
from pathlib import Path
from typing import Any

import pytest
import zstandard
from mcap.writer import CompressionType
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin

from replay import open_log
from replay.readers.containers.bag_file import BagFile
from replay.readers.containers.db3_file import Db3File
from replay.readers.containers.mcap_file import McapFile
from tests.replay.readers.damaged import chunks, overwrite, without_bag_index, without_footer
from tests.replay.readers.stored import stored
from tests.replay.readers.written_logs import (
    Joints,
    write_bag,
    write_db3,
    write_mcap,
    write_rosbag2,
)

DRIVE = [
    Joints(1000 + k, {"left": float(k), "right": -float(k)}, topic=f"/joints{k % 2}")
    for k in range(200)
]


def times(messages: list) -> list[int]:
    return sorted(time for _, time, _ in messages)


def read(path: Path) -> list:
    container = McapFile(path)
    found = stored(container)
    container.close()
    return found


@pytest.mark.parametrize("chunked", [False, True])
def test_an_uncompressed_mcap_torn_anywhere_keeps_every_message_before_the_tear(
    tmp_path: Path, chunked: bool
) -> None:
    path, torn = tmp_path / "whole.mcap", tmp_path / "torn.mcap"
    write_mcap(path, DRIVE, use_chunking=chunked, chunk_size=3000, compression=CompressionType.NONE)
    data = path.read_bytes()
    container = McapFile(path)
    ends = [data.index(message) + len(message) for *_, message in stored(container)]
    container.close()
    for cut in range(8, len(data), 397):
        torn.write_bytes(data[:cut])
        container = McapFile(torn)
        assert len(stored(container)) == sum(end <= cut for end in ends), cut
        assert container.losses
        container.close()


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


def test_a_wrong_crc_costs_its_chunk_and_says_how_many_messages_of_which_topic(
    tmp_path: Path,
) -> None:
    path = tmp_path / "shift.mcap"
    write_mcap(path, DRIVE, chunk_size=3000)
    chunk = chunks(path)[2]
    overwrite(path, chunk.chunk_start_offset + 9 + 24, b"\x01\x02\x03\x04")
    container = McapFile(path)
    lost = set(range(chunk.message_start_time, chunk.message_end_time + 1))
    assert set(times(stored(container))) == {1000 + k for k in range(200)} - lost
    (loss,) = container.losses
    assert f"at byte {chunk.chunk_start_offset} ({chunk.compressed_size:,} bytes)" in loss.what
    assert f"lost from log time 0.{chunk.message_start_time:09} s" in loss.what
    even = sum(time % 2 == 0 for time in lost)
    assert f"{even} of /joints0, {len(lost) - even} of /joints1" in loss.what
    container.close()


@pytest.mark.parametrize("offset", [0, 1, 50])
@pytest.mark.parametrize("compression", [CompressionType.NONE, CompressionType.ZSTD])
def test_without_an_index_records_are_found_again_behind_damage(
    tmp_path: Path, offset: int, compression: CompressionType
) -> None:
    path = tmp_path / "shift.mcap"
    write_mcap(path, DRIVE, chunk_size=3000, compression=compression)
    damaged = chunks(path)[2]
    without_footer(path)
    overwrite(path, damaged.chunk_start_offset + offset, b"\xff" * 12)
    container = McapFile(path)
    lost = range(damaged.message_start_time, damaged.message_end_time + 1)
    assert set(times(stored(container))) >= {1000 + k for k in range(200)} - set(lost)
    assert len(container.losses) >= 2
    container.close()


def test_a_bag_without_an_index_is_found_again_behind_damage(tmp_path: Path) -> None:
    path = tmp_path / "shift.bag"
    write_bag(path, DRIVE, None, 3000)
    container = BagFile(path)
    blocks = container._store._blocks
    container.close()
    without_bag_index(path)
    overwrite(path, blocks[2].record_offset, b"\xff" * 20)
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
    assert any("are no whole records" in what for what in whats)
    assert any("where its index counts" in what for what in whats)
    container.close()


@pytest.mark.parametrize("chunked", [False, True])
@pytest.mark.parametrize("first_opcode", [0x03, 0x05])
def test_a_damaged_summary_does_not_rename_the_topics_of_the_data(
    tmp_path: Path, chunked: bool, first_opcode: int
) -> None:
    path = tmp_path / "shift.mcap"
    write_mcap(path, DRIVE, use_chunking=chunked)
    whole = read(path)
    data = path.read_bytes()
    overwrite(path, data.rindex(b"/joints1"), b"/jointsX")
    overwrite(path, int.from_bytes(data[-28:-20], "little"), bytes([first_opcode]))
    container = McapFile(path)
    assert stored(container) == whole
    container.close()


@pytest.mark.parametrize("declared", [2**40, 2**63, 2**64 - 1, 2**29, 1])
def test_a_chunk_that_lies_about_its_size_is_refused_and_costs_no_memory(
    tmp_path: Path, declared: int
) -> None:
    path = tmp_path / "bomb.mcap"
    write_mcap(path, DRIVE, chunk_size=3000)
    chunk = chunks(path)[1]
    overwrite(path, chunk.chunk_start_offset + 9 + 16, struct.pack("<Q", declared))
    container = McapFile(path)
    lost = chunk.message_end_time - chunk.message_start_time + 1
    assert len(stored(container)) == len(DRIVE) - lost
    assert len(container.losses) == 1
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


def test_a_wrong_crc_of_messages_outside_chunks_is_said(tmp_path: Path) -> None:
    path = tmp_path / "shift.mcap"
    write_mcap(path, DRIVE, use_chunking=False, enable_data_crcs=True)
    whole = McapFile(path)
    assert whole.losses == ()
    whole.close()
    overwrite(path, path.read_bytes().index(struct.pack("<d", 50.0)), struct.pack("<d", 51.0))
    container = McapFile(path)
    assert len(stored(container)) == len(DRIVE)
    assert ["the CRC of its data is wrong" in loss.what for loss in container.losses] == [True]
    container.close()


def test_a_chunk_that_unpacks_to_more_than_it_declares_is_stopped_there(tmp_path: Path) -> None:
    path = tmp_path / "bomb.mcap"
    write_mcap(path, DRIVE, chunk_size=3000)
    without_footer(path)
    bomb = zstandard.compress(bytes(2**30))
    head = struct.pack("<QQQII", 1, 2, 1000, 0, 4) + b"zstd" + struct.pack("<Q", len(bomb))
    record = b"\x06" + struct.pack("<Q", len(head) + len(bomb)) + head + bomb
    path.write_bytes(path.read_bytes() + record)
    tracemalloc.start()
    container = McapFile(path)
    assert len(stored(container)) == len(DRIVE)
    assert tracemalloc.get_traced_memory()[1] < 100e6
    tracemalloc.stop()
    assert any("more than the 1,000 bytes it declares" in loss.what for loss in container.losses)
    container.close()


@pytest.mark.parametrize("opcode", [0x01, 0x02, 0x0F])
def test_a_chunk_that_damage_made_an_end_of_the_file_does_not_end_it(
    tmp_path: Path, opcode: int
) -> None:
    path = tmp_path / "shift.mcap"
    write_mcap(path, DRIVE, chunk_size=3000)
    damaged = chunks(path)[2]
    without_footer(path)
    overwrite(path, damaged.chunk_start_offset, bytes([opcode]))
    container = McapFile(path)
    lost = range(damaged.message_start_time, damaged.message_end_time + 1)
    assert set(times(stored(container))) == {1000 + k for k in range(200)} - set(lost)
    container.close()


def test_a_chunk_that_vanished_with_the_index_is_missed_by_the_statistics(tmp_path: Path) -> None:
    path = tmp_path / "shift.mcap"
    write_mcap(path, DRIVE, chunk_size=3000, enable_crcs=False)
    second, third = chunks(path)[1:3]
    data = path.read_bytes()
    path.write_bytes(data[: second.chunk_start_offset] + data[third.chunk_start_offset :])
    container = McapFile(path)
    lost = second.message_end_time - second.message_start_time + 1
    assert len(stored(container)) == 200 - lost
    missed, torn = container.losses
    container.close()
    assert missed.what == f"its statistics count 200 messages, {200 - lost} are there"
    assert torn.what.startswith("its summary cannot be read")


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
    assert any("are no whole records" in loss.what for loss in container.losses)
    container.close()


def test_a_chunk_of_a_bag_whose_size_takes_thousands_of_bytes_costs_itself(tmp_path: Path) -> None:
    path = tmp_path / "shift.bag"
    write_bag(path, DRIVE, Writer1.CompressionFormat.LZ4, 3000)
    container = BagFile(path)
    block = container._store._blocks[2]
    container.close()
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
    container = BagFile(path)
    block = container._store._blocks[2]
    container.close()
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
    container = BagFile(path)
    block = container._store._blocks[2]
    container.close()
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
        assert "of times that its index does not tell of" in log.losses()[0].what


def test_a_message_of_a_time_that_cannot_be_is_said_where_the_index_tells_another(
    tmp_path: Path,
) -> None:
    path = tmp_path / "shift.mcap"
    write_mcap(path, DRIVE, compression=CompressionType.NONE, enable_crcs=False)
    overwrite(path, path.read_bytes().index(struct.pack("<QQ", 1050, 1050)), b"\xff" * 8)
    with open_log(path) as log:
        assert log.read("/joints0", []).height == 99
        assert "of times that its index does not tell of" in log.losses()[0].what


def test_an_index_that_hides_messages_is_not_used_where_a_chunk_is_lost_either(
    tmp_path: Path,
) -> None:
    path = tmp_path / "shift.mcap"
    write_mcap(path, DRIVE, chunk_size=3000)
    hidden, lost = chunks(path)[1:3]
    overwrite(path, lost.chunk_start_offset, b"\xff" * 9)
    overwrite(path, min(hidden.message_index_offsets.values()) + 9 + 2, bytes(4))
    with open_log(path) as log:
        found = [log.read(topic, [])["log_time_ns"] for topic in ("/joints0", "/joints1")]
    assert sorted([*found[0], *found[1]]) == [
        j.log_time_ns
        for j in DRIVE
        if not lost.message_start_time <= j.log_time_ns <= lost.message_end_time
    ]


def test_many_damaged_chunks_are_told_in_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "shift.mcap"
    write_mcap(path, DRIVE, chunk_size=300)
    for chunk in chunks(path):
        overwrite(path, chunk.chunk_start_offset + 9 + 24, b"\x01\x02\x03\x04")
    container = McapFile(path)
    assert stored(container) == []
    (loss,) = container.losses
    assert "100 of /joints0, 100 of /joints1" in loss.what
    container.close()


def test_a_damaged_page_of_a_database_costs_its_rows_and_says_which(tmp_path: Path) -> None:
    path = tmp_path / "shift.db3"
    many = [Joints(1000 + k, {"left": float(k)}) for k in range(3000)]
    write_db3(path, many)
    data = bytearray(path.read_bytes())
    page = data.index(struct.pack("<d", 1500.0)) // 4096
    data[page * 4096 : (page + 1) * 4096] = b"\xff" * 4096
    path.write_bytes(data)
    container = Db3File(path)
    found = times(stored(container))
    assert 2900 < len(found) < 3000
    assert (found[0], found[-1]) == (1000, 3999)
    (loss,) = container.losses
    assert "the database is damaged" in loss.what
    assert "are lost" in loss.what
    container.close()


def test_values_that_are_no_messages_cost_their_rows(tmp_path: Path) -> None:
    path = tmp_path / "shift.db3"
    write_db3(path, DRIVE)
    with sqlite3.connect(path) as database:
        database.execute("UPDATE messages SET data = 'text' WHERE timestamp = 1007")
        database.execute("UPDATE messages SET timestamp = 'soon' WHERE timestamp = 1009")
        database.execute("UPDATE messages SET timestamp = -5 WHERE timestamp = 1011")
    database.close()
    container = Db3File(path)
    left = {1000 + k for k in range(200)} - {1007, 1009, 1011}
    assert set(times(stored(container))) == left
    assert any("hold no message" in loss.what for loss in container.losses)
    assert sum(container.log_times(c.id).size for c in container.connections) == 198
    assert any("before the year 1970" in loss.what for loss in container.losses)
    container.close()


def test_a_message_that_cannot_be_unpacked_costs_itself(tmp_path: Path) -> None:
    folder = tmp_path / "shift"
    options = {"mode": CompressionMode.MESSAGE, "fmt": CompressionFormat.ZSTD}
    write_rosbag2(folder, DRIVE, StoragePlugin.SQLITE3, **options)
    file = next(folder.glob("*.db3"))
    data = file.read_bytes()
    frame = data.index(b"\x28\xb5\x2f\xfd", data.index(b"\x28\xb5\x2f\xfd") + 1)
    overwrite(file, frame, bytes(4))
    with open_log(folder) as log:
        heights = [log.read(topic, []).height for topic in ("/joints0", "/joints1")]
        assert sum(heights) == len(DRIVE) - 1
        assert any("1 messages cannot be decompressed" in loss.what for loss in log.losses())


def test_a_compressed_file_that_grows_beyond_measure_is_stopped(tmp_path: Path) -> None:
    folder = tmp_path / "shift"
    options = {"mode": CompressionMode.FILE, "fmt": CompressionFormat.ZSTD}
    write_rosbag2(folder, DRIVE, StoragePlugin.MCAP, **options)
    packed = next(folder.glob("*.zstd"))
    whole = zstandard.ZstdDecompressor().stream_reader(packed.read_bytes()).read()
    packed.write_bytes(zstandard.compress(whole + bytes(300 * 2**20)))
    with open_log(folder) as log:
        assert log.topics()["messages"].sum() == len(DRIVE)
        assert any("it grows beyond" in loss.what for loss in log.losses())


@pytest.mark.parametrize(
    ("counted", "instead", "whats"),
    [
        (100, 120, ["counts 120 messages, 100 are there"] * 2),
        (100, 90, ["counts 90 messages, 100 are there"] * 2),
        (200, 240, ["counts 240 messages in all, 200 are there"]),
    ],
)
@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_metadata_that_counts_other_messages_is_a_loss(
    tmp_path: Path, storage: StoragePlugin, counted: int, instead: int, whats: list[str]
) -> None:
    folder = tmp_path / "shift"
    write_rosbag2(folder, DRIVE, storage)
    yaml = folder / "metadata.yaml"
    said = f"message_count: {counted}"
    yaml.write_text(yaml.read_text().replace(said, f"message_count: {instead}"))
    with open_log(folder) as log:
        assert [loss.what for loss in log.losses()] == whats
