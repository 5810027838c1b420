"""The dispatcher: what is no log gets one line with the remedy."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from estimators.errors import LogError
from replay import open_log
from replay.logs.log_formats import OPENERS
from tests.one_line import assert_one_line


def join_to_one_line(path: Path) -> str:
    with pytest.raises(LogError) as caught:
        open_log(path)
    assert_one_line(caught.value)
    message = str(caught.value)
    assert str(path) in message
    return message


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    assert "no such file" in join_to_one_line(tmp_path / "shift.bag")


@pytest.mark.skipif(sys.platform == "darwin", reason="file names there are UTF-8")
def test_a_name_that_is_not_utf_8_is_to_be_changed(tmp_path: Path) -> None:
    latin = Path(os.fsdecode(os.fsencode(tmp_path) + b"/gr\xf6\xdfe.csv"))
    latin.write_text("time_s,force_N\n0,1\n1,2\n")
    with pytest.raises(LogError, match=r"e\.csv: .* not UTF-8, .*; rename the file") as caught:
        open_log(latin)
    assert_one_line(caught.value)
    assert open_log(latin.rename(tmp_path / "größe.csv")).path


def test_an_unknown_suffix_is_answered_with_the_known_ones(tmp_path: Path) -> None:
    (tmp_path / "shift.doc").write_text("hello")
    message = join_to_one_line(tmp_path / "shift.doc")
    assert all(suffix in message for suffix in OPENERS)
    (tmp_path / "shift").write_text("hello")
    assert "no reader for a name without a suffix; supported: .bag" in join_to_one_line(
        tmp_path / "shift"
    )


@pytest.mark.parametrize("suffix", OPENERS)
def test_an_empty_file_is_refused_in_every_format(tmp_path: Path, suffix: str) -> None:
    (tmp_path / f"shift{suffix}").touch()
    assert "empty (0 bytes)" in join_to_one_line(tmp_path / f"shift{suffix}")


@pytest.mark.parametrize(
    ("suffix", "answer"),
    [
        (".bag", "not a ROS 1 bag"),
        (".mcap", "not an MCAP file"),
        (".db3", "not a rosbag2 .db3"),
        (".parquet", "not a parquet table"),
    ],
)
@pytest.mark.parametrize("content", [b"x", b"hello, world, this is a letter\n" * 100])
def test_a_file_that_is_not_what_its_suffix_says_is_refused(
    tmp_path: Path, suffix: str, answer: str, content: bytes
) -> None:
    (tmp_path / f"shift{suffix}").write_bytes(content)
    assert answer in join_to_one_line(tmp_path / f"shift{suffix}")


def test_a_directory_without_bags_says_what_a_bag_directory_holds(tmp_path: Path) -> None:
    assert "metadata.yaml and .mcap or .db3" in join_to_one_line(tmp_path)


def test_a_directory_of_logs_names_them(tmp_path: Path) -> None:
    (tmp_path / "morning.bag").touch()
    (tmp_path / "noon").mkdir()
    (tmp_path / "noon/metadata.yaml").touch()
    (tmp_path / "notes").mkdir()
    assert join_to_one_line(tmp_path).endswith(
        "a folder of logs; give one of them: morning.bag, noon"
    )
    for number in range(9):
        (tmp_path / f"shift_{number}.bag").touch()
    assert join_to_one_line(tmp_path).endswith("shift_5.bag and 3 more")


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"%PDF-1.7\n%\xe2\xe3\xcf\xd3\n1 0 obj", "not a csv table: it is a PDF document"),
        (b"\x89PNG\r\n\x1a\n\0\0", "it is a picture (PNG)"),
        (b"PK\x03\x04\x14\0", "a workbook's name ends in .xlsx"),
        (b"#ROSBAG V2.0\n", "its name ends in .bag"),
    ],
)
def test_another_file_with_the_name_of_a_table_is_named(
    tmp_path: Path, content: bytes, says: str
) -> None:
    (tmp_path / "shift.csv").write_bytes(content)
    assert says in join_to_one_line(tmp_path / "shift.csv")


@pytest.mark.parametrize(
    ("suffix", "content", "says"),
    [
        (".mcap", b"#ROSBAG V2.0\n", "not an MCAP file; it is a ROS 1 bag; its name ends in .bag"),
        (".bag", b"\x89MCAP0\r\n", "not a ROS 1 bag; it is an MCAP file; its name ends in .mcap"),
        (".bag", b"RRF2\0\0", "it is a recording; its name ends in .rrd"),
        (".db3", b"%PDF-1.7", "not a rosbag2 .db3 file; it is a PDF document"),
        (
            ".mcap",
            b"\x89MCAP9\r\n",
            "not an MCAP file; it does not start with the MCAP magic bytes",
        ),
    ],
)
def test_a_log_with_the_name_of_another_format_is_named(
    tmp_path: Path, suffix: str, content: bytes, says: str
) -> None:
    (tmp_path / f"shift{suffix}").write_bytes(content + bytes(200))
    assert says in join_to_one_line(tmp_path / f"shift{suffix}")


def test_importing_the_readers_loads_no_format_library() -> None:
    code = "import replay, sys; print([m for m in ('rosbags', 'mcap', 'rich') if m in sys.modules])"
    answer = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert answer.stdout.strip() == "[]"
