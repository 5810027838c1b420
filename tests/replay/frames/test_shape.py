"""The columns of a topic: dotted or nested, lists or arrays, names or numbers, times."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2

import payscope
from tests.replay.logs.written_logs import ROS2

T0_NS = 1_700_000_000_123_456_789
T = ROS2.types


def header(frame: str = "base") -> Any:
    return T["std_msgs/msg/Header"](
        stamp=T["builtin_interfaces/msg/Time"](sec=T0_NS // 10**9, nanosec=T0_NS % 10**9),
        frame_id=frame,
    )


def fix(status: int) -> Any:
    return T["sensor_msgs/msg/NavSatFix"](
        header=header(),
        status=T["sensor_msgs/msg/NavSatStatus"](status=status, service=3),
        latitude=1.0,
        longitude=2.0,
        altitude=3.0,
        position_covariance=np.arange(9.0),
        position_covariance_type=2,
    )


def transforms(frames: list[str]) -> Any:
    zero = T["geometry_msgs/msg/Vector3"](x=1.0, y=2.0, z=3.0)
    turn = T["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)
    return T["tf2_msgs/msg/TFMessage"](
        transforms=[
            T["geometry_msgs/msg/TransformStamped"](
                header=header(frame),
                child_frame_id=f"{frame}/child",
                transform=T["geometry_msgs/msg/Transform"](translation=zero, rotation=turn),
            )
            for frame in frames
        ]
    )


def diagnostics(levels: list[int]) -> Any:
    return T["diagnostic_msgs/msg/DiagnosticArray"](
        header=header(),
        status=[
            T["diagnostic_msgs/msg/DiagnosticStatus"](
                level=level, name="n", message="m", hardware_id="h", values=[]
            )
            for level in levels
        ],
    )


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("shape") / "log"
    trees = [transforms(["a", "b"]), transforms([]), transforms(["c"])]
    levels = [diagnostics([0, 2]), diagnostics([])]
    written = [
        ("/fix", "sensor_msgs/msg/NavSatFix", [fix(-1), fix(0), fix(77)]),
        ("/tf", "tf2_msgs/msg/TFMessage", trees),
        ("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", levels),
    ]
    with Writer2(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic, kind, messages in written:
            connection = writer.add_connection(topic, kind, typestore=ROS2)
            for k, message in enumerate(messages):
                writer.write(connection, T0_NS + k, ROS2.serialize_cdr(message, kind))
    return path


def test_an_enumeration_has_its_names_and_a_value_without_one_its_digits(log: Path) -> None:
    found = payscope.scan_log(log, "/fix").collect()
    assert found["status.status"].to_list() == ["STATUS_NO_FIX", "STATUS_FIX", "77"]
    assert found["status.service"].to_list() == ["3"] * 3  # a sum of two
    assert found["position_covariance_type"][0] == "COVARIANCE_TYPE_DIAGONAL_KNOWN"
    numbers = payscope.scan_log(log, "/fix", enums="number").collect()
    assert numbers["status.status"].to_list() == [-1, 0, 77]


def test_the_names_of_a_list_of_enumerations(log: Path) -> None:
    found = payscope.scan_log(log, "/diagnostics").collect()
    assert found["status[].level"].to_list() == [["OK", "ERROR"], []]


def test_times_are_datetimes_to_the_nanosecond(log: Path) -> None:
    found = payscope.scan_log(log, "/fix").collect()
    for name, ns in (("log_time", T0_NS), ("header_stamp", T0_NS), ("header.stamp", T0_NS)):
        assert found.schema[name] == pl.Datetime("ns", "UTC")
        assert found[name].to_physical()[0] == ns
    assert found["log_time"][0] == datetime(2023, 11, 14, 22, 13, 20, 123456, tzinfo=UTC)


@pytest.mark.parametrize("nested", ["dotted", "struct"])
def test_an_array_of_fixed_length_keeps_it_where_that_is_asked_for(log: Path, nested: Any) -> None:
    lazy = payscope.scan_log(log, "/fix", arrays="array", nested=nested)
    name = "position_covariance[]" if nested == "dotted" else "position_covariance"
    found = lazy.select(name).collect()
    assert found.schema == {name: pl.Array(pl.Float64(), 9)}
    assert found[name][2].to_list() == list(range(9))
    lists = payscope.scan_log(log, "/fix").collect()["position_covariance[]"]
    assert lists.dtype == pl.List(pl.Float64)


def test_lists_of_messages_are_lists_of_structs(log: Path) -> None:
    lazy = payscope.scan_log(log, "/tf", nested="struct")
    found = lazy.collect()
    assert found.schema == lazy.collect_schema()
    frames = [[each["header"]["frame_id"] for each in row] for row in found["transforms"].to_list()]
    assert frames == [["a", "b"], [], ["c"]]
    first = found["transforms"][0][0]
    assert first["child_frame_id"] == "a/child"
    assert first["transform"]["translation"] == {"x": 1.0, "y": 2.0, "z": 3.0}
    inside = found.schema["transforms"].inner  # pyright: ignore
    assert inside.to_schema()["header"].to_schema()["stamp"] == pl.Datetime("ns", "UTC")


def test_a_struct_brings_only_what_is_asked_of_it(log: Path) -> None:
    found = payscope.scan_log(log, "/fix", nested="struct").select("status").collect()
    assert found["status"].to_list()[0] == {"status": "STATUS_NO_FIX", "service": "3"}
