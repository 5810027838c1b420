"""Channels recognised in a table's columns, with reasons, and open questions.

A column is proposed if its name states a quantity that fits its unit, or if its unit alone
determines the quantity; its correlation with other columns is added. What the answer needs but no
column states becomes a question: gear ratio, radius, side, unit, sign.
"""

import re
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from typing import Final

from analysis.model.physical_units import split_unit_from_name, unit_registry
from analysis.model.schema import CHANNEL_COLUMNS
from analysis.stages.signals.derive import find_unit_in_name
from replay.logs import TABLE, Log
from replay.recognise.correlations import (
    ColumnReader,
    add_correlations_with_slope_as_remarks,
    do_columns_hold_same_readings,
    find_accelerations_without_gravity,
    guess_accelerometer_units,
)
from replay.recognise.drives import add_question_on_gear_ratios, propose_force_and_speed_of_drives
from replay.recognise.proposals import LogColumn, Recognition
from replay.recognise.words import (
    ColumnMeaning,
    interpret_column_name,
    is_side_prefix_confirmed,
    put_side_first,
)

#: A column that may fill a channel, why, and the unit that it is in.
Claim = tuple[LogColumn, str, str | None]

_KNOWN: Final = frozenset(column.name for column in CHANNEL_COLUMNS)
#: What a column is whose unit is of this dimension, whatever its name.
_QUANTITY_OF: Final = {
    "N": "force", "N*m": "torque", "W": "power", "A": "current", "Pa": "pressure",
    "m/s": "speed", "m/s**2": "acceleration",
}  # fmt: skip
#: Torque and energy have one dimension, so have turns and frequencies: the name tells.
_TURNS: Final = ("rpm", "rad/s", "Hz", "deg/s")
#: Columns that are called by their unit. (A column "min", "deg" or "hr" is something else.)
_CALLED_BY_UNIT: Final = {
    "rpm": "rpm", "drehzahl": "rpm", "kph": "km/h", "kmh": "km/h", "mph": "mph", "watts": "W",
    "amps": "A", "nm": "N*m",
}  # fmt: skip
#: Units of signals that SAE J1939-71 and ISO 11783-7 define, by name in small letters: a decoded
#: CAN log seldom states them.
_UNIT_OF_SIGNAL: Final = {
    "wheelbasedvehiclespeed": "km/h", "navigationbasedvehiclespeed": "km/h",
    "tachographvehiclespeed": "km/h", "frontaxlespeed": "km/h",
    "wheelbasedmachinespeed": "m/s", "groundbasedmachinespeed": "m/s",
    "enginespeed": "rpm", "engspeed": "rpm",
    "transmissionoutputshaftspeed": "rpm", "transoutputshaftspeed": "rpm",
    "actualenginepercenttorque": "percent", "actualengpercenttorque": "percent",
}  # fmt: skip
#: Packages whose messages have one meaning: their types give channels, or none.
_STANDARD_PACKAGES: Final = frozenset((
    "std_msgs", "foxglove", "sensor_msgs", "nav_msgs", "geometry_msgs", "tf2_msgs", "tf",
    "diagnostic_msgs",
    "rosgraph_msgs", "rcl_interfaces", "visualization_msgs", "actionlib_msgs", "bond",
    "dynamic_reconfigure", "builtin_interfaces", "statistics_msgs", "theora_image_transport",
))  # fmt: skip
#: Messages of a single number.
_NUMBERS: Final = ("Float32", "Float64", "Int8", "Int16", "Int32", "Int64")
#: Fields of a message that are no readings: its stamp, and lists.
_STAMPS_AND_LISTS: Final = re.compile(
    r"(?:^|\.)(?:header|stamp|seq|n?secs?|nanosec|timestamp)\b|\[\]"
)


def recognise_channels_of_table(log: Log) -> Recognition:
    """Recognise the channels of a table.

    Args:
        log: an opened table.
    """
    return _recognise_channels_by_name(log, Recognition())


def recognise_fields_of_messages(log: Log, recognition: Recognition) -> Recognition:
    """Recognise channels by the names of fields and topics if the messages' types give no force.

    Args:
        log: an opened log of messages.
        recognition: channels that the types give.
    """
    filled = recognition.recognised_channels
    if "force_x_N" in filled or {"torque_left_N_m", "torque_right_N_m"} <= filled:
        return recognition
    return _recognise_channels_by_name(log, recognition)


def _recognise_channels_by_name(log: Log, recognition: Recognition) -> Recognition:
    columns = _list_columns_of_log(log)
    reader = ColumnReader(log, columns)
    known = Counter(column.field for column in columns if column.field in _KNOWN)
    for column in columns:
        # of several topics' forces, or of a command, words decide
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
            # an axis of an accelerometer claims its channel in the turn of each quantity
            if all(column != claimed for claimed, *_ in claims[channel]):
                claims[channel].append((column, reason, unit))
    for channel, each in claims.items():
        fill_only_candidate_or_add_question(reader, channel, each, recognition)
    _add_question_if_other_wheels_drive(columns, recognition)
    propose_columns_by_unit(columns, recognition)
    propose_columns_without_unit(columns, recognition)
    propose_force_and_speed_of_drives(columns, recognition)
    add_question_on_gear_ratios(columns, recognition)
    return add_correlations_with_slope_as_remarks(reader, columns, recognition)


def fill_only_candidate_or_add_question(
    reader: ColumnReader, channel: str, candidate_columns: Sequence[Claim], recognition: Recognition
) -> None:
    """Fill a channel with the only candidate column, or ask if there are several.

    Of several columns with equal readings the first is taken, except for forces, which add up.
    """
    if channel in recognition.recognised_channels:
        return
    column, reason, unit = candidate_columns[0]
    adds_up = channel.startswith(("force", "torque"))
    others = [other for other, *_ in candidate_columns[1:]]
    if all(
        not adds_up and do_columns_hold_same_readings(reader, column, other) for other in others
    ):
        recognition.fill_channel_if_empty(column, channel, reason, unit)
        return
    names = ", ".join(f"'{each.source_text}'" for each, *_ in candidate_columns)
    recognition.propose_source_of_derived_channel(column, channel, unit, f"one of {names}")
    together = "; if they act together, their sum" if adds_up else ""
    recognition.add_question_of_subject(
        "column", f"which of {names} is channels.{channel}{together}"
    )


def _add_question_if_other_wheels_drive(
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


def _list_columns_of_log(log: Log) -> list[LogColumn]:
    found: list[LogColumn] = []
    for row in log.topics().iter_rows(named=True):
        units = log.units(row["topic"])
        topic = None if row["topic"] == TABLE else row["topic"]
        is_empty = not row["messages"] or row["problem"]
        if topic and (is_empty or not _can_message_have_own_field_names(row["type"])):
            continue
        names = frozenset(row["fields"])
        for field in row["fields"]:
            if topic and _STAMPS_AND_LISTS.search(field):
                continue
            name = _extract_name_of_field(topic, field)
            unit = (
                units.get(field)
                or _find_unit_of_standard_name(name)
                or ((topic or name != field) and split_unit_from_name(name)[1])
                or None
            )
            said = _add_topic_meaning_to_field(
                interpret_column_name(strip_unit_from_name(name)), topic
            )
            if said.side and not is_side_prefix_confirmed(field, names):
                said = replace(said, side=None)
            if said.is_no_reading or said.is_elsewhere:
                said = replace(said, quantity=None)
                found.append(LogColumn(topic, field, unit, said, None))
                continue
            # "Motor Amps": the unit is the only word that names the quantity
            said = said if said.quantity or unit is None else interpret_column_name(name)
            found.append(
                LogColumn(
                    topic, field, unit, said, choose_quantity_permitted_by_unit(said.quantity, unit)
                )
            )
    return found


def _can_message_have_own_field_names(message_type: str) -> bool:
    """Whether the fields of a message may be named by who recorded them."""
    package, *kinds = re.split(r"[/.]", message_type)
    kind = kinds[-1] if kinds else ""
    return package not in _STANDARD_PACKAGES or (package == "std_msgs" and kind in _NUMBERS)


def _extract_name_of_field(topic: str | None, field: str) -> str:
    """Last part of a field's name, with its side in front; that of its topic if it has no other."""
    if topic is None or field == "data":
        return put_side_first(field if topic is None else topic.rstrip("/").rpartition("/")[2])
    *_, record, last = ["", *field.split(".")]
    # of `torque_Nm.left` the record says what it is
    whole = put_side_first(f"{record}.{last}")
    return last if whole.startswith(f"{record}.") else whole


def _add_topic_meaning_to_field(column_meaning: ColumnMeaning, topic: str | None) -> ColumnMeaning:
    """Meaning of a field with what its topic says and its own name leaves open."""
    for segment in reversed((topic or "").strip("/").split("/")[-2:]):
        around = interpret_column_name(segment)
        column_meaning = replace(
            column_meaning,
            side=column_meaning.side or around.side,
            axis=column_meaning.axis or around.axis,
            part=column_meaning.part or around.part,
            is_no_reading=column_meaning.is_no_reading or around.is_no_reading,
            is_elsewhere=column_meaning.is_elsewhere or around.is_elsewhere,
        )
    return column_meaning


def _find_unit_of_standard_name(name: str) -> str | None:
    """Unit of a column that is called by it, or that a standard defines."""
    signal = "".join(letter for letter in name.lower() if letter.isalnum())
    return _CALLED_BY_UNIT.get(name.lower()) or _UNIT_OF_SIGNAL.get(signal)


def strip_unit_from_name(name: str) -> str:
    """Words of a name without its unit."""
    cut = name
    for opening in "[(":
        cut = cut.partition(opening)[0] or cut
    return split_unit_from_name(cut)[0]


def choose_quantity_permitted_by_unit(quantity_of_name: str | None, unit: str | None) -> str | None:
    """Quantity that a name states, if its unit permits it."""
    if unit is None or unit in _TURNS or quantity_of_name is None:
        return quantity_of_name
    return find_quantity_of_unit(unit) or quantity_of_name


@cache
def find_quantity_of_unit(unit: str) -> str | None:
    """Quantity that a unit alone determines."""
    dimension = unit_registry().parse_units(unit).dimensionality
    for each, quantity in _QUANTITY_OF.items():
        if unit_registry().parse_units(each).dimensionality == dimension:
            return quantity
    return None


def _match_speed_channel(column: LogColumn) -> str | None:
    # what is in m/s is no turning of a motor
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
    return name if column.unit in ("deg", "rad") else None


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
    """Propose columns with meaningless names that alone have a unit of force or speed."""
    own = [each for each in columns if each.unit and not each.name_meaning.is_elsewhere]
    units = Counter(choose_quantity_permitted_by_unit("", column.unit) for column in own)
    for column in own:
        said = column.name_meaning
        if said.quantity is not None or column.unit in _TURNS or said.is_no_reading:
            continue
        quantity = choose_quantity_permitted_by_unit("", column.unit)
        channel = {"force": "force_x_N", "speed": "speed_x_m_s"}.get(quantity or "")
        is_wheel_load = quantity == "force" and said.part == "wheel"
        if channel and units[quantity] == 1 and said.axis in (None, "x") and not is_wheel_load:
            recognition.fill_channel_if_empty(
                column, channel, f"in {column.unit}, the only {quantity}"
            )


#: Channels of quantities that one column holds for the whole machine.
_WITHOUT_UNIT: Final = {
    "force": "force_x_N",
    "speed": "speed_x_m_s",
    "acceleration": "specific_force_x_m_s2",
}


def propose_columns_without_unit(columns: Sequence[LogColumn], recognition: Recognition) -> None:
    """Propose columns whose names state a quantity but which have no unit."""
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
