"""Read topics of standard types: their channels and set-points."""

from typing import Final

import polars as pl

from analysis.model.schema import CHANNEL_COLUMNS
from replay.logs import TABLE
from replay.recognise.proposals import ChannelProposal
from replay.recognise.words import interpret_column_name

_COLUMNS: Final = frozenset(column.name for column in CHANNEL_COLUMNS)
#: Channel that each field fills, by the last part of the message type.
_BY_TYPE: Final[dict[str, dict[str, str]]] = {
    "Imu": {
        "specific_force_x_m_s2": "linear_acceleration.x",
        "specific_force_y_m_s2": "linear_acceleration.y",
        "specific_force_z_m_s2": "linear_acceleration.z",
        "roll_rate_rad_s": "angular_velocity.x",
        "pitch_rate_rad_s": "angular_velocity.y",
        "yaw_rate_rad_s": "angular_velocity.z",
    },
    "Odometry": {"speed_x_m_s": "twist.twist.linear.x"},
    "TwistStamped": {"speed_x_m_s": "twist.linear.x"},
    "Twist": {"speed_x_m_s": "linear.x"},
    "NavSatFix": {"latitude_deg": "latitude", "longitude_deg": "longitude"},
    "WrenchStamped": {"force_x_N": "wrench.force.x", "torque_z_N_m": "wrench.torque.z"},
}
#: Short names that are common for columns of tables.
_SHORT: Final = {
    "position_m": "position_x_m",
    "speed_m_s": "speed_x_m_s",
    "velocity_m_s": "speed_x_m_s",
    "force_N": "force_x_N",
    "acceleration_m_s2": "acc_x_m_s2",
}
#: Channels whose message may be wanted instead of measured.
_MAY_BE_WANTED: Final = ("speed_x_m_s", "force_x_N", "torque_z_N_m")


def is_topic_of_set_points(topic: str) -> bool:
    """Whether a topic's name says that its values are wanted or allowed, not measured.

    Args:
        topic: such as `/cmd_vel` or `/base_controller/command`.
    """
    segments = topic.strip("/").split("/")[-2:]
    return any(interpret_column_name(segment).is_no_reading for segment in segments)


def propose_channels_by_message_type(
    topics: pl.DataFrame, *, are_set_points: bool = False
) -> list[ChannelProposal]:
    """Propose the channels that message types or a table's columns determine, each once.

    Args:
        topics: `Log.topics`; those with most messages come first.
        are_set_points: whether to propose the channels of set-points instead of readings.
    """
    first: dict[str, ChannelProposal] = {}
    for row in topics.sort("messages", descending=True).to_dicts():
        if row["problem"] or not row["messages"]:
            continue
        topic, fields = row["topic"], set(row["fields"])
        found = [(_SHORT.get(name, name), name) for name in row["fields"] if topic == TABLE]
        found = [(column, None, name) for column, name in found if column in _COLUMNS]
        by_type = _BY_TYPE.get(row["type"].rpartition("/")[2], {})
        found += [(column, topic, field) for column, field in by_type.items() if field in fields]
        is_wanted = topic != TABLE and is_topic_of_set_points(topic)
        for column, where, field in found:
            if (is_wanted and column in _MAY_BE_WANTED) == are_set_points:
                first.setdefault(column, ChannelProposal(column, where, field, None, ""))
    return list(first.values())
