"""Limits of what commands print."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class ScreenLimits:
    """Limits of what commands print.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # compare
    #: Width in characters of a table of differences, even on a narrower screen, since a name must
    #: not be cut.
    compared_width: int = 120
    #: Most rows of a table, to be read at a glance; --json prints all.
    compared_rows: int = 12
    #: Most columns of a stage that are shown: a difference in one column is mostly in related ones
    #: too.
    compared_columns: int = 4

    # explain
    #: Number of stages of a replay, for the bar, stated here since the pipeline is slow to import
    #: and not needed to explain a recording.
    replay_stages: int = 14

    # fleet
    #: Rows of a fleet that are printed unless another number is requested.
    fleet_rows: int = 20

    # progress_bar
    #: Bytes that take as long to replay as the part of a recording that is independent of its size.
    base_bytes: int = 2_000_000
    #: Fewest finished recordings before the time left is estimated.
    forecast_min_recordings: int = 5

    # follow_panel
    #: Number of last manoeuvres that are shown.
    followed_manoeuvres: int = 5
    #: Rate in Hz at which the panel is drawn: faster changes cannot be read.
    drawn_hz: float = 4.0

    # frame_output
    #: Rows of a table on a screen; of a longer one, the first and last rows are shown.
    frame_rows: int = 40
    #: Most characters of a line of a table.
    text_table_characters: int = 10_000

    # print_tables
    #: Width in characters of a table in a pipe, which is not bound to a screen.
    piped_width: int = 160
    #: Most characters to which a column of many rows is widened.
    column_characters: int = 60
    #: Width in characters below which a table has no room for its numbers.
    narrowest_width: int = 80

    # run
    #: Findings, losses and notes that are printed without -v; the others are counted.
    answer_lines: int = 3
    #: Most rows of the table of loads: enough for a campaign, but not for a shift.
    answer_loads: int = 24

    # sweep
    #: Width in characters of a table in a file, whose reader can scroll.
    file_width: int = 400


#: The values in use.
LIMITS: Final = ScreenLimits()
