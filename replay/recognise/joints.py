"""Recognise channels in a JointState: wheels by their names, or the single axis of a rig.

sensor_msgs/JointState is in N·m and rad/s for rotating joints; some programs send m/s. Wheels are
assumed to rotate, which the draft asks to confirm; joints named only by a side are assumed to drive
the machine.
"""

import re
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import polars as pl

from replay.logs import Log
from replay.recognise.proposals import ChannelProposal, Recognition
from replay.recognise.recognise_limits import LIMITS
from replay.recognise.standard_topics import is_topic_of_set_points
from replay.recognise.words import ColumnMeaning, interpret_column_name

_SIDES: Final = ("left", "right")
#: Short names of the corners of a machine, by side: front, rear, back or middle, in either order,
#: and vorn or hinten.
_CORNERS: Final = {
    "left": ("fl", "rl", "bl", "ml", "lf", "lr", "lb", "lm", "vl", "hl"),
    "right": ("fr", "rr", "br", "mr", "rf", "rb", "rm", "vr", "hr"),
}
#: Words of a joint's name that do not say where it is.
_ANY_JOINT: Final = frozenset(("joint", "jnt", "motor", "drive"))


def recognise_joints_of_log(log: Log, topic_rows: pl.DataFrame) -> Recognition:
    """Recognise the joints of all JointState topics.

    Args:
        log: an opened log.
        topic_rows: its topics.
    """
    found = Recognition()
    for row in topic_rows.sort("messages", descending=True).iter_rows(named=True):
        is_joints = row["type"].rpartition("/")[2] == "JointState"
        is_read = row["messages"] and not row["problem"]
        if is_joints and is_read and not is_topic_of_set_points(row["topic"]):
            recognise_joints(log, row["topic"], row["start_ns"], found)
    return found


def recognise_joints(log: Log, topic: str, start_ns: int, recognition: Recognition) -> None:
    """Add the channels that the joints of a topic provide.

    Each sender fills only some arrays of a JointState; the first message shows which.

    Args:
        log: an opened log.
        topic: topic of JointState.
        start_ns: time of its first message.
        recognition: recognition to add to.
    """
    places = [f"name[{place}]" for place in range(LIMITS.max_joints)]
    names = list(
        dict.fromkeys(str(n) for n in read_first_message(log, topic, places, start_ns) if n)
    )
    wheels, turns = find_wheel_joints_by_side(names)
    if wheels:
        for side, joints in wheels.items():
            _propose_torque_and_speed_of_side(
                log, topic, start_ns, side, joints, recognition, is_rotating=turns
            )
    elif len(names) == 1 and not interpret_column_name(names[0]).is_linkage:
        for column, array in (("position_x_m", "position"), ("force_x_N", "effort")):
            for field in select_array_fields_with_values(log, topic, array, names, start_ns):
                _fill_channel_with_joint_field(recognition, column, topic, field)
    for part in ("boom", "bucket"):
        # the position of a cylinder is a length, not an angle
        joints = [
            name
            for name in names
            if interpret_column_name(name).quantity == part and "cyl" not in name.lower()
        ]
        # several joints are the links of an arm
        if len(joints) == 1:
            angles = select_array_fields_with_values(log, topic, "position", joints, start_ns)
            for field in angles:
                _fill_channel_with_joint_field(recognition, f"{part}_rad", topic, field)


def list_joint_fields_with_values(log: Log, topic: str, start_ns: int) -> list[str]:
    """List the fields with values in the first message, such as `effort[left]`."""
    places = [f"name[{place}]" for place in range(LIMITS.max_joints)]
    names = list(
        dict.fromkeys(str(n) for n in read_first_message(log, topic, places, start_ns) if n)
    )
    arrays = ("position", "velocity", "effort")
    return [
        each
        for array in arrays
        for each in select_array_fields_with_values(log, topic, array, names, start_ns)
    ]


class WheelJoints(NamedTuple):
    """Joints of each side, and whether their names imply rotation."""

    joints_by_side: dict[str, list[str]]
    is_rotating: bool


def find_wheel_joints_by_side(joint_names: Sequence[str]) -> WheelJoints:
    """Find the joints of each side, if both have equally many."""
    said: dict[str, ColumnMeaning] = {name: interpret_column_name(name) for name in joint_names}
    drives = {name: each for name, each in said.items() if each.side and not each.is_linkage}
    wheels = {name: each for name, each in drives.items() if each.part == "wheel"}
    chosen = wheels or drives
    by_side = {side: [n for n, each in chosen.items() if each.side == side] for side in _SIDES}
    counts = {len(joints) for joints in by_side.values()}
    # joints not named as wheels are a drive if there is one per side; more are a robot's limbs
    alike = len(counts) == 1 and (counts == {1} or (bool(wheels) and counts != {0}))
    corners = {} if wheels else find_joints_named_by_corner(joint_names)
    return WheelJoints(corners or (by_side if alike else {}), bool(wheels or corners))


def find_joints_named_by_corner(joint_names: Sequence[str]) -> dict[str, list[str]]:
    """Find the joints named by nothing but a corner, such as `fl` or `rear_right_joint`.

    A leg has several joints at its corner, and each has a further word.

    Returns:
        Joints by side; empty unless both sides have equally many, two at least.
    """
    by_side: dict[str, list[str]] = {side: [] for side in _SIDES}
    for name in joint_names:
        words = [w for w in re.split(r"[\W\d_]+", name.lower()) if w and w not in _ANY_JOINT]
        said = [interpret_column_name(word) for word in words]
        sides = [each.side for each in said if each.axle is None]
        axles = [each.axle for each in said if each.side is None]
        for side, short in _CORNERS.items():
            is_spelled_out = sides == [side] and len(axles) == 1 and axles[0] is not None
            if is_spelled_out or (len(words) == 1 and words[0] in short):
                by_side[side].append(name)
    left, right = by_side.values()
    return by_side if len(left) == len(right) > 1 else {}


def _propose_torque_and_speed_of_side(
    log: Log,
    topic: str,
    start_ns: int,
    side: str,
    joints: Sequence[str],
    recognition: Recognition,
    *,
    is_rotating: bool,
) -> None:
    """Propose torque and speed of one side from its joints."""
    efforts = select_array_fields_with_values(log, topic, "effort", joints, start_ns)
    torque, speed = f"torque_{side}_N_m", f"speed_{side}_m_s"
    if torque not in recognition.recognised_channels:
        parts = fill_channel_of_each_joint(recognition, topic, efforts, torque)
        if len(parts) > 1:
            _propose_formula_as_comment(
                recognition, torque, " + ".join(parts), f"the {side} wheels' torques"
            )
    velocities = select_array_fields_with_values(log, topic, "velocity", joints, start_ns)
    if speed in recognition.recognised_channels or not velocities:
        return
    if not is_rotating:
        _fill_channel_with_joint_field(recognition, speed, topic, velocities[0])
        return
    source = f"wheel_{side}_rad_s"
    parts = fill_channel_of_each_joint(recognition, topic, velocities, source)
    mean = parts[0] if len(parts) == 1 else f"mean({', '.join(parts)})"
    _propose_formula_as_comment(
        recognition, speed, f"{mean} * wheel_radius_m", "a wheel's angular speed; needs its radius"
    )
    recognition.add_question_of_subject(
        "radius",
        "machine.wheel_radius_m, which converts wheel torques to forces and wheel rates to speeds",
    )
    recognition.add_question_of_subject(
        "unit",
        f"whether velocity[…] of the wheels is in rad/s, as drafted; if it is in m/s, "
        f"remove * wheel_radius_m from channels.speed_*_m_s.derive ({topic})",
    )


def fill_channel_of_each_joint(
    recognition: Recognition, topic: str, joint_fields: Sequence[str], channel: str
) -> list[str]:
    """Fill a channel with one field, or numbered channels with several; return their names."""
    quantity, _, behind = channel.partition("_")
    many = len(joint_fields) > 1
    names = [
        f"{quantity}_{k}_{behind}" if many else channel for k in range(1, len(joint_fields) + 1)
    ]
    for name, field in zip(names, joint_fields, strict=True):
        _fill_channel_with_joint_field(recognition, name, topic, field)
    return names


def _fill_channel_with_joint_field(
    recognition: Recognition, channel: str, topic: str, joint_field: str
) -> None:
    if channel not in recognition.recognised_channels:
        recognition.channels.append(
            ChannelProposal(channel, topic, joint_field, None, "the name of its joint")
        )


def _propose_formula_as_comment(
    recognition: Recognition, channel: str, formula: str, reason: str
) -> None:
    recognition.channels.append(ChannelProposal(channel, None, None, None, reason, formula))


def select_array_fields_with_values(
    log: Log, topic: str, array_name: str, joints: Sequence[str], start_ns: int
) -> list[str]:
    """Select the fields of an array, of the given joints, that have values in the first message."""
    fields = [f"{array_name}[{joint}]" for joint in joints]
    values = read_first_message(log, topic, fields, start_ns)
    return [field for field, value in zip(fields, values, strict=False) if value is not None]


def read_first_message(
    log: Log, topic: str, fields: Sequence[str], start_ns: int
) -> tuple[Any, ...]:
    """Read fields in a topic's first message; empty if there are no fields or no message."""
    if not fields:
        return ()
    first = log.read(topic, fields, end_ns=start_ns).head(1)
    return first.select(fields).row(0) if first.height else ()
