"""What `init` drafts for messages of standard types, by the names of their topics."""

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from replay.init.guess_machine import draft_machine_file
from replay.logs import open_log
from replay.recognise.profile import FieldProfile, ask_about_twist_frame

STORE = get_typestore(Stores.ROS2_HUMBLE)
TYPES: Any = STORE.types
KINDS = {
    "Imu": "sensor_msgs/msg/Imu",
    "Odometry": "nav_msgs/msg/Odometry",
    "Twist": "geometry_msgs/msg/Twist",
    "JointState": "sensor_msgs/msg/JointState",
}


def message(kind: str, t: float, *, turning: bool = False) -> Any:
    stamp = TYPES["builtin_interfaces/msg/Time"](sec=int(t), nanosec=round(t % 1 * 1e9))
    header = TYPES["std_msgs/msg/Header"](stamp=stamp, frame_id="")
    vector = TYPES["geometry_msgs/msg/Vector3"]
    turned = TYPES["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)
    turns_rad_s = np.sin(3.0 * t) if turning else 0.0
    twist = TYPES[KINDS["Twist"]](vector(np.sin(t), 0.0, 0.0), vector(0.0, 0.0, turns_rad_s))
    if kind == "Twist":
        return twist
    if kind == "Imu":
        still, force = vector(0.0, 0.0, 0.0), vector(np.cos(t), 0.0, 9.81)
        return TYPES[KINDS[kind]](
            header, turned, np.zeros(9), still, np.zeros(9), force, np.zeros(9)
        )
    if kind == "JointState":
        wheels = np.full(2, np.sin(t))
        names = ["left_wheel", "right_wheel"]
        return TYPES[KINDS[kind]](header, names, wheels, wheels, wheels)
    place = TYPES["geometry_msgs/msg/Pose"](TYPES["geometry_msgs/msg/Point"](0.0, 0.0, 0.0), turned)
    return TYPES[KINDS[kind]](
        header,
        "base",
        TYPES["geometry_msgs/msg/PoseWithCovariance"](place, np.zeros(36)),
        TYPES["geometry_msgs/msg/TwistWithCovariance"](twist, np.zeros(36)),
    )


def drafted(
    folder: Path, rows_by_topic: dict[tuple[str, str], int], *, turning: bool = False
) -> tuple[dict[str, str], list[str]]:
    """Topic of each channel, and the questions, of a log of (topic, kind) with so many messages."""
    path = folder / "log"
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for (topic, kind), rows in rows_by_topic.items():
            opened = writer.add_connection(topic, KINDS[kind], typestore=STORE)
            for t in np.linspace(1000, 1010, rows):
                data = STORE.serialize_cdr(message(kind, t, turning=turning), KINDS[kind])
                writer.write(opened, round(t * 1e9), data)
    with open_log(path) as log:
        text, questions = draft_machine_file(log, None)
    channels = tomllib.loads(text).get("channels", {})
    return {name: each["topic"] for name, each in channels.items() if "topic" in each}, questions


@pytest.mark.parametrize("topic", ["/cmd_vel", "/base_controller/command", "/target/vel"])
def test_a_set_point_is_no_speed_and_is_asked_about_only_alone(topic: str, tmp_path: Path) -> None:
    channels, questions = drafted(tmp_path, {(topic, "Twist"): 90, ("/odom", "Odometry"): 40})
    assert channels["speed_x_m_s"] == "/odom"
    assert not any("set-point" in each for each in questions)
    (tmp_path / "alone").mkdir()
    channels, questions = drafted(tmp_path / "alone", {(topic, "Twist"): 90, ("/imu", "Imu"): 40})
    assert "speed_x_m_s" not in channels
    said = f"is '{topic} linear.x' measured? its name says set-point"
    assert any(each.startswith(said) for each in questions)


def test_a_command_to_joints_is_no_drive(tmp_path: Path) -> None:
    log = {("/joint_commands", "JointState"): 90, ("/joint_states", "JointState"): 40}
    channels, questions = drafted(tmp_path, log | {("/cmd_vel", "Twist"): 20})
    assert set(channels.values()) == {"/joint_states"}
    assert not any("set-point" in each for each in questions)


def test_the_channels_are_of_one_machine_of_several_and_the_draft_asks_which(
    tmp_path: Path,
) -> None:
    kinds = {"joint_states": "JointState", "imu": "Imu"}
    rows = {"/r0": 30, "/r1": 40, "/r2": 30}
    log = {(f"{r}/{name}", kind): n for r, n in rows.items() for name, kind in kinds.items()}
    # only the second has a pose, and another's IMU has most messages
    channels, questions = drafted(
        tmp_path, log | {("/r2/imu", "Imu"): 90, ("/r1/odom", "Odometry"): 20}
    )
    assert {topic.split("/")[1] for topic in channels.values()} == {"r1"}
    assert "which of '/r1', '/r0', '/r2' is meant: the draft takes the first" in questions


def test_sides_and_sensors_of_one_machine_are_no_other_machines(tmp_path: Path) -> None:
    channels, questions = drafted(
        tmp_path,
        {
            ("/left/imu", "Imu"): 30,
            ("/right/imu", "Imu"): 20,
            ("/wheels/odom", "Odometry"): 20,
            ("/wheels/joint_states", "JointState"): 20,
            ("/camera/odom", "Odometry"): 30,
        },
    )
    assert channels["specific_force_x_m_s2"] == "/left/imu"
    assert channels["speed_x_m_s"] == "/wheels/odom"
    assert [each for each in questions if "is meant" in each] == [
        "which of '/wheels/odom', '/camera/odom' is meant: the draft takes the first"
    ]


@pytest.mark.parametrize("turning", [True, False])
def test_the_yaw_rate_is_that_of_the_odometry_where_it_is_filled_in(
    turning: bool, tmp_path: Path
) -> None:
    log = {("/odom", "Odometry"): 40, ("/joint_states", "JointState"): 90}
    channels, _ = drafted(tmp_path, log, turning=turning)
    assert channels.get("yaw_rate_rad_s") == ("/odom" if turning else None)


@pytest.mark.parametrize(("across_m_s", "asks"), [(1.35, True), (0.05, False)])
def test_a_twist_that_is_as_large_across_is_asked_about(across_m_s: float, asks: bool) -> None:
    """As of drivers that publish the velocity in the frame of the map."""
    fields = {"twist.twist.linear.x": 2.8, "twist.twist.linear.y": across_m_s}
    profiles = [
        FieldProfile("/odom", name, None, 50.0, 9, -size_m_s, 0.0, size_m_s, "")
        for name, size_m_s in fields.items()
    ]
    questions = ask_about_twist_frame([("/odom", "twist.twist.linear.x")], profiles)
    assert [each.startswith("is the twist of /odom in the frame") for each in questions] == (
        [True] * asks
    )
