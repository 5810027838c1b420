"""ROS 1 bags that are whole, torn, without an index, damaged."""

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from estimators.errors import LogError
from replay import open_log
from tests.replay.logs.damaged import without_bag_index
from tests.replay.logs.one_line import one_line_at_most
from tests.replay.logs.written_logs import Joints, write_bag

DRIVE = [Joints(1000 + k, {"left": float(k)}) for k in range(50)]


def test_a_bag_without_an_index_is_read_from_start_to_end(tmp_path: Path) -> None:
    path = tmp_path / "crashed.bag"
    write_bag(path, DRIVE)
    without_bag_index(path)
    with open_log(path) as log:
        frame = log.read("/joints", ["effort[left]"])
        assert frame["effort[left]"].to_list() == [float(k) for k in range(50)]
        assert log.topics()["messages"].to_list() == [50]
        assert [loss.what for loss in log.losses()] == [
            "the recorder did not finish it: scanned from start to end, all whole messages are "
            "read, the last at log time 0.000001049 s"
        ]


def test_the_chunk_that_a_crashed_recorder_left_open_is_read(tmp_path: Path) -> None:
    path = tmp_path / "crashed.bag"
    write_bag(path, DRIVE)
    without_bag_index(path)
    data = bytearray(path.read_bytes())
    at = data.index(b"size=") + len(b"size=")  # the last field of the only chunk's header
    data[at : at + 4] = bytes(4)
    data[at + 4 : at + 8] = bytes(4)
    path.write_bytes(data[:-200])
    with open_log(path) as log:
        times = log.read("/joints", [])["log_time_ns"].to_list()
    assert times == [1000 + k for k in range(len(times))]
    assert len(times) > 30


def test_a_bag_of_another_version_is_refused_with_the_remedy(tmp_path: Path) -> None:
    (tmp_path / "old.bag").write_bytes(b"#ROSBAG V1.2\n" + bytes(100))
    with pytest.raises(LogError, match=r"a bag of version 1.2.*'rosbag fix old.bag'"):
        open_log(tmp_path / "old.bag")


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(cut=st.integers(10, 20_000), at=st.integers(0, 20_000), value=st.integers(0, 255))
def test_damage_is_a_loss_or_one_line_never_a_traceback(
    tmp_path: Path, cut: int, at: int, value: int
) -> None:
    whole = tmp_path / "whole.bag"
    if not whole.exists():
        write_bag(whole, DRIVE)
    data = bytearray(whole.read_bytes())
    data[at % len(data)] = value
    (tmp_path / "damaged.bag").write_bytes(data[:cut])
    with one_line_at_most(), open_log(tmp_path / "damaged.bag") as log:
        for topic in log.topics()["topic"]:
            log.read(topic, [])
        log.losses()
