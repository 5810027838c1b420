"""Limits by which the form and the times of a table are recognised."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class TableLimits:
    """Limits by which the form and the times of a table are recognised.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # axis
    #: Time in s from row to row of a machine's log, from 2,500 a second to one in two seconds:
    #: slower shows no start, and faster is a scope's, which states its unit.
    row_steps_s: tuple[float, float] = (0.4e-3, 2.0)
    #: Shortest duration of a log in s: a shorter one holds no start and stop.
    shortest_log_s: float = 1.0
    #: Seconds since 1970 of a log: from 2000 to 2100.
    epoch_s: tuple[float, float] = (946_684_800.0, 4_102_444_800.0)
    #: Tolerance of the jump of hhmmss.s at each minute, over it.
    minute_jump_tolerance: float = 1e-6

    # cells
    #: Fraction of a column's cells whose kind is the column's.
    kind_min_fraction: float = 0.8

    # dates
    #: Years that a clock may show, one that was never set included; beyond, another calendar
    #: counts.
    years: tuple[int, int] = (1900, 2200)
    #: Jump in ns back over midnight by the clock of twelve hours.
    twelve_hours_ns: tuple[int, int] = (10 * 3600 * 10**9, 12 * 3600 * 10**9)

    # dialect
    #: Rows that a column's kind is judged by.
    judged_rows: int = 400
    #: Fraction of faults below which a reading has none: a torn cell, a stray word.
    max_fault_fraction: float = 0.02
    #: Rows that a short table is judged by.
    short_table_rows: int = 8
    #: Rows after a row of data of which most are data where the data begin,
    next_rows: int = 9
    #: and rows of a preamble above the names that may look like data.
    names_max_rows: int = 2
    #: Fraction of the next rows that are data.
    next_data_fraction: float = 2 / 3

    # header
    #: Characters of a unit: "unix time" is one as well.
    unit_characters: int = 12

    # only_time
    #: Fewest rows that show whether a column rises.
    rising_min_rows: int = 3
    #: Time in s that two clocks of one table may drift apart: what a clock to the second and one
    #: that is late by a row show;
    clock_drift_s: float = 2.5
    #: and as a fraction of what they count, which is added.
    clock_drift_fraction: float = 0.1

    # parquet_columns
    #: Bytes of a file of JSON lines, which is parsed in memory as a whole.
    json_max_bytes: int = 2 << 30
    #: Elements of a list in JSON whose elements are columns, at most: four wheels, three axes.
    list_max_elements: int = 4

    # text
    #: Bytes of a workbook when unpacked, at most,
    workbook_bytes: int = 1 << 30
    #: and bytes that are unpacked at once.
    workbook_piece_bytes: int = 1 << 20
    #: Cells of a sheet, empty ones too: some 30 bytes each while it is read.
    sheet_cells: int = 20_000_000
    #: Bytes in which the longest reference of a cell fits.
    place_bytes: int = 16
    #: Fewest rows of a sheet that is a table.
    sheet_min_rows: int = 2
    #: Bytes of a file that are searched for its dialect, and more for lines that are longer;
    head_bytes: int = 1 << 19
    #: lines of it at most.
    head_lines: int = 2_000
    #: Lines that show a dialect, where a line is long,
    head_min_lines: int = 12
    #: and bytes at most for them.
    head_max_bytes: int = 1 << 24
    #: Bytes of a packed table when unpacked, at most: what is larger may be a bomb.
    unpacked_bytes: int = 4 << 30
    #: Bytes that are read at once.
    piece_bytes: int = 1 << 20
    #: Fraction of NUL bytes at even or at odd places of UTF-16 without a mark, of Western text.
    utf16_nul_fraction: float = 0.4
    #: First lines of a text, where its names are.
    names_lines: int = 3
    #: Fraction of a text in Latin letters that is ASCII; what has less is no text.
    ascii_min_fraction: float = 0.7


#: The values in use.
LIMITS: Final = TableLimits()
