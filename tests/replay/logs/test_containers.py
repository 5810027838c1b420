"""Every layout of every container gives the bytes that the official readers give."""

from pathlib import Path
from typing import Any

import pytest
from mcap.writer import CompressionType, IndexType
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin

from replay.logs.bag.bag_file import BagFile
from replay.logs.mcap.mcap_file import McapFile
from replay.logs.rosbag2.rosbag2_directory import Rosbag2Directory
from replay.logs.sqlite.sqlite_file import Db3File
from tests.replay.logs.damaged import without_bag_index, without_footer
from tests.replay.logs.stored import official_bag, official_mcap, official_rosbag2, stored
from tests.replay.logs.written_logs import Joints, write_bag, write_db3, write_mcap, write_rosbag2

DRIVE = [
    Joints(1000 + k, {"left": float(k), "right": -float(k)}, topic=f"/joints{k % 3}")
    for k in range(600)
]
#: bz2 is not among those of MCAP
MCAP = [CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD]
MCAP_LAYOUTS = {
    "chunked": {},
    "small_chunks": {"chunk_size": 900},
    "unchunked": {"use_chunking": False},
    "without_message_index": {"index_types": IndexType.CHUNK},
    "without_chunk_index": {"index_types": IndexType.MESSAGE},
    "without_any_index": {"index_types": IndexType.NONE},
    "without_repeated_channels": {"repeat_channels": False},
    "without_repeated_schemas": {"repeat_schemas": False},
    "without_statistics": {"use_statistics": False},
    "without_crc": {"enable_crcs": False},
    "without_summary_offsets": {"use_summary_offsets": False},
}


@pytest.mark.parametrize("compression", MCAP, ids=lambda each: each.name)
@pytest.mark.parametrize("layout", MCAP_LAYOUTS)
def test_every_layout_of_mcap(tmp_path: Path, compression: CompressionType, layout: str) -> None:
    path = tmp_path / "shift.mcap"
    write_mcap(path, DRIVE, compression=compression, **MCAP_LAYOUTS[layout])
    container = McapFile(path)
    assert stored(container) == official_mcap(path)
    assert sum(container.log_times(c.id).size for c in container.connections) == len(DRIVE)
    assert container.losses == ()
    container.close()


@pytest.mark.parametrize("ros1", [False, True])
@pytest.mark.parametrize("chunked", [False, True])
def test_mcap_without_footer_of_either_profile(tmp_path: Path, ros1: bool, chunked: bool) -> None:
    path = tmp_path / "shift.mcap"
    write_mcap(path, DRIVE, ros1=ros1, use_chunking=chunked, chunk_size=2000)
    whole = official_mcap(path)
    without_footer(path)
    container = McapFile(path)
    assert stored(container) == whole
    assert "without a footer" in container.losses[0].what
    container.close()


@pytest.mark.parametrize("compression", [None, *Writer1.CompressionFormat], ids=str)
@pytest.mark.parametrize("chunk_bytes", [2000, None])
@pytest.mark.parametrize("indexed", [True, False])
def test_every_layout_of_ros1_bags(
    tmp_path: Path, compression: Any, chunk_bytes: int | None, indexed: bool
) -> None:
    path = tmp_path / "shift.bag"
    write_bag(path, DRIVE, compression, chunk_bytes)
    whole = official_bag(path)
    if not indexed:
        without_bag_index(path)
    container = BagFile(path)
    assert stored(container) == whole
    assert sum(container.log_times(c.id).size for c in container.connections) == len(DRIVE)
    assert [c.topic for c in container.connections] == ["/joints0", "/joints1", "/joints2"]
    assert indexed == (container.losses == ())
    container.close()


def test_sqlite_files(tmp_path: Path) -> None:
    write_rosbag2(tmp_path / "shift", DRIVE, StoragePlugin.SQLITE3)
    container = Db3File(next((tmp_path / "shift").glob("*.db3")))
    assert stored(container) == official_rosbag2(tmp_path / "shift")
    container.close()


@pytest.mark.parametrize(
    "mode", [CompressionMode.NONE, CompressionMode.FILE, CompressionMode.MESSAGE]
)
@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_rosbag2_directories(tmp_path: Path, mode: Any, storage: Any) -> None:
    options = {} if mode == CompressionMode.NONE else {"mode": mode, "fmt": CompressionFormat.ZSTD}
    write_rosbag2(tmp_path / "shift", DRIVE, storage, **options)
    container = Rosbag2Directory(tmp_path / "shift")
    assert stored(container) == official_rosbag2(tmp_path / "shift")
    assert container.losses == []
    container.close()


@pytest.mark.parametrize(
    ("start_ns", "end_ns"), [(None, None), (1100, 1200), (1600, None), (None, 999), (-5, 2**63 - 1)]
)
def test_both_bounds_cut_every_container_alike(
    tmp_path: Path, start_ns: int | None, end_ns: int | None
) -> None:
    write_mcap(tmp_path / "shift.mcap", DRIVE, chunk_size=2000)
    write_bag(tmp_path / "shift.bag", DRIVE, None, 2000)
    write_db3(tmp_path / "shift.db3", DRIVE)
    first, last = start_ns or 0, 2**63 if end_ns is None else end_ns
    expected = [j.log_time_ns for j in DRIVE if first <= j.log_time_ns <= last]
    for container in (
        McapFile(tmp_path / "shift.mcap"),
        BagFile(tmp_path / "shift.bag"),
        Db3File(tmp_path / "shift.db3"),
    ):
        assert sorted(m[1] for m in stored(container, start_ns, end_ns)) == expected
        container.close()


def test_a_message_larger_than_what_is_read_at_once_is_whole(tmp_path: Path) -> None:
    large = [Joints(k, {"x" * 9_000_000: 1.0}) for k in range(3)]
    for chunked in (False, True):
        path = tmp_path / "large.mcap"
        write_mcap(path, large, use_chunking=chunked)
        container = McapFile(path)
        assert stored(container) == official_mcap(path)
        container.close()
