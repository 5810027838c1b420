"""Limits on message types and lists, and limits of reading logs."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class LogLimits:
    """Limits on message types and lists, and limits of reading logs.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # converted_log
    #: Most digits of a list index: the length of a list fits into 32 bits.
    index_digits: int = 9

    # growing_logs
    #: Time in s for which a part that cannot be read is tried again before the next one is read:
    #: longer than a recorder takes to close it.
    unreadable_part_s: float = 2.0

    # json_types
    #: Depth of nested objects beyond which a schema is refused.
    json_depth: int = 32
    #: Number of fields beyond which a schema is refused.
    json_fields: int = 20_000

    # log_formats
    #: Logs of a folder that an error names, at most.
    max_logs: int = 8

    # log_tails
    #: Rows that suffice to recognise the header of a table.
    head_rows: int = 20
    #: Earlier rows that are read with the new ones, so that the spacing of times shows their unit.
    rows_before: int = 50
    #: Bytes that one poll reads at most.
    poll_bytes: int = 16 * 2**20

    # machine_ids
    #: Characters kept of a machine's serial number.
    machine_id_characters: int = 64

    # message_definitions
    #: Most fields of a definition, far beyond any real type; a few lines can define many more.
    definition_fields: int = 20_000
    #: Depth of nested types beyond which a definition is refused.
    definition_depth: int = 64
    #: Most elements of an array.
    array_elements: int = 2**30
    #: Most elements of an array of messages or strings, for each of which rosbags generates code.
    object_array_elements: int = 2**16

    # message_log
    #: Time in ns by which recorders write messages out of order at most; if log time falls back
    #: further, the clock was set.
    clock_jump_ns: int = 1_000_000_000

    # protobuf_types
    #: Number of fields beyond which a schema is refused.
    protobuf_fields: int = 20_000

    # table_log
    #: Columns that an error names, at most.
    max_columns: int = 20
    #: Cells of another time column that are compared with the detected time.
    compared_cells: int = 400
    #: Most rows of a table that is not refused although all rows have the same time.
    same_time_rows: int = 2
    #: Fraction of late rows below which a table is sorted by time without asking.
    late_row_fraction: float = 0.01
    #: Steps back in time per late row above which a table is sorted likewise: its rows are
    #: shuffled, and not several records one after the other.
    falling_row_fraction: float = 0.05
    #: Characters of a cell that a loss quotes, at most.
    quoted_characters: int = 40


#: The values in use.
LIMITS: Final = LogLimits()
