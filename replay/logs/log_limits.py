"""Bounds of the types and lists of a log, and limits of how it is read."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class LogLimits:
    """Bounds of the types and lists of a log, and limits of how it is read.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # converted_log
    #: Digits of an index: lists count in 32 bits.
    index_digits: int = 9

    # growing_logs
    #: Time in s for which a part that cannot be read is tried again before the next one is read:
    #: longer than a recorder takes to close it.
    unreadable_part_s: float = 2.0

    # json_types
    #: Depth of nested objects beyond which a schema is refused,
    json_depth: int = 32
    #: and fields.
    json_fields: int = 20_000

    # log_formats
    #: Logs of a folder that an error names.
    max_logs: int = 8

    # log_tails
    #: Rows from which a head is recognised.
    head_rows: int = 20
    #: Rows that stand before the new ones, so that the spacing of times tells their unit.
    rows_before: int = 50
    #: Bytes that one poll reads at most.
    poll_bytes: int = 16 * 2**20

    # machine_ids
    #: Characters of a machine's number.
    machine_id_characters: int = 64

    # message_definitions
    #: Fields of a definition, far beyond any type that a robot sends; a few lines can ask for many
    #: more.
    definition_fields: int = 20_000
    #: Depth of nested types, likewise,
    definition_depth: int = 64
    #: elements of an array,
    array_elements: int = 2**30
    #: and of an array of messages or strings, for each of which rosbags writes code.
    object_array_elements: int = 2**16

    # message_log
    #: Time in ns by which recorders write messages out of order at most; when they fall back
    #: further, a clock was set.
    clock_jump_ns: int = 1_000_000_000

    # protobuf_types
    #: Fields beyond which a schema is refused.
    protobuf_fields: int = 20_000

    # table_log
    #: Columns that an error names.
    max_columns: int = 20
    #: Cells of a column that are compared with its time.
    compared_cells: int = 400
    #: Rows that may share a time: more that all do have none.
    same_time_rows: int = 2
    #: Fraction of late rows below which a table is sorted by time without a question,
    late_row_fraction: float = 0.01
    #: or fraction of those that are late beyond which they fall back: rows in any order, not one
    #: record behind another.
    falling_row_fraction: float = 0.05
    #: Characters of a cell that a loss quotes.
    quoted_characters: int = 40


#: The values in use.
LIMITS: Final = LogLimits()
