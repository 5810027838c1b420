"""Damaged recordings of rosbag2: every whole message is kept, and what was lost is said."""

import sqlite3
import struct
from pathlib import Path

import pytest
import zstandard
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin

from replay import open_log
from replay.logs.sqlite.sqlite_file import Db3File
from tests.replay.logs.damaged import DRIVE, overwrite
from tests.replay.logs.stored import stored, times
from tests.replay.logs.written_logs import Joints, write_db3, write_rosbag2


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


@pytest.mark.heavy
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
        (100, 120, ["counts 120 messages, but 100 were found"] * 2),
        (100, 90, ["counts 90 messages, but 100 were found"] * 2),
        (200, 240, ["counts 240 messages in all, but 200 were found"]),
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
