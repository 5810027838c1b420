"""ROS 1 bags that are whole, torn, without an index, damaged."""

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from estimators.errors import LogError
from replay import open_log
from tests.replay.readers.one_line import one_line_at_most
from tests.replay.readers.written_logs import Joints, write_bag

DRIVE = [Joints(1000 + k, {"left": float(k)}) for k in range(50)]


def test_a_bag_without_an_index_is_refused_with_the_remedy(tmp_path: Path) -> None:
    path = tmp_path / "crashed.bag"
    write_bag(path, DRIVE)
    data = path.read_bytes()
    at = data.index(b"index_pos=") + len(b"index_pos=")
    path.write_bytes(data[:at] + bytes(8) + data[at + 8 :])
    with pytest.raises(LogError, match=r"not indexed.*'rosbag reindex crashed.bag' may help"):
        open_log(path)


def test_a_bag_of_another_version_is_refused(tmp_path: Path) -> None:
    (tmp_path / "old.bag").write_bytes(b"#ROSBAG V1.2\n" + bytes(100))
    with pytest.raises(LogError, match="version 102 is not supported"):
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
