"""Names and units of a table's columns, from the rows above its data."""

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Final

from analysis.model.physical_units import (
    gain_and_offset_to_si,
    pint_name_of_unit,
    split_unit_from_name,
)
from estimators.errors import MachineError
from replay.logs.tables.hints import DialectError

_BRACKETS: Final = re.compile(r"(?s)(?P<name>.*?)[\s_]*[\[({<](?P<unit>[^\[\](){}<>]*)[\])}>]\s*")
#: A form of times, not a unit: (hh:mm:ss.sss), [dd/mm/yyyy].
_FORM: Final = re.compile(
    r"(?s)(?P<name>.*?)[\s_]*[\[({<](?=[^\])}>]*(?i:hh|ss|yy))[\shHmMsSfFdDyY:/.,\-]+(?:UTC|GMT)?"
    r"[\])}>]\s*"
)
#: A quantity over its unit, as DIN 1313 writes it: t/s, v/(km/h).
_OVER: Final = re.compile(r"(?P<name>[^/]+)/(?P<unit>\([^()]+\)|[^\s()]+)")
#: "Speed / km/h", "Speed in km/h", "Speed, km/h".
_BEHIND: Final = re.compile(r"(?s)(?P<name>.*?)(?:\s+/\s*|\s+in\s+|,\s*)(?P<unit>\S+)\s*")
#: A multiple of a unit, which no number of the table is in: "[0.1 ms]", "(x10 N)", "/100 ms".
_MULTIPLE: Final = re.compile(
    r"(?s).*[\[(/{<\s][x×*]?\s*\d[\d.,]*\s*[x×*]?\s*(?P<unit>[^\d\s\[\](){}<>]+)[\])}>]*\s*"
)
#: Words behind the unit: "Time (s) Run #1", "Speed, km/h (LGR S/N: 209)".
_MIDDLE: Final = re.compile(
    r"(?s)(?P<name>[^\[\](){}]+?)\s*[\[(](?P<unit>[^\[\](){}]*)[\])]\s*(?P<rest>\S.*)"
)
_REMARK: Final = re.compile(r"(?s)(?P<name>.+?)\s*\([^()]*\)\s*")
#: A zone beside the name of a time: "Date Time, GMT+01:00", "Time (UTC-5)".
_ZONE: Final = re.compile(
    r"[\s,(\[]*\b(?:GMT|UTC)\s*(?P<sign>[+-])(?P<h>\d{1,2})(?::?(?P<min>\d{2}))?[\])]?"
)
#: Characters: "unix time" is one as well.
_LONGEST_UNIT: Final = 12


@dataclass(frozen=True, slots=True)
class ColumnName:
    """Name of a column without its unit, and the unit if stated."""

    name: str
    bare: str
    unit: str | None


def column_names(cells: Sequence[str], units: Sequence[str] = ()) -> list[ColumnName]:
    """Distinct names that are not empty, with units from the names or the row of units.

    Args:
        cells: cells of the header.
        units: cells of the row of units; () without one.
    """
    over = [_OVER.fullmatch(cell.strip()) for cell in cells]
    is_over = len(cells) > 1 and all(match and pint_name_of_unit(match["unit"]) for match in over)
    found: list[ColumnName] = []
    taken: dict[str, int] = {}
    for number, cell in enumerate(cells, start=1):
        stated = " ".join(cell.split()) or f"column {number}"
        name, again = stated, taken.get(stated, 0)
        while name in taken:
            again += 1
            name = f"{stated} ({again + 1})"
        taken[stated], taken[name] = again, taken.get(name, 0)
        bare, unit = split_unit(stated)
        if is_over and (match := over[number - 1]):
            bare, unit = match["name"], pint_name_of_unit(match["unit"])
        row_unit = units[number - 1] if number <= len(units) else ""
        found.append(ColumnName(name, bare, pint_name_of_unit(row_unit) or unit))
    return found


def refuse_two_units(cells: Sequence[str], units: Sequence[str], line: int) -> None:
    """Raise an error if a column's name and the row of units state different units.

    Units of other dimensions are not compared: `v_N` in rpm is the speed of N.

    Raises:
        DialectError: a column has two units.
    """
    for cell, stated in zip(cells, units, strict=False):
        name, row = split_unit(" ".join(cell.split()))[1], pint_name_of_unit(stated)
        if name is None or row is None or name == row:
            continue
        with suppress(MachineError):
            gain_and_offset_to_si(name, row)
            raise DialectError(
                f"column '{cell}' is in {name} by its name, in {row} by line {line}: set "
                f"[log] units_row = {line} or, if the name is correct, 0"
            )


def split_unit(name: str) -> tuple[str, str | None]:
    """Name without its unit, and the unit; None if no known unit is stated.

    `Velocity [km/h]`, `torque (Nm)`, `Speed / km/h`, `speed_kmh`, `left_Mz_Nm`.
    """
    name = _ZONE.sub("", name) or name
    if match := _FORM.fullmatch(name):
        return match["name"], None
    if has_multiple_of_unit(name):
        return name, None
    for form in (_BRACKETS, _BEHIND, _MIDDLE):
        match = form.fullmatch(name)
        unit = pint_name_of_unit(match["unit"]) if match and match["name"] else None
        if match and unit:
            rest = match["rest"] if form is _MIDDLE else ""
            return f"{match['name'].strip()} {rest}".strip(), unit
    if (match := _REMARK.fullmatch(name)) and (remarked := _BEHIND.fullmatch(match["name"])):
        unit = pint_name_of_unit(remarked["unit"])
        if unit:
            return remarked["name"].strip(), unit
    return split_unit_from_name(name)


def column_named_by_last_part(column: ColumnName) -> ColumnName:
    """Column named by the last part of its name: payload.ts, /robot/time."""
    return replace(column, bare=re.split(r"[./]", column.bare)[-1])


def column_named_before_dash(column: ColumnName) -> ColumnName:
    """Column named by the part before its channel: Time (s) - Speed (m/s)."""
    bare, unit = split_unit(column.name.partition(" - ")[0])
    return replace(column, bare=bare, unit=unit)


def has_multiple_of_unit(name: str) -> bool:
    """Whether a name states a multiple of a unit: `Time [0.1 ms]`."""
    match = _MULTIPLE.fullmatch(name)
    return match is not None and pint_name_of_unit(match["unit"]) is not None


def zone_offset_s(name: str) -> int | None:
    """Offset of the time zone in a column's name in s; None without one."""
    match = _ZONE.search(name)
    if match is None:
        return None
    offset = int(match["h"]) * 3600 + int(match["min"] or 0) * 60
    return -offset if match["sign"] == "-" else offset


def is_row_of_units(cells: Sequence[str], *, half: bool = False) -> bool:
    """Whether a row contains only units, most of them known (half with `half`)."""
    said = [cell.strip() for cell in cells if cell.strip()]
    known = sum(pint_name_of_unit(cell) is not None for cell in said)
    blank = sum(cell.strip("[]() ") in ("", "-", "–", "1", "bool", "none") for cell in said)
    # a unit that is not known is still short, or in brackets
    short = sum(len(cell) <= _LONGEST_UNIT or cell[0] in "[(" for cell in said)
    enough = 2 * (known + blank) + half > len(said)
    return known > 0 and short == len(said) and enough
