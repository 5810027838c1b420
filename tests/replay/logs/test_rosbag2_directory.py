"""rosbag2 directories: split, compressed, without metadata, with metadata that lies."""

import os
from pathlib import Path
from typing import Any

import pytest
import zstandard
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin

from estimators.errors import LogError
from replay import open_log
from tests.replay.logs.one_line import one_line_at_most
from tests.replay.logs.written_logs import Joints, write_mcap, write_rosbag2
from tests.twins import mark_heavy_after

DRIVE = [Joints(1000 + k, {"left": float(k)}) for k in range(30)]
EFFORT = [float(k) for k in range(30)]


@pytest.fixture
def split(tmp_path: Path) -> Path:
    """A recording in three files, whose names do not sort as text."""
    folder = tmp_path / "shift"
    folder.mkdir()
    for number, part in zip((8, 9, 10), (DRIVE[:10], DRIVE[10:20], DRIVE[20:]), strict=True):
        write_mcap(folder / f"shift_{number}.mcap", part)
    return folder


def metadata(folder: Path, *names: str) -> None:
    lines = "".join(f"  - {name}\n" for name in names)
    (folder / "metadata.yaml").write_text(
        "rosbag2_bagfile_information:\n"
        f"  version: 5\n  storage_identifier: mcap\n  relative_file_paths:\n{lines}"
        "  topics_with_message_count:\n"
        "  - message_count: 0\n    topic_metadata:\n      name: /silent\n"
        "      type: std_msgs/msg/String\n      serialization_format: cdr\n"
    )


def test_without_metadata_the_files_are_read_by_number_and_a_loss_says_that_some_may_lack(
    split: Path,
) -> None:
    log = open_log(split)
    assert [file.name for file in log.files] == [f"shift_{n}.mcap" for n in (8, 9, 10)]
    assert log.read("/joints", ["effort[left]"])["effort[left]"].to_list() == EFFORT
    (loss,) = log.losses()
    assert loss.source == "metadata.yaml"
    assert "others may be missing" in loss.what


def test_metadata_gives_the_order_and_the_topics_that_stayed_silent(split: Path) -> None:
    metadata(split, "shift_8.mcap", "shift/shift_9.mcap", "shift_10.mcap")
    log = open_log(split)
    assert dict(log.topics().select("topic", "messages").rows()) == {"/joints": 30, "/silent": 0}
    assert log.read("/silent", ["data"]).is_empty()
    assert log.files[0].name == "metadata.yaml"


@pytest.mark.parametrize(("old", "new"), [("- shift", "[unclosed"), ("/silent", '"\\uD800"')])
def test_broken_metadata_is_a_loss_and_the_files_are_read(split: Path, old: str, new: str) -> None:
    metadata(split, "shift_8.mcap", "shift_9.mcap", "shift_10.mcap")
    yaml = split / "metadata.yaml"
    yaml.write_text(yaml.read_text().replace(old, new))
    log = open_log(split)
    assert log.read("/joints", ["effort[left]"])["effort[left]"].to_list() == EFFORT
    assert "the files are read in the order of their names" in log.losses()[0].what


@pytest.mark.parametrize(
    ("text", "fault"),
    mark_heavy_after(
        1,
        [
            ("", "its layout is not that of rosbag2"),
            ("[" * 20_000, "it is nested too deeply"),
            ("a: b", "the key 'rosbag2_bagfile_information' is missing"),
            ("a: b\nc: [d", "expected ',' or ']', but got '<stream end>' on line 2"),
        ],
    ),
    ids=["empty", "deep", "another", "torn"],
)
def test_what_is_wrong_with_metadata_is_said_in_words(split: Path, text: str, fault: str) -> None:
    (split / "metadata.yaml").write_text(text)
    assert (
        open_log(split)
        .losses()[0]
        .what.endswith(f"the files are read in the order of their names: {fault}")
    )


def test_metadata_that_is_a_pipe_is_not_waited_for(split: Path) -> None:
    os.mkfifo(split / "metadata.yaml")
    assert open_log(split).losses()[0].what.endswith("it is not a file")


def test_a_file_that_metadata_names_twice_is_read_once(split: Path) -> None:
    metadata(split, "shift_8.mcap", "shift_8.mcap", "shift_9.mcap", "shift_10.mcap")
    log = open_log(split)
    assert log.read("/joints", ["effort[left]"])["effort[left]"].to_list() == EFFORT
    assert log.losses()[0].what == "names shift_8.mcap 2 times; it is read once"


def test_a_file_that_metadata_leaves_out_is_a_loss(split: Path) -> None:
    metadata(split, "shift_8.mcap", "shift_9.mcap")
    (loss, *_) = open_log(split).losses()
    assert str(loss) == "shift_10.mcap: not read: metadata.yaml does not name it"


def test_logs_of_one_time_in_a_folder_are_told_to_be_no_parts_of_one_recording(
    tmp_path: Path,
) -> None:
    for name in ("a.mcap", "b.mcap"):
        write_mcap(tmp_path / name, [Joints(k * 10**9, {"left": 1.0}) for k in range(5)])
    log = open_log(tmp_path)
    assert log.topics()["messages"].to_list() == [10]
    assert [str(loss) for loss in log.losses()][1].startswith(
        "b.mcap: begins 4.000 s before a.mcap ends"
    )


def test_of_a_file_and_its_compressed_copy_one_is_read(split: Path) -> None:
    (split / "shift_8.mcap.zstd").write_bytes(b"the recorder ended while it wrote this")
    log = open_log(split)
    assert log.read("/joints", ["effort[left]"])["effort[left]"].to_list() == EFFORT


def test_a_compressed_file_that_grows_without_end_is_named_by_its_own_name(split: Path) -> None:
    for file in split.glob("*.mcap"):
        file.unlink()
    bomb = zstandard.compress(bytes(64 * 2**20))
    (split / "shift_8.mcap.zstd").write_bytes(bomb)
    with pytest.raises(LogError, match=r"shift_8.mcap.zstd: .*it grows beyond") as raised:
        open_log(split)
    assert "payscope-" not in str(raised.value)


def test_a_missing_and_a_broken_file_are_losses_and_the_rest_is_read(split: Path) -> None:
    metadata(split, "shift_8.mcap", "shift_9.mcap", "shift_10.mcap", "shift_11.mcap")
    (split / "shift_8.mcap").write_bytes(b"not an mcap file")
    log = open_log(split)
    assert log.read("/joints", ["effort[left]"])["effort[left]"].to_list() == EFFORT[10:]
    assert [loss.source for loss in log.losses()] == ["shift_8.mcap", "shift_11.mcap"]


def test_when_no_file_can_be_read_the_directory_is_refused_in_one_line(split: Path) -> None:
    for file in split.glob("*.mcap"):
        file.write_bytes(b"")
    with pytest.raises(LogError, match="none of its bag files can be read"):
        open_log(split)


@pytest.mark.parametrize("name", ["../secret.mcap", "/etc/secret.mcap", "a/../../secret.mcap"])
def test_metadata_may_not_name_files_outside_its_folder(split: Path, name: str) -> None:
    write_mcap(split.parent / "secret.mcap", DRIVE)
    metadata(split, name)
    with pytest.raises(LogError, match="outside its folder"):
        open_log(split)


@pytest.mark.parametrize("mode", [CompressionMode.FILE, CompressionMode.MESSAGE])
@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_compressed_files_and_messages_are_read(tmp_path: Path, mode: Any, storage: Any) -> None:
    compression = {"mode": mode, "fmt": CompressionFormat.ZSTD}
    write_rosbag2(tmp_path / "shift", DRIVE, storage, **compression)
    with open_log(tmp_path / "shift") as log:
        assert log.read("/joints", ["effort[left]"])["effort[left]"].to_list() == EFFORT


def test_a_torn_compressed_file_is_read_up_to_the_tear(tmp_path: Path) -> None:
    compression = {"mode": CompressionMode.FILE, "fmt": CompressionFormat.ZSTD}
    write_rosbag2(tmp_path / "shift", DRIVE, StoragePlugin.MCAP, **compression)
    packed = next((tmp_path / "shift").glob("*.zstd"))
    packed.write_bytes(packed.read_bytes()[:-50])
    with one_line_at_most(), open_log(tmp_path / "shift") as log:
        assert log.losses()
