"""Limits by which the dialect and the times of a table are detected."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class TableLimits:
    """Limits by which the dialect and the times of a table are detected.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # axis
    #: Shortest and longest time in s from row to row, 2,500 Hz to 0.5 Hz: a slower log resolves no
    #: start, and a faster one is from an oscilloscope, which states its unit.
    row_steps_s: tuple[float, float] = (0.4e-3, 2.0)
    #: Shortest duration of a log in s: a shorter one holds no start and stop.
    shortest_log_s: float = 1.0
    #: Earliest and latest time of a log, in s since 1970: 2000 to 2100.
    epoch_s: tuple[float, float] = (946_684_800.0, 4_102_444_800.0)
    #: Relative tolerance of the jump of hhmmss.s at each minute.
    minute_jump_tolerance: float = 1e-6

    # cells
    #: Smallest fraction of cells of one kind that makes it the kind of the column.
    kind_min_fraction: float = 0.8

    # dates
    #: First and last year that a clock may show, even if never set; other years are of another
    #: calendar.
    years: tuple[int, int] = (1900, 2200)
    #: Range in ns of the jump back of a 12-hour clock without AM and PM, at noon and midnight.
    twelve_hours_ns: tuple[int, int] = (10 * 3600 * 10**9, 12 * 3600 * 10**9)

    # dialect
    #: Most rows by which the kind of a column is judged.
    judged_rows: int = 400
    #: Fraction of faulty cells (truncated, a stray word) below which a dialect is not held to have
    #: any.
    max_fault_fraction: float = 0.02
    #: Rows by which a short table is judged, instead of its later half.
    short_table_rows: int = 8
    #: Number of rows, from the first row of data, of which most must be data.
    next_rows: int = 9
    #: Rows after one that looks like data in which a row of names shows that it is preamble.
    names_max_rows: int = 2
    #: Smallest fraction of `next_rows` that must be data.
    next_data_fraction: float = 2 / 3

    # header
    #: Most characters of an unknown unit: "unix time" is one as well.
    unit_characters: int = 12

    # only_time
    #: Fewest rows that show whether a column increases.
    rising_min_rows: int = 3
    #: Time in s by which durations by two clocks of a table may differ, as between a clock that
    #: shows whole seconds and one that is late by a row.
    clock_drift_s: float = 2.5
    #: The same as a fraction of the longer duration, which is added.
    clock_drift_fraction: float = 0.1

    # parquet_columns
    #: Most bytes of a file of JSON lines, which is parsed in memory as a whole.
    json_max_bytes: int = 2 << 30
    #: Most elements of a JSON list that becomes columns: four wheels, three axes.
    list_max_elements: int = 4

    # text
    #: Most bytes of a workbook when unpacked.
    workbook_bytes: int = 1 << 30
    #: Bytes of a workbook that are unpacked at once.
    workbook_piece_bytes: int = 1 << 20
    #: Most cells of a sheet, including empty ones: some 30 bytes each while it is read.
    sheet_cells: int = 20_000_000
    #: Bytes that hold the longest reference of a cell, repeated from piece to piece.
    place_bytes: int = 16
    #: Fewest rows of a sheet that counts as a table.
    sheet_min_rows: int = 2
    #: Bytes at the start of a file from which its dialect is detected.
    head_bytes: int = 1 << 19
    #: Most lines from which the dialect is detected.
    head_lines: int = 2_000
    #: Fewest lines from which a dialect is detected: with long lines, more bytes are read.
    head_min_lines: int = 12
    #: Most bytes that are read to get that many lines.
    head_max_bytes: int = 1 << 24
    #: Most bytes of a compressed table when unpacked: a larger one may be a decompression bomb.
    unpacked_bytes: int = 4 << 30
    #: Bytes that are read at once.
    piece_bytes: int = 1 << 20
    #: Fraction of NUL bytes at even or odd positions above which a text is UTF-16 without a byte
    #: order mark.
    utf16_nul_fraction: float = 0.4
    #: First lines of a text in which its column names are expected.
    names_lines: int = 3
    #: Time in ns by which clocks that are set back fall at least: half an hour on Lord Howe Island.
    set_back_ns: int = 20 * 60 * 10**9
    #: Fraction of ASCII bytes above which a text that is not UTF-8 is read as Western (cp1252).
    ascii_min_fraction: float = 0.7

    # times
    #: Most typical steps from the last reading before a counter overflows to the next one: a few
    #: rows may be missing, and a longer pause tells nothing.
    overflow_steps: float = 5.0
    #: The same, at most, as a fraction of the counter's range: two records of a minute at 1 Hz are
    #: no counter of 16 bits.
    overflow_fraction: float = 0.01


#: The values in use.
LIMITS: Final = TableLimits()
