"""Recognise the channels of a table's columns, with reasons, and list open questions.

A column is proposed if its name states a quantity that fits its unit, or if its unit alone
determines the quantity; its correlation with other columns is added. Anything needed that no column
states becomes a question: gear ratio, radius, side, unit, sign.
"""

from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from typing import Final

import polars as pl

from analysis.model.schema import CHANNEL_COLUMNS
from analysis.stages.signals.derive import find_unit_in_name
from replay.logs import Log
from replay.recognise.columns import (
    TURN_UNITS,
    choose_quantity_permitted_by_unit,
    list_columns_of_log,
)
from replay.recognise.correlations import (
    ColumnReader,
    add_correlations_with_slope_as_remarks,
    do_columns_hold_same_readings,
    find_accelerations_without_gravity,
    guess_accelerometer_units,
)
from replay.recognise.drives import add_question_on_gear_ratios, propose_force_of_drives
from replay.recognise.proposals import AXLES, LogColumn, Recognition
from replay.recognise.speeds import add_question_on_unsigned_speed, propose_speed_of_drives

#: Column that may fill a channel, the reason, and its unit.
Claim = tuple[LogColumn, str, str | None]

#: Quantities that are summed over wheels; others are averaged.
_ADD_UP: Final = ("force", "torque")

_KNOWN: Final = frozenset(column.name for column in CHANNEL_COLUMNS)


def recognise_channels_of_table(log: Log) -> Recognition:
    """Recognise the channels of a table.

    Args:
        log: an opened table.
    """
    return _recognise_channels_by_name(log, None, Recognition())


def recognise_fields_of_messages(
    log: Log, topics: pl.DataFrame, recognition: Recognition
) -> Recognition:
    """Recognise channels by names of fields and topics if the message types determine no force.

    Args:
        log: an opened log of messages.
        topics: rows of its topics that may be used.
        recognition: channels that the message types determine.
    """
    filled = recognition.recognised_channels
    if "force_x_N" in filled or {"torque_left_N_m", "torque_right_N_m"} <= filled:
        return recognition
    return _recognise_channels_by_name(log, topics, recognition)


def _recognise_channels_by_name(
    log: Log, topics: pl.DataFrame | None, recognition: Recognition
) -> Recognition:
    columns = list_columns_of_log(log, topics)
    reader = ColumnReader(log, columns)
    known = Counter(column.field for column in columns if column.field in _KNOWN)
    for column in columns:
        # fields of that name in several topics, and commands, are excluded
        if known[column.field] == 1 and not column.name_meaning.is_no_reading:
            recognition.fill_channel_if_empty(
                column, column.field, "its name", find_unit_in_name(column.field)
            )
    by_gravity = guess_accelerometer_units(reader, columns)
    kinematic = find_accelerations_without_gravity(reader, columns)
    claims: defaultdict[str, list[Claim]] = defaultdict(list)
    for quantity, channel_of in _CHANNEL_OF.items():
        for column in columns:
            channel = channel_of(column) if column.quantity == quantity else None
            if channel is None and column in by_gravity:
                channel = _match_specific_force_channel(column)
            if channel is None:
                continue
            if column in kinematic or (
                column.name_meaning.is_without_gravity and channel.startswith("specific")
            ):
                if channel != "specific_force_x_m_s2":
                    continue
                channel = "acc_x_m_s2"
            unit, reason = by_gravity.get(
                column, (column.unit, "its name and unit" if column.unit else "its name")
            )
            # an axis of an accelerometer comes up for several quantities: claim its channel once
            if all(column != claimed for claimed, *_ in claims[channel]):
                claims[channel].append((column, reason, unit))
    for channel, each in claims.items():
        fill_only_candidate_or_add_question(reader, channel, each, recognition)
    _add_question_on_other_driven_wheels(columns, recognition)
    propose_columns_by_unit(columns, recognition)
    add_proposals_for_columns_without_unit(columns, recognition)
    propose_force_of_drives(columns, recognition)
    propose_speed_of_drives(columns, recognition)
    add_question_on_unsigned_speed(columns, recognition)
    _propose_pitch(columns, recognition)
    add_question_on_gear_ratios(columns, recognition)
    _add_question_if_list_order_gives_side(recognition)
    return add_correlations_with_slope_as_remarks(reader, columns, recognition)


def fill_only_candidate_or_add_question(
    reader: ColumnReader, channel: str, candidate_columns: Sequence[Claim], recognition: Recognition
) -> None:
    """Fill a channel with the only candidate column, or ask if there are several.

    Of several columns with equal readings, the first is used, except for forces, which add up.
    """
    if channel in recognition.recognised_channels:
        return
    column, reason, unit = candidate_columns[0]
    adds_up = channel.startswith(_ADD_UP)
    others = [other for other, *_ in candidate_columns[1:]]
    if all(
        not adds_up and do_columns_hold_same_readings(reader, column, other) for other in others
    ):
        recognition.fill_channel_if_empty(column, channel, reason, unit)
        return
    if add_wheels_of_both_axles(channel, candidate_columns, recognition):
        return
    names = ", ".join(f"'{each.source_text}'" for each, *_ in candidate_columns)
    recognition.propose_source_of_derived_channel(column, channel, unit, f"one of {names}")
    together = "; if they act together, their sum" if adds_up else ""
    recognition.add_question_of_subject(
        "column", f"which of {names} is channels.{channel}{together}"
    )


def add_wheels_of_both_axles(
    channel: str, candidate_columns: Sequence[Claim], recognition: Recognition
) -> bool:
    """Derive a side's channel from its front and rear wheel; return whether it has one of each.

    Torques are summed, speeds averaged.
    """
    by_axle = {
        column.name_meaning.axle: claim for claim in candidate_columns for column in claim[:1]
    }
    side = candidate_columns[0][0].name_meaning.side
    if set(by_axle) != set(AXLES) or len(candidate_columns) != len(AXLES) or side is None:
        return False
    names: list[str] = []
    for axle in AXLES:
        column, reason, unit = by_axle[axle]
        names.append(channel.replace(side, f"{axle}_{side}"))
        recognition.fill_channel_if_empty(column, names[-1], reason, unit)
    adds_up = channel.startswith(_ADD_UP)
    derivation = " + ".join(names) if adds_up else f"mean({', '.join(names)})"
    wheels = " and ".join(f"'{claim[0].source_text}'" for claim in by_axle.values())
    recognition.add_derived_channel(channel, derivation, wheels)
    return True


def _add_question_on_other_driven_wheels(
    columns: Sequence[LogColumn], recognition: Recognition
) -> None:
    """Ask whether other wheels drive too if a left and a right torque make the force."""
    if not {"torque_left_N_m", "torque_right_N_m"} <= recognition.recognised_channels:
        return
    more = [
        f"'{each.source_text}'"
        for each in columns
        if each.quantity == "torque" and each.has_dimension_of_unit("N*m")
        if each.name_meaning.side is None
        and each.name_meaning.part != "motor"
        and each.name_meaning.axis is None
    ]
    if more:
        names = ", ".join(more)
        recognition.add_question_of_subject(
            "column", f"whether {names} also drives the machine: torques of wheels add up"
        )


def _propose_pitch(columns: Sequence[LogColumn], recognition: Recognition) -> None:
    """Propose a pitch as a comment, since no log shows its sign."""
    for column in columns:
        said = column.name_meaning
        is_pitch = "pitch" in column.field.lower() and _is_angle(column)
        if not is_pitch or said.is_linkage or said.is_no_reading:
            continue
        if "pitch_rad" not in recognition.filled_or_proposed_channels:
            reason = (
                f"{column.source_text}: uncomment if it is positive nose up and 0 on level ground; "
                "without a pitch, slopes count as friction"
            )
            recognition.propose_source_of_derived_channel(column, "pitch_rad", column.unit, reason)


def _is_angle(column: LogColumn) -> bool:
    return column.unit in ("deg", "rad")


def _add_question_if_list_order_gives_side(recognition: Recognition) -> None:
    """Ask whether the first element of a list of two is the left one."""
    firsts = [
        f"'{each.source_text}'"
        for each in recognition.channels
        if "_left_" in each.column and each.field and each.field.endswith("[0]")
    ]
    if firsts:
        are = "is the left one" if len(firsts) == 1 else "are the left ones"
        recognition.add_question_of_subject("side", f"whether {' and '.join(firsts)} {are}")


def _match_speed_channel(column: LogColumn) -> str | None:
    # a column in m/s is not the revolutions of a motor
    if column.name_meaning.axis in ("y", "z"):
        return None
    name = f"speed_{column.name_meaning.side}_m_s" if column.name_meaning.side else "speed_x_m_s"
    return name if column.has_dimension_of_channel(name) else None


def _match_force_channel(column: LogColumn) -> str | None:
    off_axis = (
        column.name_meaning.axis in ("y", "z")
        or column.name_meaning.side
        or column.name_meaning.is_linkage
    )
    return "force_x_N" if not off_axis and column.has_dimension_of_channel("force_x_N") else None


def _match_torque_channel(column: LogColumn) -> str | None:
    side = column.name_meaning.side
    name = f"torque_{side}_N_m"
    return (
        name
        if side and column.name_meaning.part != "motor" and column.has_dimension_of_channel(name)
        else None
    )


def _match_acceleration_channel(column: LogColumn) -> str | None:
    return (
        _match_specific_force_channel(column)
        if column.has_dimension_of_channel("acc_x_m_s2")
        else None
    )


def _match_specific_force_channel(column: LogColumn) -> str | None:
    return f"specific_force_{column.name_meaning.axis}_m_s2" if column.name_meaning.axis else None


def _match_position_channel(column: LogColumn) -> str | None:
    along = column.name_meaning.axis in (None, "x")
    return "position_x_m" if along and column.has_dimension_of_channel("position_x_m") else None


def _match_yaw_rate_channel(column: LogColumn) -> str | None:
    return "yaw_rate_rad_s" if column.has_dimension_of_channel("yaw_rate_rad_s") else None


def _match_angle_channel(name: str, column: LogColumn) -> str | None:
    return name if _is_angle(column) else None


def _is_column_in_degrees(column: LogColumn) -> bool:
    return column.unit in (None, "deg")


_CHANNEL_OF: Final[dict[str, Callable[[LogColumn], str | None]]] = {
    "speed": _match_speed_channel,
    "force": _match_force_channel,
    "torque": _match_torque_channel,
    "acceleration": _match_acceleration_channel,
    "position": _match_position_channel,
    "yaw rate": _match_yaw_rate_channel,
    "boom": lambda column: _match_angle_channel("boom_rad", column),
    "bucket": lambda column: _match_angle_channel("bucket_rad", column),
    "gear ratio": lambda column: "gear_ratio_1" if column.unit is None else None,
    "latitude": lambda column: "latitude_deg" if _is_column_in_degrees(column) else None,
    "longitude": lambda column: "longitude_deg" if _is_column_in_degrees(column) else None,
}


def propose_columns_by_unit(columns: Sequence[LogColumn], recognition: Recognition) -> None:
    """Propose columns with uninformative names, if only one has a unit of force or of speed."""
    own = [each for each in columns if each.unit and not each.name_meaning.is_elsewhere]
    units = Counter(choose_quantity_permitted_by_unit("", column.unit) for column in own)
    for column in own:
        said = column.name_meaning
        if said.quantity is not None or column.unit in TURN_UNITS or said.is_no_reading:
            continue
        quantity = choose_quantity_permitted_by_unit("", column.unit)
        channel = {"force": "force_x_N", "speed": "speed_x_m_s"}.get(quantity or "")
        is_wheel_load = quantity == "force" and said.part == "wheel"
        if channel and units[quantity] == 1 and said.axis in (None, "x") and not is_wheel_load:
            recognition.fill_channel_if_empty(
                column, channel, f"in {column.unit}, the only {quantity}"
            )


#: Channel of each quantity that one column may give for the whole machine.
_WITHOUT_UNIT: Final = {
    "force": "force_x_N",
    "speed": "speed_x_m_s",
    "acceleration": "specific_force_x_m_s2",
}


def add_proposals_for_columns_without_unit(
    columns: Sequence[LogColumn], recognition: Recognition
) -> None:
    """Propose columns whose names state a quantity but that state no unit."""
    given = {each.column for each in recognition.channels}
    for quantity, channel in _WITHOUT_UNIT.items():
        if channel in given or (quantity == "speed" and "speed_left_m_s" in given):
            continue
        for column in columns:
            said = column.name_meaning
            part = said.part if quantity != "speed" or said.part == "motor" else None
            whole = said.side is None and part is None and said.axis in (None, "x")
            if column.quantity == quantity and column.unit is None and whole:
                recognition.propose_channel_without_unit(column, channel)
                break
