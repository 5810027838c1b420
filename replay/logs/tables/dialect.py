"""Detect the dialect of a text table: separator, decimal sign, rows of names, units and data.

Every combination of separator and decimal sign is tried. A combination is impossible if the rows
then differ in their number of cells, or if cells of digits and signs are not numbers.
"""

import csv
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Final

from replay.logs.tables.cells import (
    are_most_cells_numeric,
    classify_cell_text,
    find_common_unit_of_cells,
    match_decimal_number,
)
from replay.logs.tables.dates import has_time_of_day, is_date_only
from replay.logs.tables.header import (
    ColumnName,
    TextRow,
    find_labelled_header_rows,
    find_name_and_unit_rows,
    make_column_names,
    refuse_contradicting_units,
    strip_comment_and_join_brackets,
)
from replay.logs.tables.hints import DialectError, TableHints
from replay.logs.tables.table_limits import LIMITS

SEPARATORS: Final = (",", ";", "\t", "|")
BLANKS: Final = " "
_NAMED: Final = {",": "a comma", ";": "a semicolon", "\t": "a tab", "|": "|", " ": "blanks"}


@dataclass(frozen=True, slots=True)
class Dialect:
    """How a text represents a table.

    Attributes:
        separator: separator of cells; a blank means any number of blanks.
        decimal: decimal sign.
        columns: columns in order.
        data_line: number of lines before the data.
        rows: first rows of the data.
        has_tail: whether each row ends in a separator with no cell after it.
        is_grouped: whether an ambiguous sign before three digits is a thousands separator.
        cell_units: unit after the numbers of each column, as written; None without one.
        notes: notes on what was detected.
        preamble: lines above the names.
    """

    separator: str
    decimal: str
    columns: tuple[ColumnName, ...]
    data_line: int
    rows: tuple[tuple[str, ...], ...]
    has_tail: bool = False
    is_grouped: bool = False
    cell_units: tuple[str | None, ...] = ()
    notes: tuple[str, ...] = ()
    preamble: tuple[str, ...] = ()

    @property
    def column_names(self) -> list[str]:
        """Names of the columns."""
        return [column.name for column in self.columns]

    @property
    def is_empty(self) -> bool:
        """Whether there are names but no data."""
        return not self.rows


@dataclass(frozen=True, slots=True)
class _DialectTrial:
    separator: str
    decimal: str
    rows: list[TextRow]
    first: int  #: index of the first row of data
    width: int
    faults: float  #: share of rows of another length, and of cells that are no number
    decimals: int  #: cells with the decimal sign
    thousands: int  #: cells that may as well be thousands
    is_grouped: bool = False  #: whether the other sign is known to separate thousands


def sniff_dialect(lines: Sequence[str], hints: TableHints) -> Dialect:
    """Find the only possible dialect of a text.

    Args:
        lines: first lines of the text.
        hints: properties given by the user.

    Raises:
        DialectError: there is none, or there are several.
    """
    # in a damaged file, a single cell may extend over all of it
    csv.field_size_limit(min(sys.maxsize, 2**31 - 1))
    separators = _list_candidate_separators(hints)
    if hints.decimal not in (None, ".", ","):
        raise DialectError(f"no decimal sign '{hints.decimal}'; set [log] decimal to '.' or ','")
    decimals = (hints.decimal,) if hints.decimal else (".", ",")
    found = [
        reading
        for separator in separators
        for reading in _iter_dialect_trials(lines, separator, decimals, hints)
    ]
    if not found and hints.separator is None:
        found = list(_iter_dialect_trials(lines, BLANKS, decimals, hints))
    sound = [reading for reading in found if not reading.faults] or found
    best = [each for each in sound if each.faults <= min(e.faults for e in sound)]
    if not best:
        return _find_dialect_of_header_only_table(lines, separators, hints)
    if len({each.separator for each in best}) > 1:
        said = " or ".join(
            _NAMED.get(each, each) for each in dict.fromkeys(e.separator for e in best)
        )
        raise DialectError(f"its cells may be separated by {said}; set [log] separator")
    reading = _choose_decimal_sign(best, hints)
    return _find_header_rows(reading, lines, hints)


def _list_candidate_separators(hints: TableHints) -> tuple[str, ...]:
    """Separator given in the machine file, else all known ones."""
    if hints.separator is None:
        return SEPARATORS
    words = {"tab": "\t", "\\t": "\t", "comma": ",", "semicolon": ";", "blank": " ", "blanks": " "}
    given = words.get(hints.separator.lower(), hints.separator)
    if len(given.encode()) != 1 or given.isalnum() or given in "\"'.+-\n\r":
        raise DialectError(
            f"'{hints.separator}' cannot be a separator; set [log] separator to one character, "
            "such as ',', ';' or '|', or to 'tab' or 'blanks'"
        )
    return (given,)


def _choose_decimal_sign(best_trials: list[_DialectTrial], hints: TableHints) -> _DialectTrial:
    """Choose among dialects that differ in the decimal sign only."""
    with_sign = [each for each in best_trials if each.decimals]
    # if no cell has a decimal sign, the choice makes no difference
    reading = (with_sign or best_trials)[0]
    clear = [each for each in with_sign if each.thousands < each.decimals]
    if not hints.decimal and (len(with_sign) > 1 or (with_sign and not clear)):
        # if commas separate cells, a point is not a thousands separator
        if reading.separator == "," and reading.decimal == ".":
            return reading
        if len(clear) == 1:
            return clear[0]
        sign = reading.decimal
        raise DialectError(
            f"'{sign}' may be its decimal sign or separate thousands: all its numbers have three "
            f'digits after it; if it is the decimal sign, set [log] decimal = "{sign}"'
        )
    return reading


def iter_nonempty_rows(lines: Sequence[str], separator: str) -> Iterator[TextRow]:
    """Yield the rows that are not empty, with stripped cells."""
    if separator == BLANKS:
        for number, line in enumerate(lines):
            if cells := tuple(line.split()):
                yield TextRow(number, number + 1, cells)
        return
    # with line ends, which belong to a cell that spans lines
    reader = csv.reader((f"{line}\n" for line in lines), delimiter=separator)
    before = 0
    while True:
        try:
            row = next(reader)
        except StopIteration:
            return
        except csv.Error:
            before = reader.line_num
            continue
        cells = tuple(cell.strip() for cell in row)
        if any(cells):
            yield TextRow(before, reader.line_num, cells)
        before = reader.line_num


def _iter_dialect_trials(
    lines: Sequence[str], separator: str, decimal_signs: Sequence[str], hints: TableHints
) -> Iterator[_DialectTrial]:
    if not any(separator in line for line in lines):
        return
    rows = list(iter_nonempty_rows(lines, separator))
    below = max(hints.header_row or 0, hints.units_row or 0)
    data = [row for row in rows if row.line >= below]
    if not data:
        return
    # from the later half, if there is one: preambles are at the beginning
    later = (
        data[-max(len(data) // 2, min(len(data) - 1, LIMITS.short_table_rows)) :][
            : LIMITS.judged_rows
        ]
        or data
    )
    width = Counter(len(row.cells) for row in later).most_common(1)[0][0]
    if width < 2:
        # short rows below a longer header
        width = max(len(row.cells) for row in data)
        if width < 2:
            return
    is_quoted = any('"' in line for line in lines)
    # without quotes, no cell contains the separator
    for decimal in [d for d in decimal_signs if d != separator or is_quoted] or decimal_signs:
        reading = _try_csv_dialect(rows, later, width, (separator, decimal), below)
        if reading is not None:
            yield reading


def _try_csv_dialect(
    rows: list[TextRow], later_rows: list[TextRow], width: int, marks: tuple[str, str], start: int
) -> _DialectTrial | None:
    separator, decimal = marks
    fitting = [row for row in later_rows if len(row.cells) == width] or later_rows
    columns = [[row.cells[k] for row in fitting if k < len(row.cells)] for k in range(width)]
    kinds = [[classify_cell_text(cell, decimal) for cell in column] for column in columns]
    signed = [match_decimal_number(cell, decimal) for column in columns for cell in column]
    # a sign before three digits groups thousands if other cells show that it is not decimal
    grouped = any("grouped" in each for each in kinds) or any(x and not y for x, y in signed)
    known = "grouped" if grouped else "odd"
    kinds = [[known if each == "maybe grouped" else each for each in column] for column in kinds]
    numeric = [k for k, each in enumerate(kinds) if are_most_cells_numeric(each)]
    if not numeric:
        return None
    odd = sum(each.count("odd") for each in kinds)
    ragged = sum(len(row.cells) != width for row in later_rows)
    faults = odd / max(sum(map(len, kinds)), 1) + ragged / len(later_rows)
    if odd * 5 > sum(len(each) for each in kinds):
        return None
    is_data = [
        row.line >= start
        and (len(row.cells) > 1 or row is rows[-1])
        and _is_data_row(row.cells, numeric, width, decimal)
        for row in rows[: LIMITS.judged_rows]
    ]
    first = next(
        (
            k
            for k, yes in enumerate(is_data)
            if yes
            and sum(n := is_data[k : k + LIMITS.next_rows]) >= LIMITS.next_data_fraction * len(n)
            # a row with too few cells may belong to a long preamble
            and not _does_row_of_names_follow(
                rows[
                    k + 1 : k
                    + 1
                    + (LIMITS.names_max_rows if len(rows[k].cells) == width else LIMITS.next_rows)
                ],
                is_data[k + 1 :],
                numeric,
                width,
                decimal,
            )
        ),
        None,
    )
    if first is None:
        return None
    some = rows[first : first + LIMITS.judged_rows]
    cells = [row.cells[k] for row in some for k in numeric if k < len(row.cells)]
    with_sign = [match_decimal_number(cell, decimal) for cell in cells]
    return _DialectTrial(
        separator,
        decimal,
        rows,
        first,
        width,
        0.0 if faults < LIMITS.max_fault_fraction else faults,
        sum(x for x, _ in with_sign),
        sum(y for _, y in with_sign),
        grouped,
    )


def _does_row_of_names_follow(
    rows: Sequence[TextRow],
    are_data_rows: Sequence[bool],
    numeric_columns: Sequence[int],
    width: int,
    decimal_sign: str,
) -> bool:
    """Whether a row of names is among the next rows, so that the row above is preamble."""
    return any(
        len(row.cells) == width
        and all(classify_cell_text(row.cells[k], decimal_sign) == "text" for k in numeric_columns)
        for row, yes in zip(rows, are_data_rows, strict=False)
        if not yes
    )


def _is_data_row(
    cells: Sequence[str], numeric_columns: Sequence[int], width: int, decimal_sign: str
) -> bool:
    """Whether most cells of a row are numbers in the table's numeric columns."""
    if len(cells) > width + 1:
        return False
    kinds = [classify_cell_text(cells[k], decimal_sign) for k in numeric_columns if k < len(cells)]
    return are_most_cells_numeric(["number" if each == "maybe grouped" else each for each in kinds])


def _find_dialect_of_header_only_table(
    lines: Sequence[str], separators: Sequence[str], hints: TableHints
) -> Dialect:
    """Dialect of a header without data; raises an error if it is not a table."""
    for separator in separators:
        rows = list(iter_nonempty_rows(lines, separator))
        if rows and len(rows) <= 2 and all(len(row.cells) > 1 for row in rows):
            reading = _DialectTrial(separator, ".", rows, len(rows), len(rows[0].cells), 0.0, 0, 0)
            return _find_header_rows(reading, lines, hints)
    raise DialectError(
        "no table of numbers was recognised in it; if it holds one, set [log] separator, decimal "
        "or header_row"
    )


def _find_header_rows(trial: _DialectTrial, lines: Sequence[str], hints: TableHints) -> Dialect:
    """Find the rows of names and units above the data."""
    rows, width, separator = trial.rows, trial.width, trial.separator
    above = [
        strip_comment_and_join_brackets(row, separator, width, lines) for row in rows[: trial.first]
    ]
    data = [row.cells for row in rows[trial.first :]]
    is_blank_first = bool(data) and not any(row[0] for row in data)
    labelled = find_labelled_header_rows(above, width, is_blank_first=is_blank_first)
    is_given = hints.header_row is not None or hints.units_row is not None
    named = None if is_given else labelled
    names, units = named or find_name_and_unit_rows(above, width, hints)
    cells = list(names.cells) if names else [""] * width
    # whether each line ends in a separator
    has_tail = not any(len(row) >= width and row[width - 1] for row in data) and bool(data)
    has_tail = has_tail and width > 2 and (len(cells) < width or not cells[-1])
    width -= has_tail
    cells = cells[:width] if has_tail else cells
    while len(cells) > width and not cells[-1]:
        cells.pop()
    if separator == BLANKS and len(cells) == width - 1 and _does_data_start_with_date(data):
        # the header has one name for both date and time
        cells = ["Date", "Time", *cells[1:]]
    if names is not None and len(cells) < width:
        raise DialectError(
            f"its header (line {names.line + 1}) has {len(cells)} cells, but its rows have "
            f"{width}: separated by {_NAMED.get(separator, separator)}; set [log] separator and "
            "decimal, or header_row"
        )
    if units is not None and hints.units_row is None:
        refuse_contradicting_units(cells, units.cells, units.line + 1)
    cell_units = tuple(
        find_common_unit_of_cells(
            [row[k] for row in data[: LIMITS.judged_rows] if k < len(row) and row[k]], trial.decimal
        )
        for k in range(width)
    )
    stated = units.cells if units else tuple(each or "" for each in cell_units)
    dialect = Dialect(
        separator,
        trial.decimal,
        tuple(make_column_names(cells, stated)),
        rows[trial.first].line if trial.first < len(rows) else rows[-1].after,
        tuple(data[: LIMITS.judged_rows]),
        has_tail,
        trial.is_grouped,
        cell_units,
        preamble=tuple(lines[: names.line if names else rows[0].line][:50]),
    )
    return replace(dialect, notes=tuple(_describe_dialect_choices(dialect, names, units)))


def _does_data_start_with_date(data: Sequence[Sequence[str]]) -> bool:
    return bool(data) and is_date_only(data[0][0]) and has_time_of_day(data[0][1])


def _describe_dialect_choices(
    dialect: Dialect, names: TextRow | None, units: TextRow | None
) -> Iterator[str]:
    said: list[str] = []
    if dialect.separator != ",":
        said.append(f"cells separated by {_NAMED.get(dialect.separator, dialect.separator)}")
    if dialect.decimal != ".":
        said.append("a decimal comma")
    if names is None and dialect.rows:
        said.append("no row of names")
    elif names is not None and names.line:
        said.append(f"names in line {names.line + 1}")
    if units is not None:
        said.append(f"units in line {units.line + 1}")
    if said:
        yield f"the table is read with {', '.join(said)}"


def read_first_filled_cells(dialect: Dialect, index: int, count: int = 50) -> list[str]:
    """The first `count` non-empty cells of a column."""
    cells = (row[index] for row in dialect.rows if index < len(row) and row[index])
    return list(islice(cells, count))
