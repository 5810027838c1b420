"""Propose a speed derived from wheels, motors or encoders, and ask for what it needs."""

from collections.abc import Sequence
from typing import Final

from replay.recognise.columns import TURN_UNITS
from replay.recognise.drives import GEAR_QUESTION, RADIUS_QUESTION
from replay.recognise.proposals import SIDES, LogColumn, Recognition

_TURNING: Final = ("speed", "angular speed")
#: In the name of a speed over ground by satellites, which is mostly a magnitude and late.
_SATELLITES: Final = ("gnss", "gps")


def propose_speed_of_drives(columns: Sequence[LogColumn], recognition: Recognition) -> None:
    """Propose a speed from wheels, motors or encoders if no column contains one."""
    if (
        "speed_x_m_s" in recognition.filled_or_proposed_channels
        or "position_x_m" in recognition.recognised_channels
        or recognition.has_channel_of_both_sides("speed_{}_m_s")
    ):
        return
    encoders = [c for c in columns if _is_encoder_of_drive(c)]
    of_wheels = [c for c in encoders if c.name_meaning.side or c.name_meaning.part == "wheel"]
    any(
        propose(each, recognition)
        for propose, each in (
            (propose_speed_from_wheels, columns),
            (propose_speed_from_encoders, of_wheels),
            (propose_speed_from_motor, columns),
            (propose_speed_from_encoders, encoders),
        )
    )


def _choose_both_sides_or_first(columns: Sequence[LogColumn]) -> list[LogColumn]:
    """Choose the first column of each side; if a side has none, only the first column."""
    by_side = {c.name_meaning.side: c for c in reversed(columns)}
    is_of_both = set(SIDES) <= set(by_side)
    return [by_side[side] for side in SIDES] if is_of_both else [*columns[:1]]


def _is_encoder_of_drive(column: LogColumn) -> bool:
    """Whether a column counts the ticks of an encoder: `tick` alone may count rows or time."""
    said = column.name_meaning
    names_encoder = "enc" in column.field.lower() or said.side or said.part == "wheel"
    is_other = said.is_linkage or said.part == "motor"
    return (
        column.quantity == "encoder"
        and column.unit is None
        and bool(names_encoder)
        and not is_other
    )


def _find_turn_unit(column: LogColumn) -> str | None:
    """Unit of a column of revolutions, or of angular speed (by default rad/s); None for others."""
    if column.unit is None and column.quantity == "angular speed":
        return "rad/s"
    return column.unit if column.unit in TURN_UNITS else None


def propose_speed_from_encoders(encoders: Sequence[LogColumn], recognition: Recognition) -> bool:
    """Propose positions of wheels from encoder ticks; return whether there are any."""
    encoders = _choose_both_sides_or_first(encoders)
    if not encoders:
        return False
    names = [
        f"encoder_{c.name_meaning.side}_1" if c.name_meaning.side else "encoder_1" for c in encoders
    ]
    reason = (
        f"{', '.join(c.source_text for c in encoders)}: ticks; needs ticks a turn and the radius"
    )
    for column, name in zip(encoders, names, strict=True):
        recognition.propose_source_of_derived_channel(column, name, None, reason)
    turned = f"({' + '.join(names)}) / {len(names)}" if len(names) > 1 else names[0]
    recognition.propose_derived_channel_as_comment(
        "position_x_m", f"{turned} / TICKS_PER_TURN * 6.283185 * wheel_radius_m", reason
    )
    recognition.propose_derived_channel_as_comment("speed_x_m_s", "d/dt position_x_m", reason)
    recognition.add_question_of_subject(
        "gear", "the ticks of a turn of the wheel: TICKS_PER_TURN in channels.position_x_m.derive"
    )
    recognition.add_question_of_subject("radius", RADIUS_QUESTION)
    return True


def _list_turning_wheels(columns: Sequence[LogColumn]) -> list[LogColumn]:
    """Columns with the revolutions or angular speed of wheels."""
    return [
        c
        for c in columns
        if c.quantity in _TURNING
        and _find_turn_unit(c) is not None
        and c.name_meaning.part != "motor"
        and (c.name_meaning.side or c.name_meaning.part == "wheel")
    ]


def add_question_on_unsigned_speed(columns: Sequence[LogColumn], recognition: Recognition) -> None:
    """Ask whether the machine reverses if its speed is from satellites and wheels have one too."""
    speed = next(
        (
            each.source_text
            for each in recognition.channels
            if each.column == "speed_x_m_s" and each.field and not each.is_comment
        ),
        "",
    )
    wheels = _list_turning_wheels(columns)
    if wheels and any(word in speed.lower() for word in _SATELLITES):
        recognition.add_question_of_subject(
            "column",
            f"whether '{speed}' is negative in reverse, and not late; the wheels' speed is both: "
            f"set channels.speed_x_m_s to '{wheels[0].source_text}', scale = \"wheel_radius_m\"",
        )


def propose_speed_from_wheels(columns: Sequence[LogColumn], recognition: Recognition) -> bool:
    """Propose speeds from revolutions of both sides or one wheel; return whether there are any."""
    wheels = _choose_both_sides_or_first(_list_turning_wheels(columns))
    if not wheels:
        return False
    channels = (
        [f"speed_{side}_m_s" for side in SIDES] if len(wheels) == len(SIDES) else ["speed_x_m_s"]
    )
    for channel, column in zip(channels, wheels, strict=True):
        source = channel.replace("speed", "wheel").replace("m_s", "rpm")
        reason = f"{column.source_text}: turns of a wheel; needs its radius"
        recognition.propose_source_of_derived_channel(
            column, source, _find_turn_unit(column), reason
        )
        recognition.propose_derived_channel_as_comment(
            channel, f"{source} * wheel_radius_m", reason
        )
    recognition.add_question_of_subject("radius", RADIUS_QUESTION)
    return True


def propose_speed_from_motor(columns: Sequence[LogColumn], recognition: Recognition) -> bool:
    """Propose a speed from revolutions of a motor; return whether there are any."""
    turning = [c for c in columns if c.quantity in _TURNING]
    candidates = (
        *(c for c in columns if c.quantity == "erpm"),
        *(c for c in turning if c.unit in TURN_UNITS),
        # the unit is guessed only for a motor
        *(c for c in turning if _find_turn_unit(c) and c.name_meaning.part == "motor"),
    )
    turns = next(iter(candidates), None)
    if turns is None:
        return False
    pairs = " / POLE_PAIRS" if turns.quantity == "erpm" else ""
    reason = f"{turns.source_text}: revolutions; needs the gear ratio" + (
        " and pole pairs" if pairs else ""
    )
    stated = _find_turn_unit(turns)
    unit = None if stated in (None, "rpm") else stated
    recognition.propose_source_of_derived_channel(turns, "motor_rpm", unit, reason)
    recognition.propose_derived_channel_as_comment(
        "speed_x_m_s", f"motor_rpm{pairs} / GEAR * wheel_radius_m", reason
    )
    recognition.add_question_of_subject("gear", GEAR_QUESTION.format("speed_x_m_s"))
    if pairs:
        recognition.add_question_of_subject("gear", "the motor's POLE_PAIRS, in the same line")
    elif turns.field.lower() == "rpm":
        recognition.add_question_of_subject(
            "gear",
            f"whether '{turns.source_text}' counts electrical turns (VESC); if so, / POLE_PAIRS",
        )
    recognition.add_question_of_subject("radius", RADIUS_QUESTION)
    return True
