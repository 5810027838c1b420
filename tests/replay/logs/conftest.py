"""Logs in every format."""

from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
from rosbags.rosbag2 import StoragePlugin

from tests.replay.logs.written_logs import Joints, write_bag, write_db3, write_mcap, write_rosbag2

Write = Callable[[Sequence[Joints]], Path]


@pytest.fixture(params=["bag", "mcap", "mcap_ros1", "db3", "rosbag2_mcap", "rosbag2_db3"])
def write_log(request: pytest.FixtureRequest, tmp_path: Path) -> Write:
    """Writes a log in each of the formats that hold messages."""

    def write(recorded: Sequence[Joints]) -> Path:
        match request.param:
            case "bag":
                write_bag(path := tmp_path / "shift.bag", recorded)
            case "mcap":
                write_mcap(path := tmp_path / "shift.mcap", recorded)
            case "mcap_ros1":
                write_mcap(path := tmp_path / "shift.mcap", recorded, ros1=True)
            case "db3":
                write_db3(path := tmp_path / "shift.db3", recorded)
            case "rosbag2_mcap":
                write_rosbag2(path := tmp_path / "shift", recorded, StoragePlugin.MCAP)
            case _:
                write_rosbag2(path := tmp_path / "shift", recorded, StoragePlugin.SQLITE3)
        return path

    return write
