"""Find the rows of names and units above a table's data, and parse the names and units."""

import csv
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

from analysis.model.physical_units import (
    find_gain_and_offset_to_si,
    find_pint_unit_name,
    split_unit_from_name,
)
from estimators.errors import MachineError
from replay.logs.tables.hints import DialectError, TableHints
from replay.logs.tables.table_limits import LIMITS

_BRACKETS: Final = re.compile(r"(?s)(?P<name>.*?)[\s_]*[\[({<](?P<unit>[^\[\](){}<>]*)[\])}>]\s*")
#: A time format, which is not a unit: (hh:mm:ss.sss), [dd/mm/yyyy].
_FORM: Final = re.compile(
    r"(?s)(?P<name>.*?)[\s_]*[\[({<](?=[^\])}>]*(?i:hh|ss|yy))[\shHmMsSfFdDyY:/.,\-]+(?:UTC|GMT)?"
    r"[\])}>]\s*"
)
#: A quantity divided by its unit, as in DIN 1313: t/s, v/(km/h).
_OVER: Final = re.compile(r"(?P<name>[^/]+)/(?P<unit>\([^()]+\)|[^\s()]+)")
#: "Speed / km/h", "Speed in km/h", "Speed, km/h".
_BEHIND: Final = re.compile(r"(?s)(?P<name>.*?)(?:\s+/\s*|\s+in\s+|,\s*)(?P<unit>\S+)\s*")
#: A multiple of a unit, which no unit of this package can state: "[0.1 ms]", "(x10 N)", "/100 ms".
_MULTIPLE: Final = re.compile(
    r"(?s).*[\[(/{<\s][x×*]?\s*\d[\d.,]*\s*[x×*]?\s*(?P<unit>[^\d\s\[\](){}<>]+)[\])}>]*\s*"
)
#: Words after the unit: "Time (s) Run #1", "Speed, km/h (LGR S/N: 209)".
_MIDDLE: Final = re.compile(
    r"(?s)(?P<name>[^\[\](){}]+?)\s*[\[(](?P<unit>[^\[\](){}]*)[\])]\s*(?P<rest>\S.*)"
)
_REMARK: Final = re.compile(r"(?s)(?P<name>.+?)\s*\([^()]*\)\s*")
#: A time zone after the name of a time column: "Date Time, GMT+01:00", "Time (UTC-5)".
_ZONE: Final = re.compile(
    r"[\s,(\[]*\b(?:GMT|UTC)\s*(?P<sign>[+-])(?P<h>\d{1,2})(?::?(?P<min>\d{2}))?[\])]?"
)
#: An element of a list: "accel_g[0]".
_ELEMENT: Final = re.compile(r"(?P<list>.+)\[\d+\]")
#: A cell of a row that states an attribute of each column: "Unit: m/s", "Type: double".
_ATTRIBUTE: Final = re.compile(r"(?P<key>[A-Za-z][A-Za-z ]*):\s*(?P<value>.*)")
_NUMBER: Final = re.compile(r"[+-]?[\d.,]+(?:[eE][+-]?\d+)?")
_OF_UNITS: Final = re.compile(r"(?i)unit|einheit")
_COMMENT: Final = re.compile(r"^\s*(#+|%+|//)\s*")


@dataclass(frozen=True, slots=True)
class ColumnName:
    """Name of a column without its unit, and the unit if stated."""

    name: str
    bare: str
    unit: str | None


def make_column_names(cells: Sequence[str], unit_cells: Sequence[str] = ()) -> list[ColumnName]:
    """Make distinct, non-empty column names, with units from the header or the row of units.

    Args:
        cells: cells of the header.
        unit_cells: cells of the row of units; () without one.
    """
    over = [_OVER.fullmatch(cell.strip()) for cell in cells]
    is_over = len(cells) > 1 and all(match and find_pint_unit_name(match["unit"]) for match in over)
    found: list[ColumnName] = []
    taken: dict[str, int] = {}
    for number, cell in enumerate(cells, start=1):
        stated = " ".join(cell.split()) or f"column {number}"
        name, again = stated, taken.get(stated, 0)
        while name in taken:
            again += 1
            name = f"{stated} ({again + 1})"
        taken[stated], taken[name] = again, taken.get(name, 0)
        bare, unit = split_unit_from_column_name(stated)
        if is_over and (match := over[number - 1]):
            bare, unit = match["name"], find_pint_unit_name(match["unit"])
        row_unit = unit_cells[number - 1] if number <= len(unit_cells) else ""
        found.append(ColumnName(name, bare, find_pint_unit_name(row_unit) or unit))
    return found


def refuse_contradicting_units(cells: Sequence[str], unit_cells: Sequence[str], line: int) -> None:
    """Raise an error if a column's name and the row of units state different units.

    Units of other dimensions are not compared: `v_N` in rpm is the speed of N.

    Raises:
        DialectError: a column has two units.
    """
    for cell, stated in zip(cells, unit_cells, strict=False):
        name, row = (
            split_unit_from_column_name(" ".join(cell.split()))[1],
            find_pint_unit_name(stated),
        )
        if name is None or row is None or name == row:
            continue
        with suppress(MachineError):
            find_gain_and_offset_to_si(name, row)
            raise DialectError(
                f"column '{cell}' is in {name} according to its name, in {row} according to line "
                f"{line}: set [log] units_row = {line} or, if the name is correct, 0"
            )


class NameAndUnit(NamedTuple):
    """Name of a column without its unit, and the unit."""

    name: str
    unit: str | None


def split_unit_from_column_name(name: str) -> NameAndUnit:
    """Split a column's name into the name without its unit, and the unit; None without a known one.

    Examples: `Velocity [km/h]`, `torque (Nm)`, `Speed / km/h`, `speed_kmh`, `accel_g[0]`.
    """
    name = _ZONE.sub("", name) or name
    if match := _FORM.fullmatch(name):
        return NameAndUnit(match["name"], None)
    if does_name_state_multiple_of_unit(name):
        return NameAndUnit(name, None)
    for form in (_BRACKETS, _BEHIND, _MIDDLE):
        match = form.fullmatch(name)
        unit = find_pint_unit_name(match["unit"]) if match and match["name"] else None
        if match and unit:
            rest = match["rest"] if form is _MIDDLE else ""
            return NameAndUnit(f"{match['name'].strip()} {rest}".strip(), unit)
    if (match := _REMARK.fullmatch(name)) and (remarked := _BEHIND.fullmatch(match["name"])):
        unit = find_pint_unit_name(remarked["unit"])
        if unit:
            return NameAndUnit(remarked["name"].strip(), unit)
    # the unit of a list element is in the name of its list
    if (match := _ELEMENT.fullmatch(name)) and (unit := split_unit_from_name(match["list"])[1]):
        return NameAndUnit(name, unit)
    return NameAndUnit(*split_unit_from_name(name))


def reduce_to_lower_case_letters(text: str) -> str:
    """Reduce a text to its letters, in lower case."""
    return "".join(each for each in text.lower() if each.isalpha())


def keep_last_part_of_column_name(column_name: ColumnName) -> ColumnName:
    """Shorten a column's name to its last part: `ts` for `payload.ts`."""
    return replace(column_name, bare=re.split(r"[./]", column_name.bare)[-1])


def keep_column_name_before_dash(column_name: ColumnName) -> ColumnName:
    """Shorten a name to the part before ' - ': `Time (s)` for `Time (s) - Speed (m/s)`."""
    bare, unit = split_unit_from_column_name(column_name.name.partition(" - ")[0])
    return replace(column_name, bare=bare, unit=unit)


def does_name_state_multiple_of_unit(column_name: str) -> bool:
    """Whether a name states a multiple of a unit: `Time [0.1 ms]`."""
    match = _MULTIPLE.fullmatch(column_name)
    return match is not None and find_pint_unit_name(match["unit"]) is not None


def find_zone_offset_s(name: str) -> int | None:
    """Offset of the time zone in a column's name in s; None without one."""
    match = _ZONE.search(name)
    if match is None:
        return None
    offset = int(match["h"]) * 3600 + int(match["min"] or 0) * 60
    return -offset if match["sign"] == "-" else offset


def is_row_of_units(cells: Sequence[str], *, is_half_enough: bool = False) -> bool:
    """Whether a row contains only units, most of them known (half with `is_half_enough`)."""
    said = [cell.strip() for cell in cells if cell.strip()]
    known = sum(find_pint_unit_name(cell) is not None for cell in said)
    blank = sum(cell.strip("[]() ") in ("", "-", "–", "1", "bool", "none") for cell in said)
    # an unknown unit is short as well, or in brackets
    short = sum(len(cell) <= LIMITS.unit_characters or cell[0] in "[(" for cell in said)
    enough = 2 * (known + blank) + is_half_enough > len(said)
    return known > 0 and short == len(said) and enough


@dataclass(frozen=True, slots=True)
class TextRow:
    """Cells of a row, and its lines in the text."""

    line: int  #: from 0
    after: int  #: the line behind it
    cells: tuple[str, ...]


def strip_comment_and_join_brackets(
    row: TextRow, separator: str, column_count: int, lines: Sequence[str]
) -> TextRow:
    """Strip the comment sign of a row above the data, and rejoin names split within brackets."""
    text = _COMMENT.sub("", lines[row.line])
    if separator != " ":
        if text == lines[row.line] or not row.cells:
            return row
        cells = next(csv.reader([text], delimiter=separator), [])
        return TextRow(row.line, row.after, tuple(cell.strip() for cell in cells) or row.cells)
    cells = text.split()
    if len(cells) != column_count:
        wide = [cell.strip() for cell in re.split(r"\t|\s{2,}", text.strip())]
        if len(wide) == column_count:
            return TextRow(row.line, row.after, tuple(wide))
        joint = re.sub(r"\s+(?=[\[(])", "\0", text.strip()).split()
        cells = [cell.replace("\0", " ") for cell in joint]
    return TextRow(row.line, row.after, tuple(cells))


class HeaderRows(NamedTuple):
    """Rows of names and units above the data; None for each that is missing."""

    names: TextRow | None
    units: TextRow | None


def find_name_and_unit_rows(
    rows_above: list[TextRow], column_count: int, hints: TableHints
) -> HeaderRows:
    """Find the rows of names and of units above the data; None for each that is missing.

    Args:
        rows_above: rows above the data, in order.
        column_count: number of data columns.
        hints: properties given by the user.

    Raises:
        DialectError: the given line has no cells, or two rows may be the row of units.
    """
    by_line = {row.line + 1: row for row in rows_above}
    for key, line in (("header_row", hints.header_row), ("units_row", hints.units_row)):
        if line and line not in by_line:
            raise DialectError(
                f"[log] {key} = {line}: line {line} must be above the data and have cells; correct "
                "the number"
            )
    given = by_line.get(hints.header_row or -1)
    stated = by_line.get(hints.units_row or -1)
    if hints.header_row == 0:
        return HeaderRows(None, stated)
    if given is not None:
        if stated is None and hints.units_row is None:
            nearby = [row for row in rows_above if abs(row.line - given.line) <= 2 and row != given]
            stated = next(
                (
                    r
                    for r in nearby
                    if _has_cell_for_each_column(r, column_count) and is_row_of_units(r.cells)
                ),
                None,
            )
        return HeaderRows(given, stated)
    stated, wide = _find_rows_as_wide_as_table(rows_above, column_count, stated, hints)
    if not wide:
        return HeaderRows(None, stated)
    if hints.units_row is None and stated is None and len(wide) > 2:
        # a row of types may follow the row of units
        (*_, third, second, first) = wide
        together = first.line - third.line <= 2
        if (
            together
            and is_row_of_units(second.cells, is_half_enough=True)
            and not is_row_of_units(first.cells + third.cells)
        ):
            return HeaderRows(third, second)
    if stated is not None or len(wide) == 1:
        return HeaderRows(wide[-1], stated)
    return select_name_and_unit_rows(*wide[-2:], has_no_units=hints.units_row == 0)


def select_name_and_unit_rows(
    row_before: TextRow, last_row: TextRow, *, has_no_units: bool
) -> HeaderRows:
    """Tell which of the last two rows has the names, and which, if any, the units.

    Raises:
        DialectError: both contain only units.
    """
    if has_no_units:
        # there is no row of units, and a row that looks like one has no names either
        return HeaderRows((row_before if is_row_of_units(last_row.cells) else last_row), None)
    if last_row.line - row_before.line > 2:
        return HeaderRows(last_row, None)
    if is_row_of_units(last_row.cells) and is_row_of_units(row_before.cells):
        raise DialectError(
            f"lines {row_before.line + 1} and {last_row.line + 1} may both hold the units; set "
            "[log] units_row and header_row"
        )
    if is_row_of_units(last_row.cells):
        return HeaderRows(row_before, last_row)
    return HeaderRows(last_row, row_before if is_row_of_units(row_before.cells) else None)


def find_labelled_header_rows(
    rows_above: list[TextRow], column_count: int, *, is_blank_first: bool
) -> HeaderRows | None:
    """Find rows of names and units that begin with a label: "SIGNAL", "TIME", "CH1".

    There is no column below the labels: data rows begin with an empty cell, or have one cell less.
    In the latter case, a label must mention units, to exclude tables whose data lack a column.
    """
    rows = [
        TextRow(row.line, row.after, ("",) * is_blank_first + row.cells[1:])
        for row in rows_above
        if row.cells[0] and (is_blank_first or len(row.cells) == column_count + 1)
    ]
    rows = [row for row in rows if column_count - sum(map(bool, row.cells)) <= 2 * is_blank_first]
    units = [row for row in rows if is_row_of_units(row.cells)]
    names = [row for row in rows if row not in units and not any(map(_NUMBER.fullmatch, row.cells))]
    words = {row.line: row.cells[0] for row in rows_above}
    said = any(_OF_UNITS.search(words[row.line]) for row in units)
    if not names or not units or not (said or is_blank_first):
        return None
    return HeaderRows(names[-1], min(units, key=lambda row: abs(row.line - names[-1].line)))


def _find_rows_as_wide_as_table(
    rows_above: list[TextRow], column_count: int, stated_rows: TextRow | None, hints: TableHints
) -> tuple[TextRow | None, list[TextRow]]:
    """Find a labelled row of units (else `stated_rows`), and candidates for names or units."""
    attributes = {
        row.line: found for row in rows_above if (found := parse_row_of_column_attribute(row))
    }
    if not any(
        _has_cell_for_each_column(row, column_count) and row.line not in attributes
        for row in rows_above
    ):
        # a word before all names is part of the names: "Latest: Time (s)"
        attributes = {}
    if stated_rows is None and hints.units_row is None:
        stated_rows = next(
            (row for key, row in attributes.values() if key in ("unit", "units")), None
        )
    wide = [
        row
        for row in rows_above
        if _has_cell_for_each_column(row, column_count)
        and row != stated_rows
        and row.line not in attributes
    ]
    return stated_rows, wide


class ColumnAttribute(NamedTuple):
    """Attribute that a row states for each column, and its cells."""

    attribute: str
    cells: TextRow


def parse_row_of_column_attribute(row: TextRow) -> ColumnAttribute | None:
    """Parse a row that states an attribute of each column, "Unit: m/s"; None for other rows."""
    said = [_ATTRIBUTE.fullmatch(cell) for cell in row.cells if cell]
    keys = {match["key"].lower() if match else None for match in said}
    if len(said) < len(row.cells) // 2 or len(keys) != 1 or None in keys or len(row.cells) < 3:
        return None
    cells = tuple(cell.partition(":")[2].strip() for cell in row.cells)
    return ColumnAttribute(str(keys.pop()), TextRow(row.line, row.after, cells))


def _has_cell_for_each_column(row: TextRow, width: int) -> bool:
    """Whether a row has cells for more than half of the columns, unlike one of a preamble."""
    return len(row.cells) > 1 and len(row.cells) * 2 > width
