"""Rows of names and units above the data."""

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from replay.logs.tables.header import is_row_of_units
from replay.logs.tables.hints import DialectError, TableHints

#: A cell of a row that says one thing of each column: "Unit: m/s", "Type: double".
_ATTRIBUTE: Final = re.compile(r"(?P<key>[A-Za-z][A-Za-z ]*):\s*(?P<value>.*)")
_NUMBER: Final = re.compile(r"[+-]?[\d.,]+(?:[eE][+-]?\d+)?")
_OF_UNITS: Final = re.compile(r"(?i)unit|einheit")
_COMMENT: Final = re.compile(r"^\s*(#+|%+|//)\s*")


@dataclass(frozen=True, slots=True)
class TextRow:
    """Cells of a row, and its position."""

    line: int  #: from 0
    after: int  #: the line behind it
    cells: tuple[str, ...]


def strip_comment_and_join_brackets(
    row: TextRow, separator: str, width: int, lines: Sequence[str]
) -> TextRow:
    """Row above the data without comment sign; words in brackets belong to their name."""
    text = _COMMENT.sub("", lines[row.line])
    if separator != " ":
        if text == lines[row.line] or not row.cells:
            return row
        cells = next(csv.reader([text], delimiter=separator), [])
        return TextRow(row.line, row.after, tuple(cell.strip() for cell in cells) or row.cells)
    cells = text.split()
    if len(cells) != width:
        wide = [cell.strip() for cell in re.split(r"\t|\s{2,}", text.strip())]
        if len(wide) == width:
            return TextRow(row.line, row.after, tuple(wide))
        joint = re.sub(r"\s+(?=[\[(])", "\0", text.strip()).split()
        cells = [cell.replace("\0", " ") for cell in joint]
    return TextRow(row.line, row.after, tuple(cells))


def find_name_and_unit_rows(
    above: list[TextRow], width: int, hints: TableHints
) -> tuple[TextRow | None, TextRow | None]:
    """Row of the names and row of the units; None for each that is missing.

    Args:
        above: rows above the data, in order.
        width: number of data columns.
        hints: properties given by the user.

    Raises:
        DialectError: the given line has no cells, or two rows may hold the units.
    """
    by_line = {row.line + 1: row for row in above}
    for key, line in (("header_row", hints.header_row), ("units_row", hints.units_row)):
        if line and line not in by_line:
            raise DialectError(
                f"[log] {key} = {line}: that line is not a row of cells above the data"
            )
    given = by_line.get(hints.header_row or -1)
    stated = by_line.get(hints.units_row or -1)
    if hints.header_row == 0:
        return None, stated
    if given is not None:
        if stated is None and hints.units_row is None:
            nearby = [row for row in above if abs(row.line - given.line) <= 2 and row != given]
            stated = next(
                (
                    r
                    for r in nearby
                    if _has_cell_for_each_column(r, width) and is_row_of_units(r.cells)
                ),
                None,
            )
        return given, stated
    stated, wide = _find_wide_rows(above, width, stated, hints)
    if not wide:
        return None, stated
    if hints.units_row is None and stated is None and len(wide) > 2:
        # below the units may stand a row of types
        (*_, third, second, first) = wide
        together = first.line - third.line <= 2
        if (
            together
            and is_row_of_units(second.cells, half=True)
            and not is_row_of_units(first.cells + third.cells)
        ):
            return third, second
    if stated is not None or len(wide) == 1:
        return wide[-1], stated
    return take_names_and_units(*wide[-2:], has_no_units=hints.units_row == 0)


def take_names_and_units(
    before: TextRow, last: TextRow, *, has_no_units: bool
) -> tuple[TextRow, TextRow | None]:
    """Names, and units if one of the last two rows contains only units.

    Raises:
        DialectError: both contain only units.
    """
    if has_no_units:
        # there are none, and what looks like them holds no names either
        return (before if is_row_of_units(last.cells) else last), None
    if last.line - before.line > 2:
        return last, None
    if is_row_of_units(last.cells) and is_row_of_units(before.cells):
        raise DialectError(
            f"lines {before.line + 1} and {last.line + 1} may both hold the units; set [log] "
            "units_row and header_row"
        )
    if is_row_of_units(last.cells):
        return before, last
    return last, before if is_row_of_units(before.cells) else None


def find_labelled_header_rows(
    above: list[TextRow], width: int, *, is_blank_first: bool
) -> tuple[TextRow, TextRow] | None:
    """Rows of names and units that begin with a label: "SIGNAL", "TIME", "CH1".

    There is no column below the labels: data rows have a blank there, or a cell less. In the latter
    case one label must mention units, unlike the header of a table that lacks cells.
    """
    rows = [
        TextRow(row.line, row.after, ("",) * is_blank_first + row.cells[1:])
        for row in above
        if row.cells[0] and (is_blank_first or len(row.cells) == width + 1)
    ]
    rows = [row for row in rows if width - sum(map(bool, row.cells)) <= 2 * is_blank_first]
    units = [row for row in rows if is_row_of_units(row.cells)]
    names = [row for row in rows if row not in units and not any(map(_NUMBER.fullmatch, row.cells))]
    words = {row.line: row.cells[0] for row in above}
    said = any(_OF_UNITS.search(words[row.line]) for row in units)
    if not names or not units or not (said or is_blank_first):
        return None
    return names[-1], min(units, key=lambda row: abs(row.line - names[-1].line))


def _find_wide_rows(
    above: list[TextRow], width: int, stated: TextRow | None, hints: TableHints
) -> tuple[TextRow | None, list[TextRow]]:
    """Row of units if labelled as such, and candidate rows for names or units."""
    attributes = {row.line: found for row in above if (found := _parse_attribute_row(row))}
    if not any(
        _has_cell_for_each_column(row, width) and row.line not in attributes for row in above
    ):
        # one word before all names is a part of them: "Latest: Time (s)"
        attributes = {}
    if stated is None and hints.units_row is None:
        stated = next((row for key, row in attributes.values() if key in ("unit", "units")), None)
    wide = [
        row
        for row in above
        if _has_cell_for_each_column(row, width) and row != stated and row.line not in attributes
    ]
    return stated, wide


def _parse_attribute_row(row: TextRow) -> tuple[str, TextRow] | None:
    """Attribute that a row states for each column, and its cells; None for other rows."""
    said = [_ATTRIBUTE.fullmatch(cell) for cell in row.cells if cell]
    keys = {match["key"].lower() if match else None for match in said}
    if len(said) < len(row.cells) // 2 or len(keys) != 1 or None in keys or len(row.cells) < 3:
        return None
    cells = tuple(cell.partition(":")[2].strip() for cell in row.cells)
    return str(keys.pop()), TextRow(row.line, row.after, cells)


def _has_cell_for_each_column(row: TextRow, width: int) -> bool:
    """Whether a row has enough cells for the columns, unlike one of a preamble."""
    return len(row.cells) > 1 and len(row.cells) * 2 > width
