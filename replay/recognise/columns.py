"""List the columns of a log, with elements of short lists, units and the meanings of names."""

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cache
from typing import Any, Final, NamedTuple

import polars as pl

from analysis.model.physical_units import get_unit_registry, split_unit_from_name
from estimators.errors import LogError
from replay.logs import TABLE, Log
from replay.recognise.proposals import LogColumn
from replay.recognise.recognise_limits import LIMITS
from replay.recognise.words import (
    ColumnMeaning,
    interpret_column_name,
    is_side_prefix_confirmed,
    move_trailing_side_to_front,
)

#: Quantity of a column whose unit has this dimension, whatever its name.
_QUANTITY_OF: Final = {
    "N": "force", "N*m": "torque", "W": "power", "A": "current", "Pa": "pressure",
    "m/s": "speed", "m/s**2": "acceleration",
}  # fmt: skip
#: Units whose quantity only the name shows: revolutions and frequencies have the same dimension.
TURN_UNITS: Final = ("rpm", "rad/s", "Hz", "deg/s")
#: Units that are used as names of columns. (A column "min", "deg" or "hr" is something else.)
_CALLED_BY_UNIT: Final = {
    "rpm": "rpm", "drehzahl": "rpm", "kph": "km/h", "kmh": "km/h", "mph": "mph", "watts": "W",
    "amps": "A", "nm": "N*m",
}  # fmt: skip
#: Units of signals that SAE J1939-71 and ISO 11783-7 define, by name in lower case, since decoded
#: CAN logs seldom state them.
_UNIT_OF_SIGNAL: Final = {
    "wheelbasedvehiclespeed": "km/h", "navigationbasedvehiclespeed": "km/h",
    "tachographvehiclespeed": "km/h", "frontaxlespeed": "km/h",
    "wheelbasedmachinespeed": "m/s", "groundbasedmachinespeed": "m/s",
    "enginespeed": "rpm", "engspeed": "rpm",
    "transmissionoutputshaftspeed": "rpm", "transoutputshaftspeed": "rpm",
    "actualenginepercenttorque": "percent", "actualengpercenttorque": "percent",
}  # fmt: skip
#: Packages whose messages have a fixed meaning, so that their types determine any channels.
_STANDARD_PACKAGES: Final = frozenset((
    "std_msgs", "foxglove", "sensor_msgs", "nav_msgs", "geometry_msgs", "tf2_msgs", "tf",
    "diagnostic_msgs",
    "rosgraph_msgs", "rcl_interfaces", "visualization_msgs", "actionlib_msgs", "bond",
    "dynamic_reconfigure", "builtin_interfaces", "statistics_msgs", "theora_image_transport",
))  # fmt: skip
#: Messages of a single number, whose meaning is in the name of the topic.
_NUMBERS: Final = ("Float32", "Float64", "Int8", "Int16", "Int32", "Int64")
_MESSAGES_NAMED_BY_TOPIC: Final = frozenset(
    (*_NUMBERS, *(f"{each}MultiArray" for each in _NUMBERS))
)
#: Vectors of standard messages that programs write into tables by their path, as
#: `twist.linear.x`, with the quantity that the definition of the message states, and its unit.
_VECTORS_OF_MESSAGES: Final = {
    "linear": ("speed", "m/s"),
    "linear_acceleration": ("acceleration", "m/s**2"),
    "angular": ("yaw rate", "rad/s"),
    "angular_velocity": ("yaw rate", "rad/s"),
}
_VECTOR_PATH: Final = re.compile(
    r"(?:^|[./])(?P<vector>linear|linear_acceleration|angular|angular_velocity)[./]"
    r"(?P<axis>[xyz])$"
)
#: Fields of a message that are not readings: its stamp, and lists of records.
_STAMPS_AND_RECORDS: Final = re.compile(
    r"(?:^|\.)(?:header|stamp|seq|n?secs?|nanosec|timestamp)\b|\[\]."
)
#: Meaning of the elements of a list by its length: axes of a vector; sides, which are asked for.
_AXES_BY_LENGTH: Final = {3: ("x", "y", "z")}
_SIDES_BY_LENGTH: Final = {2: ("left", "right")}


def find_list_elements(log: Log, topic_row: Mapping[str, Any]) -> dict[str, tuple[str, ...]]:
    """Find the elements of each short list of numbers in a topic's first messages: `accel_g[0]`.

    Lists that are empty in these messages, long lists, as of a scanner, and lists of records are
    absent.

    Args:
        log: an opened log.
        topic_row: row of the topic in `Log.topics`; fields of lists end in `[]`.
    """
    start_ns, end_ns = topic_row["start_ns"], topic_row["end_ns"]
    looked_at = min(1.0, LIMITS.list_messages / max(topic_row["messages"], 1))
    until_ns = start_ns + int(looked_at * (end_ns - start_ns))
    found: dict[str, tuple[str, ...]] = {}
    for field in topic_row["fields"]:
        if not field.endswith("[]") or field.count("[]") > 1:
            continue
        elements = [f"{field[:-1]}{k}]" for k in range(LIMITS.list_max_elements + 1)]
        frame = _read_elements(log, topic_row["topic"], elements, until_ns)
        filled = [
            place
            for place, name in enumerate(elements)
            if name in frame.columns and frame[name].dtype.is_numeric() and frame[name].count()
        ]
        if filled and filled[-1] < LIMITS.list_max_elements:
            found[field] = tuple(elements[: filled[-1] + 1])
    return found


def _read_elements(log: Log, topic: str, elements: Sequence[str], until_ns: int) -> pl.DataFrame:
    """Read the elements that a list has; if its length is fixed, reading others is an error."""
    for count in range(len(elements), 0, -1):
        with suppress(LogError):
            return log.read(topic, elements[:count], end_ns=until_ns)
    return pl.DataFrame()


class _NamedField(NamedTuple):
    """A field; for a list element also the list's name, and the element's side or axis."""

    field: str
    list_name: str | None = None
    side: str | None = None
    axis: str | None = None


def _list_named_fields(log: Log, topic_row: Mapping[str, Any]) -> list[_NamedField]:
    """List the fields of a topic that may be readings; short lists by their elements."""
    names: list[str] = topic_row["fields"]
    if topic_row["topic"] == TABLE:
        elements = _group_elements_by_list(names)
        grouped = {element for found in elements.values() for element in found}
        names = [name for name in names if name not in grouped]
    else:
        names = [name for name in names if not _STAMPS_AND_RECORDS.search(name)]
        elements = find_list_elements(log, {**topic_row, "fields": names})
        names = [name for name in names if not name.endswith("[]")]
    fields = [*map(_NamedField, names)]
    for list_name, found in elements.items():
        sides, axes = _SIDES_BY_LENGTH.get(len(found)), _AXES_BY_LENGTH.get(len(found))
        for place, element in enumerate(found):
            side, axis = (each[place] if each else None for each in (sides, axes))
            fields.append(_NamedField(element, list_name.removesuffix("[]"), side, axis))
    return fields


def _group_elements_by_list(column_names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Group columns that a program made of lists, such as `accel[0]`, by the list's name."""
    known = frozenset(column_names)
    found: dict[str, tuple[str, ...]] = {}
    for name in column_names:
        list_name = name.removesuffix("[0]")
        if list_name == name:
            continue
        elements = (f"{list_name}[{k}]" for k in range(LIMITS.list_max_elements + 1))
        present = tuple(each for each in elements if each in known)
        if len(present) <= LIMITS.list_max_elements:
            found[list_name] = present
    return found


def list_columns_of_log(log: Log, topics: pl.DataFrame | None = None) -> list[LogColumn]:
    """List the columns of a log with their units and the meanings of their names.

    Args:
        log: an opened log; messages of standard types, whose fields have fixed names, are left out.
        topics: rows of the topics to list; None for all.
    """
    found: list[LogColumn] = []
    for row in (log.topics() if topics is None else topics).iter_rows(named=True):
        units = log.units(row["topic"])
        topic = None if row["topic"] == TABLE else row["topic"]
        is_empty = not row["messages"] or row["problem"]
        if topic and (is_empty or not _can_message_have_own_field_names(row["type"])):
            continue
        names = frozenset(row["fields"])
        for field, named_by, side, axis in _list_named_fields(log, row):
            name = _extract_quantity_name_with_side_first(topic, named_by or field)
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
            said = replace(said, side=said.side or side, axis=said.axis or axis)
            match = _VECTOR_PATH.search(strip_unit_from_name(field).strip())
            if topic is None and match and not (said.side or said.part or said.is_linkage):
                said, unit = interpret_vector_path(said, match, unit)
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
    """Whether the author of a message type or topic has named its fields."""
    package, *kinds = re.split(r"[/.]", message_type)
    kind = kinds[-1] if kinds else ""
    return package not in _STANDARD_PACKAGES or (
        package == "std_msgs" and kind in _MESSAGES_NAMED_BY_TOPIC
    )


def _extract_quantity_name_with_side_first(topic: str | None, field: str) -> str:
    """Last part of a field's name, or of its topic's, with a trailing side moved to the front."""
    if topic is None or field == "data":
        return move_trailing_side_to_front(
            field if topic is None else topic.rstrip("/").rpartition("/")[2]
        )
    *_, record, last = ["", *field.split(".")]
    # in `torque_Nm.left`, the record has the quantity
    whole = move_trailing_side_to_front(f"{record}.{last}")
    return last if whole.startswith(f"{record}.") else whole


def _add_topic_meaning_to_field(column_meaning: ColumnMeaning, topic: str | None) -> ColumnMeaning:
    """Complete the meaning of a field by that of its topic's name."""
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


def interpret_vector_path(
    column_meaning: ColumnMeaning, match: re.Match[str], unit: str | None
) -> tuple[ColumnMeaning, str | None]:
    """Meaning and unit of a column whose name is the path of a vector in a standard message."""
    quantity, defined_unit = _VECTORS_OF_MESSAGES[match["vector"]]
    axis = match["axis"]
    turns_elsewhere = quantity == "yaw rate" and axis != "z"
    return (
        replace(
            column_meaning,
            quantity=None if turns_elsewhere else quantity,
            axis=axis,
            is_without_gravity=False,
        ),
        unit or defined_unit,
    )


def _find_unit_of_standard_name(name: str) -> str | None:
    """Unit of a column that is named by its unit, or defined in a standard; None for others."""
    signal = "".join(letter for letter in name.lower() if letter.isalnum())
    return _CALLED_BY_UNIT.get(name.lower()) or _UNIT_OF_SIGNAL.get(signal)


def strip_unit_from_name(name: str) -> str:
    """Remove the unit from a name."""
    cut = name
    for opening in "[(":
        cut = cut.partition(opening)[0] or cut
    return split_unit_from_name(cut)[0]


def choose_quantity_permitted_by_unit(quantity_of_name: str | None, unit: str | None) -> str | None:
    """Quantity that a name states if its unit permits it, else the quantity of the unit."""
    if unit is None or unit in TURN_UNITS or quantity_of_name is None:
        return quantity_of_name
    return find_quantity_of_unit(unit) or quantity_of_name


@cache
def find_quantity_of_unit(unit: str) -> str | None:
    """Quantity that a unit alone determines; None if several are possible."""
    dimension = get_unit_registry().parse_units(unit).dimensionality
    for each, quantity in _QUANTITY_OF.items():
        if get_unit_registry().parse_units(each).dimensionality == dimension:
            return quantity
    return None
