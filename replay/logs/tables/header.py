"""The names of a table's columns and their units, from the rows above its data."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from analysis.model.physical_units import spelt_unit, unit_behind

_BRACKETS: Final = re.compile(r"(?s)(?P<name>.*?)[\s_]*[\[({<](?P<unit>[^\[\](){}<>]*)[\])}>]\s*")
#: A form of times, not a unit: (hh:mm:ss.sss), [dd/mm/yyyy].
_FORM: Final = re.compile(
    r"(?s)(?P<name>.*?)[\s_]*[\[({<](?=[^\])}>]*(?i:hh|ss|yy))[\shHmMsSfFdDyY:/.,\-]+[\])}>]\s*"
)
#: A quantity over its unit, as DIN 1313 writes it: t/s, v/(km/h).
_OVER: Final = re.compile(r"(?P<name>[^\s/]+)/(?P<unit>\([^()]+\)|[^\s()]+)")
#: "Speed / km/h", "Speed in km/h", "Speed, km/h".
_BEHIND: Final = re.compile(r"(?s)(?P<name>.*?)(?:\s+/\s*|\s+in\s+|,\s*)(?P<unit>\S+)\s*")
#: Characters: "unix time" is one as well.
_LONGEST_UNIT: Final = 12


@dataclass(frozen=True, slots=True)
class ColumnName:
    """A column's name as the table has it, without its unit, and the unit where one is stated."""

    name: str
    bare: str
    unit: str | None


def column_names(cells: Sequence[str], units: Sequence[str] = ()) -> list[ColumnName]:
    """Names that are not empty and none twice, with the units that they or a row state.

    Args:
        cells: of the header.
        units: of the row of units, () where there is none.
    """
    over = [_OVER.fullmatch(cell.strip()) for cell in cells]
    is_over = len(cells) > 1 and all(match and spelt_unit(match["unit"]) for match in over)
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
            bare, unit = match["name"], spelt_unit(match["unit"])
        row_unit = units[number - 1] if number <= len(units) else ""
        found.append(ColumnName(name, bare, spelt_unit(row_unit) or unit))
    return found


def split_unit(name: str) -> tuple[str, str | None]:
    """A name without its unit, and the unit; None where the name states none that is known.

    `Velocity [km/h]`, `torque (Nm)`, `Speed / km/h`, `speed_kmh`, `left_Mz_Nm`.
    """
    if match := _FORM.fullmatch(name):
        return match["name"], None
    for form in (_BRACKETS, _BEHIND):
        match = form.fullmatch(name)
        unit = spelt_unit(match["unit"]) if match and match["name"] else None
        if match and unit:
            return match["name"].strip(), unit
    return unit_behind(name)


def is_units(cells: Sequence[str]) -> bool:
    """Whether a row holds nothing but units."""
    said = [cell.strip() for cell in cells if cell.strip()]
    known = sum(spelt_unit(cell) is not None for cell in said)
    blank = sum(cell.strip("[]() ") in ("", "-", "–", "1", "bool", "none") for cell in said)
    # a unit that is not known is still short, or in brackets
    short = sum(len(cell) <= _LONGEST_UNIT or cell[0] in "[(" for cell in said)
    return known > 0 and short == len(said) and 2 * (known + blank) > len(said)
