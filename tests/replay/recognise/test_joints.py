"""What `init` drafts for a JointState, of wheels and of other joints."""

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from analysis.model.machine import Machine
from benchmarks.dialects.dialect_file import DRIVE, MASS_KG
from replay.init.guess_machine import draft_machine_file
from replay.logs import open_log
from replay.pipeline import run

RADIUS_M = 0.2
_KIND = "sensor_msgs/msg/JointState"


def _written(folder: Path, names: Sequence[str], rows: int | None = 50) -> Path:
    """A log of joints of which those of wheels share the drive's force and turn with its speed."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    types: Any = store.types
    turning = np.array(["arm" not in name for name in names], dtype=float)
    drive = (DRIVE[key][:rows].tolist() for key in ("t", "v", "F"))
    with Writer(folder / "log", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection("/joint_states", _KIND, typestore=store)
        for t, v, force in zip(*drive, strict=True):
            stamp_ns = 1_700_000_000 * 10**9 + round(t * 1e9)
            seconds, nanoseconds = divmod(stamp_ns, 10**9)
            stamp = types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)
            message = types[_KIND](
                header=types["std_msgs/msg/Header"](stamp=stamp, frame_id=""),
                name=list(names),
                position=turning,
                velocity=turning * v / RADIUS_M,
                effort=turning * force * RADIUS_M / turning.sum(),
            )
            writer.write(topic, stamp_ns, store.serialize_cdr(message, _KIND))
    return folder / "log"


def _drafted(path: Path) -> tuple[dict[str, dict[str, Any]], list[str]]:
    with open_log(path) as log:
        text, questions = draft_machine_file(log, None)
    return tomllib.loads(text).get("channels", {}), questions


SIDES = ("left", "right")
WHEELS = {
    "two": ["left_wheel_joint", "right_wheel_joint"],
    "four": ["front_left_wheel", "front_right_wheel", "rear_left_wheel", "rear_right_wheel"],
    "four, short": ["fl_wheel", "fr_wheel", "rl_wheel", "rr_wheel"],
    "named by the corner": ["fl", "fr", "rl", "rr"],
    "by the corner, six": [f"{side}{axle}_joint" for side in "lr" for axle in "fmb"],
    "by the corner, in words": [f"{axle}_{side}" for axle in ("front", "back") for side in SIDES],
    "behind an arm": [*(f"arm_{k}" for k in range(9)), "wheel_left", "wheel_right"],
}


@pytest.mark.parametrize("names", WHEELS.values(), ids=WHEELS)
def test_wheels_are_drafted_by_their_sides_and_their_unit_is_asked(
    names: list[str], tmp_path: Path
) -> None:
    channels, questions = _drafted(_written(tmp_path, names))
    assert {f"{what}_{side}" for what in ("torque", "speed") for side in ("left", "right")} <= {
        name.removesuffix("_m_s").removesuffix("_N_m") for name in channels
    }
    assert [word in each for word, each in zip(("radius", "rad/s"), questions, strict=True)] == [
        True,
        True,
    ]


def test_the_draft_of_a_machine_with_sides_has_its_yaw_rate_ready(tmp_path: Path) -> None:
    with open_log(_written(tmp_path, ["left_wheel", "right_wheel"])) as log:
        text, _ = draft_machine_file(log, None)
    ready = text.replace("# track_width_m", "track_width_m").replace(
        "# wheel_radius", "wheel_radius"
    )
    for line in ("[channels.yaw_rate_rad_s]", 'derive = "(speed_right_m_s'):
        ready = ready.replace(f"# {line}", line)
    assert ready != text
    assert "yaw_rate_rad_s" in Machine.model_validate(tomllib.loads(ready)).channels


@pytest.mark.heavy
def test_the_draft_of_four_wheels_weighs(tmp_path: Path) -> None:
    path = _written(tmp_path, WHEELS["four"], rows=None)
    with open_log(path) as log:
        text, _ = draft_machine_file(log, None)
        values = tomllib.loads(text)
        values["machine"]["wheel_radius_m"] = RADIUS_M
        mass_kg = run(log, Machine.model_validate(values)).frames["loads"]["mass_kg"][0]
    assert mass_kg == pytest.approx(MASS_KG, rel=0.01)


@pytest.mark.parametrize(
    "limbs",
    [
        ["left_hip", "left_knee", "right_hip", "right_knee"],
        [f"{corner}_{part}" for corner in ("FL", "FR", "RL", "RR") for part in ("hip", "calf")],
    ],
)
def test_limbs_are_no_wheels(limbs: list[str], tmp_path: Path) -> None:
    channels, questions = _drafted(_written(tmp_path, limbs))
    assert set(channels) == set()
    assert any("a force" in question for question in questions)


@pytest.mark.parametrize(
    ("names", "channels"),
    [
        (["boom"], {"boom_rad"}),
        (["left_wheel", "right_wheel", "boom_joint", "bucket_joint"], {"boom_rad", "bucket_rad"}),
        (["arm_1", "arm_2", "wheel_left", "wheel_right"], set()),
        (["boom_cylinder_joint", "wheel_left", "wheel_right"], set()),
    ],
)
def test_the_joint_of_a_boom_or_bucket_is_its_angle_and_no_position(
    names: list[str], channels: set[str], tmp_path: Path
) -> None:
    drafted, _ = _drafted(_written(tmp_path, names))
    assert {"boom_rad", "bucket_rad", "position_x_m"} & set(drafted) == channels
