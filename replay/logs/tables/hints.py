"""Properties of a table given by the user: the keys of `[log]`."""

from dataclasses import dataclass
from typing import Final

#: Suffixes of files with a JSON object per line.
JSON_LINES: Final = ("jsonl", "ndjson")


@dataclass(frozen=True, slots=True)
class TableHints:
    """Dialect of a table as given by the user; None for properties to be detected.

    Attributes:
        separator: separator of cells: `,` `;` `|`, a tab, or a blank for any number of blanks.
        decimal: `.` or `,`.
        encoding: encoding by its name in Python: `utf-8`, `utf-16`, `latin-1`.
        header_row: line of the names, from 1; 0 for none.
        units_row: line of the units, from 1; 0 for none.
        time_fraction: column of the fractions of a second, if separate.
        sort_times: whether to sort the rows if their time jumps back, as at the start of another
            record; None decides by the rows.
        day_first: whether 03/04/2026 is the third of April.
        rate_hz: rows per second, for a table without a time column.
        sheet: sheet of an Excel file.
        timezone: time zone of dates with a time of day that name none.
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
    timezone: str | None = None


@dataclass(frozen=True, slots=True)
class TimeAxis:
    """Time column of a table, its unit (s, ms, us, ns), and the table's dialect.

    A column or unit of None is detected.
    """

    column: str | None
    unit: str | None = "s"
    table: TableHints = TableHints()


class DialectError(Exception):
    """Raised if the dialect is ambiguous; one line with the reason and the key to set."""
