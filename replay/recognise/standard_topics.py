"""Read topics of standard types: their channels, set-points, and one machine among several."""

import re
from collections import defaultdict
from collections.abc import Iterator
from typing import Final, NamedTuple

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
    "Odometry": {
        "speed_x_m_s": "twist.twist.linear.x",
        "yaw_rate_rad_s": "twist.twist.angular.z",
    },
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
_MAY_BE_WANTED: Final = ("speed_x_m_s", "force_x_N", "torque_z_N_m", "yaw_rate_rad_s")
#: Last parts of message types that hold a machine's force or speed.
_DRIVES: Final = frozenset(("JointState", "Odometry", "TwistStamped", "Twist", "WrenchStamped"))
#: The same, and of other sensors that a machine has one of.
_OF_ONE_MACHINE: Final = _DRIVES | {"Imu"}

_NUMBERED_LETTER: Final = re.compile(r"[A-Za-z]_?\d+")
#: Position at which two names differ, the other segments, and the type of the message.
_Kind = tuple[int, tuple[str, ...], str]


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
        topics: `Log.topics`; an IMU comes first, then those with most messages.
        are_set_points: whether to propose the channels of set-points instead of readings.
    """
    first: dict[str, ChannelProposal] = {}
    is_imu = pl.col("type").str.ends_with("/Imu")
    for row in topics.sort(is_imu, "messages", descending=True, maintain_order=True).to_dicts():
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


class MachineTopics(NamedTuple):
    """Topics of one of the machines in a log.

    Attributes:
        choices: namespaces of machines, such as `/r0` and `/r1`, and topics of which a machine has
            one, such as `/gps/odom` and `/map/odom`; the first is in `topics`. Empty if there is
            nothing to choose.
        topics: rows of `Log.topics` without the other choices.
    """

    choices: tuple[str, ...]
    topics: pl.DataFrame


def choose_topics_of_one_machine(topics: pl.DataFrame) -> MachineTopics:
    """Choose the namespace that has most of what a drive needs, if several have the same topics.

    Those that share two topics are machines, and all topics of the others are left out; those that
    share one may be two sensors of a machine, and only that topic is left out.

    Args:
        topics: `Log.topics`.
    """
    kinds_by_namespace: defaultdict[str, dict[_Kind, int]] = defaultdict(dict)
    namespaces_of: defaultdict[_Kind, set[str]] = defaultdict(set)
    for row in topics.iter_rows(named=True):
        for namespace, kind in _iter_namespaces_and_kinds(row["topic"], row["type"]):
            if row["messages"] and not row["problem"]:
                kinds_by_namespace[namespace][kind] = row["messages"]
                namespaces_of[kind].add(namespace)
    shared = {kind: names for kind, names in namespaces_of.items() if len(names) > 1}
    if not shared:
        return MachineTopics((), topics)
    alike = sorted(set().union(*shared.values()))

    def rank(namespace: str) -> tuple[int, int, int]:
        kinds = kinds_by_namespace[namespace]
        return sum(kind[-1] in _DRIVES for kind in kinds), len(kinds), max(kinds.values())

    first = max(alike, key=rank)
    own = [kind for kind, names in shared.items() if first in names]
    others = sorted(set().union(*(shared[kind] for kind in own)) - {first})
    left_out, choices = pl.lit(value=False), list[str]()
    for namespace in others:
        common = [kind for kind in own if namespace in shared[kind]]
        names = [_join_name(namespace, kind) for kind in common]
        left_out |= pl.col("topic").is_in(names)
        if len(common) > 1:
            left_out |= pl.col("topic").str.starts_with(f"{namespace}/")
            choices += [first, namespace]
        else:
            choices += [_join_name(first, common[0]), *names]
    return MachineTopics(tuple(dict.fromkeys(choices)), topics.filter(~left_out))


def _iter_namespaces_and_kinds(topic: str, message_type: str) -> Iterator[tuple[str, _Kind]]:
    """Yield each namespace of a topic of a drive or an IMU, with the rest of its name."""
    kind = message_type.rpartition("/")[2]
    if kind not in _OF_ONE_MACHINE or is_topic_of_set_points(topic):
        return
    segments = topic.strip("/").split("/")
    for place, segment in enumerate(segments[:-1]):
        said = interpret_column_name(segment)
        # a left and a right drive are of one machine, but r1 and r2 are two
        if _NUMBERED_LETTER.fullmatch(segment) or (said.side is None and said.axle is None):
            rest = (*segments[:place], *segments[place + 1 :])
            yield "/" + "/".join(segments[: place + 1]), (place, rest, kind)


def _join_name(namespace: str, kind: _Kind) -> str:
    place, rest, _ = kind
    return "/".join((namespace, *rest[place:]))
