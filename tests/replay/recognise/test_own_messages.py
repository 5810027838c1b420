"""What `init` proposes for the fields of one's own messages, by their names and topics."""

import json
import struct
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Rosbag2Writer
from rosbags.typesys import Stores, get_typestore

from replay.init.guess_machine import draft_machine_file
from replay.logs import open_log

_ARRAY = "std_msgs/msg/Float64MultiArray"
T = np.arange(600) / 50
V = np.clip(np.sin(T), 0, None) * 3
A = np.gradient(V, T)


def write_json_log(path: Path, topics: dict[str, dict[str, np.ndarray]]) -> None:
    """An MCAP file of JSON messages at the times T; a field of rows is a list in each message."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        for topic, fields in topics.items():
            number_type = {"type": "number"}
            properties = {
                name: number_type if x.ndim == 1 else {"type": "array", "items": number_type}
                for name, x in fields.items()
            }
            schema = json.dumps({"type": "object", "properties": properties}).encode()
            number = writer.register_channel(
                topic, "json", writer.register_schema(topic.strip("/"), "jsonschema", schema)
            )
            for k, t in enumerate(T):
                data = json.dumps({name: x[k].tolist() for name, x in fields.items()}).encode()
                writer.add_message(number, int(1e9 + 1e9 * t), data, int(1e9 + 1e9 * t))
        writer.finish()


def drafted(path: Path) -> tuple[str, list[str]]:
    with open_log(path) as log:
        return draft_machine_file(log, None)


def test_fields_of_ones_own_messages_are_recognised_by_their_names(tmp_path: Path) -> None:
    motor = {"torque_Nm": 9.0 * A, "speed_rpm": 300.0 * V}
    write_json_log(tmp_path / "log.mcap", {"/motor/front": motor, "/motor/rear": motor})
    text, lacking = drafted(tmp_path / "log.mcap")
    assert '# topic = "/motor/front"\n# field = "torque_Nm"\n# unit = "N*m"' in text
    assert '# derive = "motor_torque_N_m * GEAR / wheel_radius_m"' in text
    assert '# derive = "motor_rpm / GEAR * wheel_radius_m"' in text
    assert (
        "which of '/motor/front torque_Nm', '/motor/rear torque_Nm' drive the machine: their "
        "torques are added"
    ) in lacking


def test_a_topic_names_its_single_number(tmp_path: Path) -> None:
    topics = {"/drive/pull_kN": {"data": A}, "/drive/speed_kmh": {"data": 3.6 * V}}
    write_json_log(tmp_path / "log.mcap", topics)
    text, lacking = drafted(tmp_path / "log.mcap")
    draft = tomllib.loads(text)["channels"]
    assert draft["force_x_N"] == {"topic": "/drive/pull_kN", "field": "data", "unit": "kN"}
    assert draft["speed_x_m_s"] == {"topic": "/drive/speed_kmh", "field": "data", "unit": "km/h"}
    assert lacking == []


def sources(text: str) -> dict[str, str]:
    """Topic of each channel that a draft fills."""
    channels = tomllib.loads(text)["channels"]
    return {name: each["topic"] for name, each in channels.items() if "topic" in each}


def test_a_topic_names_a_side_and_what_was_wanted(tmp_path: Path) -> None:
    both = {f"/{side}/torque_Nm": {"data": A} for side in ("left", "right")}
    both |= {f"/{side}/speed_kmh": {"data": V} for side in ("left", "right")}
    write_json_log(tmp_path / "sides.mcap", both)
    text, lacking = drafted(tmp_path / "sides.mcap")
    assert sources(text) == {
        "torque_left_N_m": "/left/torque_Nm",
        "torque_right_N_m": "/right/torque_Nm",
        "speed_left_m_s": "/left/speed_kmh",
        "speed_right_m_s": "/right/speed_kmh",
    }
    assert lacking == ["machine.wheel_radius_m, which turns wheel torques into a force"]
    drive = {"force_x_N": A, "speed_x_m_s": V}
    write_json_log(tmp_path / "wanted.mcap", {"/a_cmd": drive, "/b_state": drive})
    text, _ = drafted(tmp_path / "wanted.mcap")
    assert sources(text) == {"force_x_N": "/b_state", "speed_x_m_s": "/b_state"}


def test_forces_of_two_topics_are_a_question(tmp_path: Path) -> None:
    drive = {"force_x_N": A, "speed_x_m_s": V}
    write_json_log(tmp_path / "log.mcap", {"/front/state": drive, "/rear/state": drive})
    _, lacking = drafted(tmp_path / "log.mcap")
    (question,) = lacking
    assert "which of '/front/state force_x_N', '/rear/state force_x_N'" in question


def test_three_accelerations_a_topic_each_are_one_sensor(tmp_path: Path) -> None:
    axes = {"x": A, "y": 0.01 * A, "z": 9.81 + 0.01 * A}
    topics = {f"/acc_{axis}": {"data": x} for axis, x in axes.items()}
    write_json_log(
        tmp_path / "log.mcap",
        topics | {"/pull_kN": {"data": A}, "/speed_kmh": {"data": 3.6 * V}},
    )
    text, lacking = drafted(tmp_path / "log.mcap")
    found = sources(text)
    assert {f"specific_force_{axis}_m_s2": f"/acc_{axis}" for axis in axes}.items() <= found.items()
    assert (found["force_x_N"], found["speed_x_m_s"]) == ("/pull_kN", "/speed_kmh")
    assert lacking == []


def test_elements_of_short_lists_are_columns(tmp_path: Path) -> None:
    fields = {
        "torque_Nm": np.column_stack([A, A]),
        "omega_rad_s": np.column_stack([V, V]),
        "accel_g": np.column_stack([A / 9.80665, 0.0 * A, 1.0 + 0.0 * A]),
        "scan_m": np.column_stack([A] * 40),
        "speed_covariance": np.column_stack([A] * 4),
    }
    write_json_log(tmp_path / "lists.mcap", {"/loader": fields})
    text, lacking = drafted(tmp_path / "lists.mcap")
    filled = {
        name: each["field"]
        for name, each in tomllib.loads(text)["channels"].items()
        if "field" in each
    }
    assert filled == {
        "torque_left_N_m": "torque_Nm[0]",
        "torque_right_N_m": "torque_Nm[1]",
        "specific_force_x_m_s2": "accel_g[0]",
        "specific_force_y_m_s2": "accel_g[1]",
        "specific_force_z_m_s2": "accel_g[2]",
    }
    assert '# field = "omega_rad_s[1]"' in text
    assert "scan_m[0]" not in text
    # which place of two is the left one is a convention of who wrote the log
    assert any(
        each.startswith("whether '/loader torque_Nm[0]'") and "left" in each for each in lacking
    )


def test_arrays_of_a_fixed_length_are_columns(tmp_path: Path) -> None:
    definition = b"float64[2] torque_Nm\nfloat64[4] quaternion\nuint8[3] flags\nfloat64 speed_m_s\n"
    with (tmp_path / "fixed.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2")
        schema = writer.register_schema("own/msg/Wheels", "ros2msg", definition)
        number = writer.register_channel("/wheels", "cdr", schema)
        for t, v, a in zip(T, V, A, strict=True):
            numbers = struct.pack("<6d3B5xd", a, a, *[0.0] * 4, 1, 2, 3, v)
            stamp = int(1e9 + 1e9 * t)
            writer.add_message(number, stamp, b"\0\1\0\0" + numbers, stamp)
        writer.finish()
    text, _ = drafted(tmp_path / "fixed.mcap")
    channels = tomllib.loads(text)["channels"]
    assert channels["torque_left_N_m"]["field"] == "torque_Nm[0]"
    assert channels["torque_right_N_m"]["field"] == "torque_Nm[1]"


def test_lists_that_are_empty_at_first_or_have_gaps_are_columns(tmp_path: Path) -> None:
    torque_Nm = np.column_stack([A, A])
    torque_Nm[0, 0] = np.nan
    write_json_log(tmp_path / "gaps.mcap", {"/loader": {"torque_Nm": torque_Nm}})
    text, _ = drafted(tmp_path / "gaps.mcap")
    assert tomllib.loads(text)["channels"]["torque_right_N_m"]["field"] == "torque_Nm[1]"


def test_a_topic_names_the_numbers_of_an_array(tmp_path: Path) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    types: Any = store.types
    kinds = {"/wheel_torque_Nm": 9.0 * A, "/wheel_speed_m_s": V}
    layout = types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    with Rosbag2Writer(tmp_path / "log", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for name, values in kinds.items():
            topic = writer.add_connection(name, _ARRAY, typestore=store)
            for t, value in zip(T, values, strict=True):
                message = types[_ARRAY](layout=layout, data=np.array([value, value]))
                writer.write(topic, int(1e9 + 1e9 * t), store.serialize_cdr(message, _ARRAY))
    text, lacking = drafted(tmp_path / "log")
    for side, place in (("left", 0), ("right", 1)):
        assert (
            f'[channels.torque_{side}_N_m]\ntopic = "/wheel_torque_Nm"\nfield = "data[{place}]"'
            in text
        )
        assert (
            f'[channels.speed_{side}_m_s]\ntopic = "/wheel_speed_m_s"\nfield = "data[{place}]"'
            in text
        )
    assert any("'/wheel_torque_Nm data[0]'" in each and "left" in each for each in lacking)
