"""Tables as people have them: encoding → preamble → separator and decimal → names → time → frame.

A reading of a text is taken only where every other one is impossible; what was recognised is a note
of the log, and what is ambiguous is an error that names the key of `[log]` that answers it.
"""

from replay.readers.tables.axis import RowTimes, TableTimes, find_times
from replay.readers.tables.csv_columns import CsvColumns
from replay.readers.tables.dialect import Dialect, DialectError, sniff
from replay.readers.tables.hints import TableHints, TimeAxis
from replay.readers.tables.text import Utf8Text, as_utf8, head_lines
from replay.readers.tables.times import NS_PER_UNIT, TimeError

__all__ = [
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
    "as_utf8",
    "find_times",
    "head_lines",
    "sniff",
]
