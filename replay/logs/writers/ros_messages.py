"""Make the ROS messages of a simulated log, by topic, with the signs of REP-103."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.simulation import Scenario, SimulatedLog
from estimators.arrays import Ints
from replay.logs.decoding.wire import CDR, ROS1
from replay.logs.writers.message_columns import Column
from replay.logs.writers.recorded_order import RecordedTopic
from replay.logs.writers.serialise_messages import SameLayout, serialise_messages

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

    from replay.logs.writers.serialise_messages import Envelope

_WHEELS: Final = ("front_left", "front_right")
_JOINTS: Final = ("boom", "bucket")


class Topic(NamedTuple):
    """Topic of a simulated log: the id of its coordinate frame, and the fields of its messages."""

    name: str
    msgtype: str
    frame_id: str
    fields: Callable[[pl.DataFrame, Scenario], dict[str, Column]]


def make_recorded_topics(
    log: SimulatedLog,
    store: "Typestore",
    connections: Mapping[str, int],
    envelope: "Callable[[int, Ints], Envelope]",
    *,
    ros1: bool,
) -> list[RecordedTopic]:
    """Convert a simulated log to the records of a container.

    Args:
        log: the simulated log.
        store: message definitions of a ROS distribution.
        connections: number in the container by the topic's key in `TOPICS`.
        envelope: function that returns the bytes before messages of a connection at times (n,).
        ros1: whether the distribution is one of ROS 1.
    """

    def make_topic(name: str, frame: pl.DataFrame) -> RecordedTopic:
        ordered = frame.sort("log_time_ns", maintain_order=True)
        times = ordered["log_time_ns"].to_numpy()

        def serialise_rows(first: int, last: int) -> list[SameLayout]:
            part = ordered.slice(first, last - first)
            return serialise_messages(
                store,
                TOPICS[name].msgtype,
                make_message_columns(name, part, log.scenario, first),
                last - first,
                ROS1 if ros1 else CDR,
                envelope(connections[name], times[first:last]),
            )

        return RecordedTopic(connections[name], times, serialise_rows)

    return [make_topic(name, frame) for name, frame in log.topics.items()]


def make_message_columns(
    topic_name: str, frame: pl.DataFrame, scenario: Scenario, first_sequence_number: int = 0
) -> dict[str, Column]:
    """Make the columns of a topic's messages, by field.

    Args:
        topic_name: key of the topic in `TOPICS`.
        frame: rows of the topic.
        scenario: simulated scenario.
        first_sequence_number: sequence number of the first row, in ROS 1 headers.
    """
    topic = TOPICS[topic_name]
    stamp_ns = frame["header_stamp_ns"].to_numpy()
    header: dict[str, Column] = {
        "seq": np.arange(first_sequence_number, first_sequence_number + frame.height),
        "stamp": {"sec": stamp_ns // 10**9, "nanosec": stamp_ns % 10**9},
        "frame_id": topic.frame_id,
    }
    return {"header": header, **topic.fields(frame, scenario)}


def stack_columns_of_frame(frame: pl.DataFrame, *names: str) -> NDArray[np.float64]:
    """Stack columns of a frame into an array (n, names)."""
    return np.column_stack([frame[name].to_numpy() for name in names])


def _make_imu_columns(frame: pl.DataFrame, _scenario: Scenario) -> dict[str, Column]:
    # REP-103: y points left, so that a positive pitch is nose-down
    half = -frame["pitch_rad"].to_numpy() / 2
    roll = frame["roll_rad"].to_numpy() / 2
    # a covariance of zeros, as of an omitted field, means that it is unknown
    return {
        "orientation": {
            "x": np.sin(roll) * np.cos(half),
            "y": np.cos(roll) * np.sin(half),
            # without roll 0, not -0
            "z": -np.sin(roll) * np.sin(half) + 0.0,
            "w": np.cos(roll) * np.cos(half),
        },
        "angular_velocity": {
            "x": frame["roll_rate_rad_s"].to_numpy(),
            "y": frame["pitch_rate_rad_s"].to_numpy(),
            "z": frame["yaw_rate_rad_s"].to_numpy(),
        },
        "linear_acceleration": {
            axis: frame[f"specific_force_{axis}_m_s2"].to_numpy() for axis in "xyz"
        },
    }


def _make_torque_columns(frame: pl.DataFrame, _scenario: Scenario) -> dict[str, Column]:
    wheels = stack_columns_of_frame(frame, "torque_left_N_m", "torque_right_N_m")
    return {"name": _WHEELS, "effort": wheels}


def _make_speed_columns(frame: pl.DataFrame, scenario: Scenario) -> dict[str, Column]:
    wheels = stack_columns_of_frame(frame, "speed_left_m_s", "speed_right_m_s")
    return {"name": _WHEELS, "velocity": wheels / scenario.machine.wheel_radius_m}


def _make_boom_columns(frame: pl.DataFrame, _scenario: Scenario) -> dict[str, Column]:
    return {"name": _JOINTS, "position": stack_columns_of_frame(frame, "boom_rad", "bucket_rad")}


def _make_odometry_columns(frame: pl.DataFrame, _scenario: Scenario) -> dict[str, Column]:
    half = frame["heading_rad"].to_numpy() / 2
    place: dict[str, Column] = {"x": frame["position_x_m"].to_numpy()}
    turned: dict[str, Column] = {"z": np.sin(half), "w": np.cos(half)}
    twist: dict[str, Column] = {
        "linear": {"x": frame["speed_x_m_s"].to_numpy()},
        "angular": {"z": frame["yaw_rate_rad_s"].to_numpy()},
    }
    return {
        "child_frame_id": "base_link",
        "pose": {"pose": {"position": place, "orientation": turned}},
        "twist": {"twist": twist},
    }


def _make_gnss_columns(frame: pl.DataFrame, _scenario: Scenario) -> dict[str, Column]:
    return {
        # a fix by GPS, of unknown covariance
        "status": {"status": 0, "service": 1},
        "latitude": frame["latitude_deg"].to_numpy(),
        "longitude": frame["longitude_deg"].to_numpy(),
    }


TOPICS: Final = {
    "imu": Topic("/imu/data", "sensor_msgs/msg/Imu", "imu_link", _make_imu_columns),
    "torque": Topic(
        "/wheels/torque", "sensor_msgs/msg/JointState", "base_link", _make_torque_columns
    ),
    "speed": Topic("/wheels/speed", "sensor_msgs/msg/JointState", "base_link", _make_speed_columns),
    "boom": Topic("/boom/angles", "sensor_msgs/msg/JointState", "boom_link", _make_boom_columns),
    "odometry": Topic("/odometry", "nav_msgs/msg/Odometry", "odom", _make_odometry_columns),
    "gnss": Topic("/gnss/fix", "sensor_msgs/msg/NavSatFix", "gnss_link", _make_gnss_columns),
}
