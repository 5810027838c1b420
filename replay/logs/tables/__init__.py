"""Read tables of any layout: encoding → preamble → separator and decimal → names → time → frame.

An interpretation of a text is used only if every other one is impossible. What was detected becomes
a note of the log; an ambiguity is an error that names the key of `[log]` that resolves it.
"""

from typing import TYPE_CHECKING

from estimators.late_names import make_lazy_import_getattr

# every log takes a `TimeAxis`; the readers of tables are imported when a table is opened
from replay.logs.tables.hints import JSON_LINES, DialectError, TableHints, TimeAxis

if TYPE_CHECKING:
    from replay.logs.tables.axis import TableTimes, find_time_columns_and_their_fields
    from replay.logs.tables.csv_columns import CsvColumns
    from replay.logs.tables.dialect import Dialect, sniff_dialect
    from replay.logs.tables.only_time import describe_contradicting_time_column
    from replay.logs.tables.text import Utf8Text, convert_file_to_utf8, read_first_lines
    from replay.logs.tables.times import NS_PER_UNIT, RowTimes, TimeError

__all__ = [
    "JSON_LINES",
    "NS_PER_UNIT",
    "CsvColumns",
    "Dialect",
    "DialectError",
    "RowTimes",
    "TableHints",
    "TableTimes",
    "TimeAxis",
    "TimeError",
    "Utf8Text",
    "convert_file_to_utf8",
    "describe_contradicting_time_column",
    "find_time_columns_and_their_fields",
    "read_first_lines",
    "sniff_dialect",
]

__getattr__ = make_lazy_import_getattr(
    "replay.logs.tables",
    {
        "NS_PER_UNIT": "replay.logs.tables.times",
        "CsvColumns": "replay.logs.tables.csv_columns",
        "Dialect": "replay.logs.tables.dialect",
        "RowTimes": "replay.logs.tables.times",
        "TableTimes": "replay.logs.tables.axis",
        "TimeError": "replay.logs.tables.times",
        "Utf8Text": "replay.logs.tables.text",
        "convert_file_to_utf8": "replay.logs.tables.text",
        "describe_contradicting_time_column": "replay.logs.tables.only_time",
        "find_time_columns_and_their_fields": "replay.logs.tables.axis",
        "read_first_lines": "replay.logs.tables.text",
        "sniff_dialect": "replay.logs.tables.dialect",
    },
)
