"""The ROS messages of a simulated log: which topic carries what, in the signs of REP-103."""

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeAlias

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.simulation import Scenario, SimulatedLog

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

_Types: TypeAlias = Mapping[str, Any]
_Fields: TypeAlias = Iterator[dict[str, Any]]


class Topic(NamedTuple):
    """Where a frame of a simulated log goes, and what its messages hold beside the header."""

    name: str
    msgtype: str
    frame_id: str
    fields: Callable[[pl.DataFrame, _Types, Scenario], _Fields]


class Message(NamedTuple):
    """One encoded message; `frame` is its key in `TOPICS`."""

    log_time_ns: int
    frame: str
    data: bytes | memoryview


def messages(log: SimulatedLog, typestore: "Typestore", *, ros1: bool) -> Iterator[Message]:
    """Encode all messages of a log, in the order in which they were recorded.

    Args:
        log: the simulated log.
        typestore: the message definitions of a ROS distribution.
        ros1: whether that is a distribution of ROS 1.
    """
    types = typestore.types
    serialize = typestore.serialize_ros1 if ros1 else typestore.serialize_cdr
    rows: list[tuple[int, str, Any]] = []
    for name, frame in log.topics.items():
        topic = TOPICS[name]
        headers = _headers(frame, topic.frame_id, types, ros1=ros1)
        bodies = topic.fields(frame, types, log.scenario)
        for time_ns, header, body in zip(frame["log_time_ns"], headers, bodies, strict=True):
            rows.append((time_ns, name, types[topic.msgtype](header=header, **body)))
    rows.sort(key=lambda row: row[0])
    for time_ns, name, message in rows:
        yield Message(time_ns, name, serialize(message, TOPICS[name].msgtype))


def _headers(frame: pl.DataFrame, frame_id: str, types: _Types, *, ros1: bool) -> Iterator[Any]:
    header, time = types["std_msgs/msg/Header"], types["builtin_interfaces/msg/Time"]
    for count, stamp_ns in enumerate(frame["header_stamp_ns"]):
        stamp = time(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
        # only the header of ROS 1 counts
        counter = {"seq": count} if ros1 else {}
        yield header(stamp=stamp, frame_id=frame_id, **counter)


def _imu(frame: pl.DataFrame, types: _Types, _scenario: Scenario) -> _Fields:
    vector, quaternion = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"]
    # REP-103: y points left, so that a positive pitch is nose-down
    half = -frame["pitch_rad"].to_numpy() / 2
    roll = frame["roll_rad"].to_numpy() / 2
    columns = frame.select(
        *(f"specific_force_{axis}_m_s2" for axis in "xyz"),
        *(f"{axis}_rate_rad_s" for axis in ("roll", "pitch", "yaw")),
        pl.Series("quaternion_x", np.sin(roll) * np.cos(half)),
        pl.Series("quaternion_y", np.cos(roll) * np.sin(half)),
        # without roll 0, not -0
        pl.Series("quaternion_z", -np.sin(roll) * np.sin(half) + 0.0),
        pl.Series("quaternion_w", np.cos(roll) * np.cos(half)),
    )
    # a covariance of zeros says that it is not known
    unknown = {
        f"{of}_covariance": np.zeros(9)
        for of in ("orientation", "angular_velocity", "linear_acceleration")
    }
    for acc_x, acc_y, acc_z, roll_rate, pitch_rate, yaw_rate, *turned in columns.iter_rows():
        yield {
            "orientation": quaternion(*turned),
            "angular_velocity": vector(x=roll_rate, y=pitch_rate, z=yaw_rate),
            "linear_acceleration": vector(x=acc_x, y=acc_y, z=acc_z),
            **unknown,
        }


def _torque(frame: pl.DataFrame, _types: _Types, _scenario: Scenario) -> _Fields:
    return _joints("effort", frame.select("torque_left_N_m", "torque_right_N_m").to_numpy())


def _speed(frame: pl.DataFrame, _types: _Types, scenario: Scenario) -> _Fields:
    speeds = frame.select("speed_left_m_s", "speed_right_m_s").to_numpy()
    return _joints("velocity", speeds / scenario.machine.wheel_radius_m)


def _joints(field: str, wheels: NDArray[np.float64]) -> _Fields:
    empty = np.zeros(0)
    for row in np.ascontiguousarray(wheels):
        yield {
            "name": ["front_left", "front_right"],
            "position": empty,
            "velocity": empty,
            "effort": empty,
            field: row,
        }


TOPICS: Final = {
    "imu": Topic("/imu/data", "sensor_msgs/msg/Imu", "imu_link", _imu),
    "torque": Topic("/wheels/torque", "sensor_msgs/msg/JointState", "base_link", _torque),
    "speed": Topic("/wheels/speed", "sensor_msgs/msg/JointState", "base_link", _speed),
}
