"""What a person says of a table: the keys of `[log]`, and the question where one is missing."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class TableHints:
    """The dialect of a table, as far as it is given. None: recognised.

    Attributes:
        separator: of the cells: `,` `;` `|`, a tab, or a blank for any number of them.
        decimal: `.` or `,`.
        encoding: of the text, as Python names it: `utf-8`, `utf-16`, `latin-1`.
        header_row: line of the names, from 1; 0 where there are none.
        units_row: line of the units, from 1; 0 where there are none.
        time_fraction: column of the fractions of a second, beside times without.
        sort_times: whether rows are sorted whose time falls back as in a second record.
        day_first: whether 03/04/2026 is the third of April.
        rate_hz: of the rows, where the table has no time.
        sheet: of an Excel file.
    """

    separator: str | None = None
    decimal: str | None = None
    encoding: str | None = None
    header_row: int | None = None
    units_row: int | None = None
    day_first: bool | None = None
    rate_hz: float | None = None
    sheet: str | None = None
    time_fraction: str | None = None
    sort_times: bool | None = None


@dataclass(frozen=True, slots=True)
class TimeAxis:
    """Where a table keeps its time: the column, its unit (s, ms, us, ns), and its dialect.

    A column or a unit that is None is recognised.
    """

    column: str | None
    unit: str | None = "s"
    table: TableHints = TableHints()


class DialectError(Exception):
    """Why the dialect is not known, and the key that says it, in a line."""
