"""A check reads everything and believes no index: what it calls whole is whole."""

import struct
from collections.abc import Callable
from pathlib import Path

import polars as pl
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType
from rosbags.rosbag2 import StoragePlugin

from replay import open_log
from replay.logs import LogCheck
from tests.replay.logs.conftest import Write
from tests.replay.logs.damaged import chunks, hide_from_index, overwrite
from tests.replay.logs.one_line import one_line_at_most
from tests.replay.logs.written_logs import Joints, write_bag, write_mcap, write_rosbag2

DRIVE = [
    Joints(1000 + k, {"left": float(k), "right": -float(k)}, topic=f"/joints{k % 2}")
    for k in range(200)
]


def check(path: Path) -> tuple[LogCheck, list[str]]:
    """What was checked, and what was lost."""
    with open_log(path) as log:
        checked = log.check()
        return checked, [str(loss) for loss in log.losses()]


def plain(path: Path) -> list[str]:
    """What `info` says without a check."""
    with open_log(path) as log:
        log.topics()
        return [str(loss) for loss in log.losses()]


def test_a_whole_log_has_no_loss_and_every_message_is_counted(write_log: Write) -> None:
    checked, losses = check(write_log(DRIVE))
    assert losses == []
    assert checked.messages == len(DRIVE)
    assert checked.message_bytes > 50 * len(DRIVE)


def test_the_crcs_of_chunks_summary_and_data_are_compared_and_counted(tmp_path: Path) -> None:
    path = tmp_path / "shift.mcap"
    write_mcap(path, DRIVE, chunk_size=3000, enable_data_crcs=True)
    checked, losses = check(path)
    assert (checked.crcs, losses) == (len(chunks(path)) + 2, [])
    write_mcap(path, DRIVE, chunk_size=3000, enable_crcs=False)
    assert check(path)[0].crcs == 0


def test_a_chunk_that_cannot_be_unpacked_is_what_only_a_check_finds(tmp_path: Path) -> None:
    path = tmp_path / "shift.mcap"
    write_mcap(path, DRIVE, chunk_size=3000, compression=CompressionType.ZSTD)
    chunk = chunks(path)[1]
    overwrite(path, chunk.chunk_start_offset + chunk.chunk_length - 30, b"\xff" * 20)
    assert plain(path) == []
    checked, (loss,) = check(path)
    lost = chunk.message_end_time - chunk.message_start_time + 1
    assert checked.messages == len(DRIVE) - lost
    assert f"at byte {chunk.chunk_start_offset}" in loss


def test_an_index_with_other_log_times_is_found_out(tmp_path: Path) -> None:
    path = tmp_path / "shift.mcap"
    write_mcap(path, DRIVE)
    data = path.read_bytes()
    in_index = data.rindex(struct.pack("<Q", 1100))
    overwrite(path, in_index, struct.pack("<Q", 1101))
    assert plain(path) == []
    assert check(path)[1] == [
        "shift.mcap /joints0: the index lists 100 messages and 100 were found; their number or "
        "their log times differ"
    ]


def test_a_bags_index_with_other_log_times_is_found_out(tmp_path: Path) -> None:
    path = tmp_path / "shift.bag"
    write_bag(path, DRIVE)
    in_index = path.read_bytes().rindex(struct.pack("<II", 0, 1100))
    overwrite(path, in_index, struct.pack("<II", 0, 1102))
    assert plain(path) == []
    assert "or their log times differ" in check(path)[1][0]


def test_a_chunk_that_the_index_leaves_out_is_found(tmp_path: Path) -> None:
    """Without statistics nothing tells how many messages an index should account for."""
    path = tmp_path / "shift.mcap"
    write_mcap(path, DRIVE, chunk_size=3000, use_statistics=False, enable_crcs=False)
    chunk = chunks(path)[-1]
    hide_from_index(path, chunk)
    assert plain(path) == []
    checked, losses = check(path)
    assert checked.messages == chunk.message_start_time - 1000
    assert losses == [
        f"shift.mcap: the index omits the records at byte {chunk.chunk_start_offset}: not read"
    ]


@pytest.mark.heavy
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(at=st.integers(0, 10**6), bit=st.integers(0, 7))
def test_a_flipped_bit_anywhere_in_a_file_with_crcs_is_found(
    tmp_path: Path, at: int, bit: int
) -> None:
    whole = tmp_path / "whole.mcap"
    if not whole.exists():
        write_mcap(whole, DRIVE[:60], chunk_size=2000, enable_data_crcs=True)
        assert check(whole)[1] == []
    data = bytearray(whole.read_bytes())
    data[at % len(data)] ^= 1 << bit
    flipped = tmp_path / "flipped.mcap"
    flipped.write_bytes(data)
    with one_line_at_most():
        assert check(flipped)[1]


def test_a_topic_none_of_whose_messages_can_be_decoded_is_a_loss_and_no_end(tmp_path: Path) -> None:
    path = tmp_path / "shift"
    write_rosbag2(path, DRIVE, StoragePlugin.MCAP)
    file = next(path.glob("*.mcap"))
    data = file.read_bytes()
    # each message of the odd topic says that its list of names is longer than the message
    for k in range(1, 200, 2):
        at = data.index(struct.pack("<d", float(k)))
        overwrite(file, at - 8, b"\xff\xff\xff\x7f")
    checked, (loss,) = check(path)
    assert checked.messages == len(DRIVE)
    assert "/joints1: 100 of 100 messages cannot be decoded" in loss


@pytest.mark.parametrize("write", [pl.DataFrame.write_csv, pl.DataFrame.write_parquet])
def test_of_a_table_every_column_is_read(
    tmp_path: Path, write: Callable[[pl.DataFrame, Path], None]
) -> None:
    path = tmp_path / f"shift.{write.__name__.removeprefix('write_')}"
    table = pl.DataFrame({"time_s": [0.0, 0.1, 0.2], "a": [1.0, 2.0, 3.0], "b": ["1", "x", "3"]})
    write(table, path)
    assert plain(path) == []
    checked, losses = check(path)
    assert checked.messages == 3
    # in Parquet a text is meant to be one
    is_csv = path.suffix == ".csv"
    assert (
        losses
        == [f"{path.name} table: 1 cells of column 'b' are not numbers; the first is 'x'"][
            : int(is_csv)
        ]
    )


def test_a_page_of_a_parquet_file_that_cannot_be_read_is_a_loss(tmp_path: Path) -> None:
    path = tmp_path / "shift.parquet"
    table = pl.DataFrame({"time_s": [k / 10 for k in range(1000)], "a": list(range(1000))})
    table.write_parquet(path, compression="zstd")
    data = path.read_bytes()
    middle = data.rindex(b"\x28\xb5\x2f\xfd")  # the column behind the time
    overwrite(path, middle, bytes(40))
    assert plain(path) == []
    _, (loss,) = check(path)
    assert loss.startswith("shift.parquet table: column 'a' cannot be read")
