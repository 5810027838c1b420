"""Damaged MCAP files: every whole message is kept, and what was lost is said."""

import struct
import tracemalloc
from pathlib import Path

import pytest
import zstandard
from mcap.writer import CompressionType

from replay import open_log
from replay.logs.mcap.mcap_file import McapFile
from tests.replay.logs.damaged import DRIVE, chunks, overwrite, without_footer
from tests.replay.logs.stored import stored, times
from tests.replay.logs.written_logs import write_mcap


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
    assert missed.what == f"its statistics count 200 messages, but {200 - lost} were found"
    assert torn.what.startswith("its summary cannot be read")


def test_a_message_of_a_time_that_cannot_be_is_said_where_the_index_tells_another(
    tmp_path: Path,
) -> None:
    path = tmp_path / "shift.mcap"
    write_mcap(path, DRIVE, compression=CompressionType.NONE, enable_crcs=False)
    overwrite(path, path.read_bytes().index(struct.pack("<QQ", 1050, 1050)), b"\xff" * 8)
    with open_log(path) as log:
        assert log.read("/joints0", []).height == 99
        assert "messages outside the times that its index gives" in log.losses()[0].what


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


def test_message_indexes_are_not_needed_for_rows_and_unpacked_chunks_take_their_place(
    tmp_path: Path,
) -> None:
    path = tmp_path / "shift.mcap"
    write_mcap(path, DRIVE, chunk_size=3000)
    with open_log(path) as log:
        whole, described = log.read("/joints0", ["effort[left]"]), log.topics()
    for chunk in chunks(path):
        behind = chunk.chunk_start_offset + chunk.chunk_length
        overwrite(path, behind, b"\xff" * chunk.message_index_length)
    with open_log(path) as log:
        assert log.read("/joints0", ["effort[left]"]).equals(whole)
        assert log.topics().equals(described)
        assert log.losses() == ()


def test_a_chunk_that_says_other_times_than_the_summary_is_unpacked_for_its_own(
    tmp_path: Path,
) -> None:
    path = tmp_path / "shift.mcap"
    write_mcap(path, DRIVE, chunk_size=3000)
    chunk = chunks(path)[1]
    first = chunk.message_start_time
    overwrite(path, chunk.chunk_start_offset + 9, struct.pack("<Q", chunk.message_end_time))
    with open_log(path) as log:
        rows = [log.read(topic, [], first, first).height for topic in ("/joints0", "/joints1")]
        assert sum(rows) == 1
        assert log.losses() == ()


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
