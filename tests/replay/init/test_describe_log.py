"""What `info` says of a log."""

import json
from pathlib import Path
from zoneinfo import ZoneInfo

import pytest
from rich.console import Console

from estimators.errors import LogError
from replay import open_log
from replay.commands.info import print_log_info
from replay.init.describe_log import LogInfo, describe_log_by_index
from tests.one_line import assert_one_line

SANTIAGO = ZoneInfo("America/Santiago")


def shown(info: LogInfo, width: int = 200) -> str:
    console = Console(width=width, color_system=None)
    with console.capture() as capture:
        print_log_info(info, SANTIAGO, console)
    return capture.get()


def test_every_bag_is_described_or_says_why_not(data: Path) -> None:
    refused = {}
    for path in sorted((data / "bags").iterdir()):
        try:
            info = describe_log_by_index(open_log(path))
        except LogError as error:
            assert_one_line(error)
            refused[path.name] = str(error)
            continue
        text = shown(info)
        assert all(topic in text for topic in info.topics["topic"])
        assert json.loads(json.dumps(info.to_dict(), allow_nan=False))["messages"] == info.messages
    assert set(refused) == {"empty-file.bag"}


def test_the_start_is_shown_in_local_time_and_in_seconds(data: Path) -> None:
    text = shown(describe_log_by_index(open_log(data / "logs/husky_asphalt_ros2")))
    held = {"own": "51.990 s, 5,538 messages"}.get(data.name, "51.850 s, 5,524 messages")
    assert "rosbag2 directory" in text
    assert f"from 2023-11-14 19:13:20 -03 (1700000000.000 s), {held}" in text


def test_a_clock_that_starts_at_boot_is_not_shown_as_a_date(data: Path) -> None:
    name = {"own": "since-boot.bag"}.get(data.name, "jackal_imu_odom.bag")
    text = shown(describe_log_by_index(open_log(data / "bags" / name)))
    assert "from 47.580 s of the log's own clock" in text
    assert "1970" not in text


def test_topics_without_a_decoder_are_named_once_with_the_reason(data: Path) -> None:
    text = shown(describe_log_by_index(open_log(data / "bags/topics_and_services.mcap")))
    assert text.count("! /add_two_ints/_service_event: the log holds the definition") == 1
    assert "! /add_two_ints2/_service_event (no messages): the log holds" in text


def test_a_log_without_messages_says_so(tmp_path: Path) -> None:
    (tmp_path / "empty.csv").write_text("time_s,force_N\n")
    info = describe_log_by_index(open_log(tmp_path / "empty.csv"))
    assert (info.messages, info.start_ns, info.duration_s) == (0, None, None)
    assert "no messages" in shown(info)
    assert json.loads(json.dumps(info.to_dict(), allow_nan=False))["duration_s"] is None


def test_a_table_is_described_with_its_rate_gap_and_damage(tmp_path: Path) -> None:
    (tmp_path / "shift.csv").write_text("time_s,a\n0,1\n1,2\n,3\n4,5\n")
    info = describe_log_by_index(open_log(tmp_path / "shift.csv"))
    assert info.topics["longest_gap_s"].to_list() == pytest.approx([3.0])
    assert "! shift.csv: 1 of 4 rows have no time; they were dropped" in shown(info)


def test_a_narrow_screen_cuts_no_topic_and_no_number(data: Path) -> None:
    lines = shown(describe_log_by_index(open_log(data / "logs/husky_asphalt.bag")), width=40)
    numbers = {"own": ("5,200", "51.990")}.get(data.name, ("5,186", "51.850"))
    assert "…" not in lines
    assert all(word in lines for word in ("/imu/data", *numbers, "0.1538"))


def test_one_of_a_thing_is_singular(tmp_path: Path) -> None:
    (tmp_path / "shift.csv").write_text("time_s,a\n0,1\n")
    assert "0.000 s, 1 message\n" in shown(describe_log_by_index(open_log(tmp_path / "shift.csv")))


def test_names_of_strangers_steer_no_terminal_and_break_no_line(tmp_path: Path) -> None:
    path = tmp_path / "a\n\x1b[31mshift.csv"
    path.write_text("time_s,a\n0,1\n,2\n")
    text = shown(describe_log_by_index(open_log(path)))
    assert "\x1b" not in text
    assert "a �[31mshift.csv: CSV table" in text


def test_each_loss_is_one_line_however_long_it_is(tmp_path: Path) -> None:
    path = tmp_path / f"{'long' * 50}.csv"
    path.write_text("time_s,a\n0,1\n,2\n")
    text = shown(describe_log_by_index(open_log(path)))
    assert f"! {path.name}: 1 of 2 rows have no time; they were dropped\n" in text
