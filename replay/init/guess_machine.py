"""Draft a machine file from a log's contents, for `payscope init`.

A channel is guessed only if a message type or a column's name leaves little doubt; all other
numeric fields are listed as comments to choose from.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Final

import numpy as np
import polars as pl

from analysis.diagnosis.side_comparison import SPEEDS, YAW_RATE_BY_SPEEDS
from analysis.model.schema import CHANNEL_COLUMNS
from analysis.stages.signals.derive import find_unit_in_name
from analysis.stages.signals.mounting_guess import MountingGuess, estimate_imu_mounting
from analysis.stages.signals.timestamps import assign_timestamps
from estimators.arrays import Floats, Ints
from estimators.errors import LogError
from replay.init.init_limits import LIMITS
from replay.inputs.machine_identity import is_serial_number
from replay.logs import TABLE, Log, TimeAxis
from replay.machines.toml_file import format_toml
from replay.recognise.joints import recognise_joints_of_log
from replay.recognise.profile import (
    FieldProfile,
    ask_about_joint_efforts,
    ask_about_twist_frame,
    profile_fields,
)
from replay.recognise.proposals import ChannelProposal, Recognition
from replay.recognise.standard_topics import (
    choose_topics_of_one_machine,
    propose_channels_by_message_type,
)
from replay.recognise.table import recognise_channels_of_table, recognise_fields_of_messages
from replay.recognise.words import interpret_column_name

_COLUMNS: Final = frozenset(column.name for column in CHANNEL_COLUMNS)

#: Questions on settings that have a default and affect every answer, asked after missing items. The
#: second is asked unless a replay of the draft answers it.
_TO_ANSWER = (
    "does the machine dig? if it has no bucket, set machine.digs = false",
    "does the force sensor measure the brakes? if so, set settings.gate.exclude_braking = false",
)
BRAKES_QUESTION: Final = _TO_ANSWER[1]
_JOINT_UNIT = 'are the joints\' velocities in m/s? if in rad/s, set scale = "wheel_radius_m"'
_WHICH_MACHINE: Final = "which of {} is meant: the draft takes the first"
#: Channels of both sides, and the one that they make unnecessary.
_OF_BOTH_SIDES: Final = {"speed_{}_m_s": "speed_x_m_s", "torque_{}_N_m": "force_x_N"}
_SET_POINT: Final = "is '{}' measured? its name says set-point; if measured, it is channels.{}"
#: Topic (None in a table) and field of a column.
Source = tuple[str | None, str]

_AXES: Final = ("specific_force_x_m_s2", "specific_force_y_m_s2", "specific_force_z_m_s2")
_YAW_RATE_BY_SIDES: Final = (
    "# for a machine that turns, with machine.track_width_m, so that curves are excluded:",
    "# [channels.yaw_rate_rad_s]",
    f'# derive = "{YAW_RATE_BY_SPEEDS}"',
    "",
)


@dataclass(frozen=True, slots=True)
class ChannelGuess:
    """Guessed source of a channel: topic (None in a table) and field.

    For a table, also the unit, if it is not the channel's, and the reason for the guess.
    """

    column: str
    topic: str | None
    field: str
    unit: str | None = None
    reason: str | None = None


def draft_machine_file(log: Log, time_axis: TimeAxis | None) -> tuple[str, list[str]]:
    """Draft a machine file for a log.

    Args:
        log: an opened log.
        time_axis: time column of a table, if given.

    Returns:
        Text of the file, and a sentence about each item that `run` still needs.
    """
    topics = log.topics()
    is_table = str(topics["topic"][0]).startswith(TABLE) if topics.height else False
    recognised = recognise_channels_of_table(log) if is_table else _recognise_fields(log, topics)
    by_type = propose_channels_by_message_type(topics) if is_table else []
    guesses = _make_channel_guesses([*recognised.channels, *by_type])
    guesses = list({guess.column: guess for guess in reversed(guesses)}.values())[::-1]
    # channels proposed in comments are asked for already
    open_columns = {each.column for each in recognised.channels if each.is_comment}
    found = {guess.column for guess in guesses} | (open_columns & _COLUMNS)
    formulas = {each.column: each.derive for each in recognised.channels if not each.is_comment}
    derived = {column: formula for column, formula in formulas.items() if formula}
    found |= set(derived)
    derived |= _derive_missing_channels(found)
    found |= set(derived)
    kinematic = "specific_force_x_m_s2" not in found
    lacking = [
        *recognised.questions,
        *_describe_missing_channels(found, recognised.questions, needs_acceleration=kinematic),
    ]
    lines = [
        f"# A first machine file for {_replace_unprintable(log.path.name)}: check every line.",
        '# A field in another unit than its comment states needs its unit: unit = "km/h".',
        "",
        "[machine]",
        f"name = {format_toml(log.path.stem)}",
        *(f"id = {format_toml(each)}" for each in log.machine_ids()[:1] if is_serial_number(each)),
        "# empty_mass_kg = 3614.0       # for the payload and for the verdict",
        "# wheel_radius_m = 0.42        # needed if the force comes from wheel torques",
        "# track_width_m = 1.5          # for the yaw torque and yaw rate",
        "# digs = false                 # where it has no bucket: a car, a rack, an arm",
        "force_share = 1.0              # share of the force that the measured wheels carry",
        'timezone = "UTC"               # time zone of printed times',
        "",
    ]
    sources = {guess.column: (guess.topic, guess.field) for guess in guesses}
    lines += make_imu_mounting_lines(log, sources)
    if is_table and time_axis is not None:
        lines += ["[log]", *_make_log_section_lines(time_axis), ""]
    lines += [f"# {_replace_unprintable(note)}" for note in log.notes()]
    lines += [""] if log.notes() else []
    for guess in guesses:
        lines.append(f"[channels.{guess.column}]")
        if guess.topic is not None:
            lines.append(f"topic = {format_toml(guess.topic)}")
        unit = find_unit_in_name(guess.column).replace("*", "·") or "any scale"
        # a field in another unit needs `unit` or `scale`, so state the assumed unit
        why = f"; {guess.reason}" if guess.reason else ""
        if guess.unit is not None:
            lines += [
                f"field = {format_toml(guess.field)}",
                f'unit = "{guess.unit}"  # {why[2:]}',
                "",
            ]
            continue
        lines += [
            f"field = {format_toml(guess.field)}  # in {unit}{why}"
            f"{_format_wheel_unit_comment(guess)}",
            "",
        ]
    for proposal in recognised.channels:
        lines += _make_channel_comment_lines(proposal) if proposal.is_comment else []
    has_speed = "speed_x_m_s" in found
    if kinematic and not has_speed and "acc_x_m_s2" not in found:
        # ready for the speed that the draft asks for
        derived["acc_x_m_s2"] = "d/dt speed_x_m_s"
    for column, formula in derived.items():
        is_open = not has_speed or any(each in formula for each in open_columns)
        sign = "# " if is_open else ""
        lines += [f"{sign}[channels.{column}]", f'{sign}derive = "{formula}"', ""]
    if set(SPEEDS) <= found and "yaw_rate_rad_s" not in found:
        lines += _YAW_RATE_BY_SIDES
    lines += [f"# missing: {sentence}" for sentence in lacking]
    is_unsure = any(_format_wheel_unit_comment(guess) for guess in guesses)
    profiles = profile_fields(log)
    used = {(guess.topic or TABLE, guess.field) for guess in guesses}
    to_answer = [
        *([_JOINT_UNIT] if is_unsure else []),
        *ask_about_joint_efforts(used, profiles),
        *ask_about_twist_frame(used, profiles),
    ]
    lines += [f"# to answer: {sentence}" for sentence in (*to_answer, *_TO_ANSWER)]
    rest = [*_make_unused_column_comments(profiles, used), *iter_topic_notes(topics, guesses)]
    lines += ["", *rest, "", "[settings.forces]"]
    lines.append(f'acceleration = "{"kinematic" if kinematic else "specific_force"}"')
    return "\n".join(lines) + "\n", lacking


def _make_log_section_lines(time_axis: TimeAxis) -> list[str]:
    """Make the lines of `[log]` for the given time column."""
    keys: dict[str, object] = {
        "time": time_axis.column,
        "time_unit": time_axis.unit,
        **asdict(time_axis.table),
    }
    return [f"{key} = {format_toml(value)}" for key, value in keys.items() if value is not None]


def _make_channel_guesses(proposals: Sequence[ChannelProposal]) -> list[ChannelGuess]:
    return [
        ChannelGuess(each.column, each.topic, each.field, each.unit, each.reason)
        for each in proposals
        if each.field and not each.is_comment
    ]


def _make_channel_comment_lines(proposal: ChannelProposal) -> list[str]:
    """Make the commented lines of a channel that the user must complete."""
    lines = [f"[channels.{proposal.column}]"]
    if proposal.topic:
        lines.append(f"topic = {format_toml(proposal.topic)}")
    if proposal.field:
        lines.append(f"field = {format_toml(proposal.field)}")
    if proposal.unit:
        lines.append(f'unit = "{proposal.unit}"')
    if proposal.derive:
        lines.append(f'derive = "{proposal.derive}"')
    return [f"# {_replace_unprintable(proposal.reason)}", *(f"# {line}" for line in lines), ""]


def _make_unused_column_comments(
    profiles: list[FieldProfile], used_columns: Collection[tuple[str, str]]
) -> list[str]:
    """Make commented lines of all unused columns, with unit, rate and range."""
    rest = [each for each in profiles if (each.topic, each.field) not in used_columns]
    several = any(each.topic != TABLE for each in rest)
    topics = [f"{_replace_unprintable(each.topic)} " if several else "" for each in rest]
    return [
        "# Also in the log:",
        *(
            f"#   {topic}{format_profile_comment(each)}{_format_unused_quantity_comment(each)}"
            for topic, each in zip(topics, rest, strict=True)
        ),
    ]


def _format_unused_quantity_comment(profile: FieldProfile) -> str:
    """Format the quantity of an unused column, if it is one that no channel has."""
    quantity = interpret_column_name(profile.field).quantity
    return f"  ({quantity})" if quantity in ("steering", "pressure", "power") else ""


def format_profile_comment(profile: FieldProfile) -> str:
    """Format a comment on a field: unit, rate, minimum, median, maximum and sparkline."""
    unit = f" [{profile.unit}]" if profile.unit else ""
    rate = "" if profile.rate_hz is None else f", {profile.rate_hz:.4g} Hz"
    if profile.low is None or profile.middle is None or profile.high is None:
        return _replace_unprintable(f"{profile.field}{unit}{rate}: {profile.course or 'no number'}")
    span = f"{profile.low:.4g} … {profile.middle:.4g} … {profile.high:.4g}"
    return _replace_unprintable(f"{profile.field}{unit}{rate}: {span}  {profile.course}")


def _format_wheel_unit_comment(guess: ChannelGuess) -> str:
    """Comment on the scale of a JointState's velocity in rad/s; empty for other fields."""
    is_speed = guess.field.startswith("velocity[") and guess.column.endswith("_m_s")
    return '; if it is in rad/s, set scale = "wheel_radius_m"' if is_speed else ""


def _recognise_fields(log: Log, topics: pl.DataFrame) -> Recognition:
    """Recognise the fields of messages by their types, else by their names."""
    machine = choose_topics_of_one_machine(topics)
    found = recognise_joints_of_log(log, machine.topics)
    by_type = propose_channels_by_message_type(machine.topics)
    found.channels += [
        each
        for each in by_type
        if each.column not in found.recognised_channels and not _is_yaw_rate_unfilled(log, each)
    ]
    found = recognise_fields_of_messages(log, machine.topics, found)
    if machine.choices:
        names = ", ".join(f"'{_replace_unprintable(each)}'" for each in machine.choices)
        found.add_question_of_subject("machine", _WHICH_MACHINE.format(names))
    filled = found.filled_or_proposed_channels
    for side_channel, whole in _OF_BOTH_SIDES.items():
        filled |= {whole} if found.has_channel_of_both_sides(side_channel) else set()
    for each in propose_channels_by_message_type(machine.topics, are_set_points=True):
        if each.column not in filled:
            source = _replace_unprintable(each.source_text)
            found.add_question_of_subject("column", _SET_POINT.format(source, each.column))
    return found


def _is_yaw_rate_unfilled(log: Log, proposal: ChannelProposal) -> bool:
    """Whether a proposed yaw rate has one value all along: some drivers leave the field at 0."""
    if proposal.column != "yaw_rate_rad_s" or proposal.topic is None:
        return False
    profiles = profile_fields(log, [proposal.topic])
    return any(each.field == proposal.field and each.low == each.high for each in profiles)


def _derive_missing_channels(channels: set[str]) -> dict[str, str]:
    derived: dict[str, str] = {}
    if "speed_x_m_s" not in channels:
        if {"speed_left_m_s", "speed_right_m_s"} <= channels:
            derived["speed_x_m_s"] = "mean(speed_left_m_s, speed_right_m_s)"
        elif "position_x_m" in channels:
            derived["speed_x_m_s"] = "d/dt position_x_m"
    has_speed = "speed_x_m_s" in channels or "speed_x_m_s" in derived
    if has_speed and not {"specific_force_x_m_s2", "acc_x_m_s2"} & channels:
        derived["acc_x_m_s2"] = "d/dt speed_x_m_s"
    # channels that an inertia estimate from spins needs
    turns = "torque_z_N_m" in channels or {"torque_left_N_m", "torque_right_N_m"} <= channels
    if turns and "yaw_rate_rad_s" in channels and "yaw_acc_rad_s2" not in channels:
        derived["yaw_acc_rad_s2"] = "d/dt yaw_rate_rad_s"
    return derived


def _describe_missing_channels(
    channels: set[str], questions: list[str], *, needs_acceleration: bool
) -> list[str]:
    lacking: list[str] = []
    if "force_x_N" not in channels and not {"torque_left_N_m", "torque_right_N_m"} <= channels:
        lacking.append("a force: channels.force_x_N, or both wheel torques")
    elif "force_x_N" not in channels and not any("wheel_radius_m" in each for each in questions):
        lacking.append("machine.wheel_radius_m, which turns wheel torques into a force")
    if "speed_x_m_s" not in channels:
        lacking.append("a speed: channels.speed_x_m_s, if need be derived from a position")
    if needs_acceleration and "acc_x_m_s2" not in channels:
        lacking.append("an acceleration: channels.specific_force_x_m_s2 or channels.acc_x_m_s2")
    return lacking


def iter_topic_notes(topics: pl.DataFrame, guesses: list[ChannelGuess]) -> Iterator[str]:
    """Yield comments on list fields of which no element is used, and on unreadable topics."""
    used = {(guess.topic, guess.field.partition("[")[0]) for guess in guesses}
    for row in topics.iter_rows(named=True):
        lists = [field for field in row["fields"] or [] if "[]" in field]
        rest = [each for each in lists if (row["topic"], each.partition("[")[0]) not in used]
        if row["problem"]:
            yield _replace_unprintable(f"#   {row['topic']} ({row['type']}): {row['problem']}")
        elif rest:
            yield _replace_unprintable(f"#   {row['topic']} ({row['type']}): {', '.join(rest)}")


def _replace_unprintable(text: str) -> str:
    return "".join(c if c.isprintable() else "?" for c in text)


def make_imu_mounting_lines(log: Log, sources: Mapping[str, Source]) -> list[str]:
    """Propose the IMU's mounting: a TOML table if gravity is clear, else comments.

    Args:
        log: an opened log.
        sources: sources of the recognised channels.

    Returns:
        Lines of a machine file; none without an accelerometer, or for a level one.
    """
    if not set(_AXES) <= set(sources):
        return []
    try:
        t_ns, force = read_times_and_fields_of_topic(log, [sources[name] for name in _AXES])
        speed = read_machine_speed_m_s(log, sources)
    except LogError:
        return []
    guess = estimate_imu_mounting(t_ns, force, speed) if t_ns.size else None
    return [] if guess is None else format_mounting_angle_lines(guess)


def format_mounting_angle_lines(guess: MountingGuess) -> list[str]:
    """Format the mounting angles with their reasons; as comments if a slope may explain them."""
    where = "at standstill" if guess.stood else "on average over the drive"
    found = f"# gravity lies {guess.tilt_deg:.0f}° off the IMU's z axis {where}"
    if guess.has_no_rotation and guess.yaw_deg is not None:
        return []
    if guess.has_no_rotation and not guess.is_tilt_beyond_ground_slope:
        return [f"{found}: level. Its yaw cannot be determined from", "# the log.", ""]
    sure = guess.is_tilt_beyond_ground_slope and guess.stood
    lines = [
        found
        + (": the IMU is mounted so" if sure else ": check this, the ground may slope instead"),
        "[machine.imu]",
        f"roll_deg = {guess.roll_deg:g}",
        f"pitch_deg = {guess.pitch_deg:g}",
    ]
    if guess.yaw_deg is None:
        lines.append("# yaw_deg = 0                  # not determined by the log: look at the IMU")
    else:
        std = f"± {guess.yaw_std_deg:.1g}°, from the direction of its starts"
        lines.append(f"yaw_deg = {guess.yaw_deg:g}{' ' * 15}# {std}")
    if not sure:
        lines = [line if line.startswith("#") else f"# {line}" for line in lines]
    return [*lines, ""]


def read_machine_speed_m_s(log: Log, sources: Mapping[str, Source]) -> tuple[Ints, Floats] | None:
    """Read stamps in ns and the machine's speed, or the mean of both sides'; None without them."""
    names = ("speed_x_m_s",) if "speed_x_m_s" in sources else SPEEDS
    if not set(names) <= set(sources) or len({sources[name][0] for name in names}) > 1:
        return None
    t_ns, v = read_times_and_fields_of_topic(log, [sources[name] for name in names])
    return (t_ns, v.mean(axis=1)) if t_ns.size > 1 else None


def read_times_and_fields_of_topic(log: Log, sources: list[Source]) -> tuple[Ints, Floats]:
    """Read stamps (n,) in ns and finite fields (n, fields) of one topic, one row per stamp.

    Raises:
        LogError: the fields cannot be read.
    """
    topic = sources[0][0] or "table"
    fields = [field for _, field in sources]
    start_ns = log.topics().filter(pl.col("topic") == topic)["start_ns"][0]
    read = log.read(topic, fields, end_ns=start_ns + LIMITS.look_ns)
    placed = assign_timestamps({topic: read})[0][topic].unique(
        "unix_ns", keep="last", maintain_order=True
    )
    x = np.stack([placed[field].cast(pl.Float64).to_numpy() for field in fields], axis=1)
    # excludes values that are not finite, or implausible in any unit
    finite = (np.abs(x) < LIMITS.max_reading).all(axis=1)
    return placed["unix_ns"].to_numpy()[finite], x[finite]
