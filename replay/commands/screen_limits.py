"""Limits of what commands print."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class ScreenLimits:
    """Limits of what commands print.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # compare
    #: Width in characters of a table of differences: on a narrower screen it runs over, since a
    #: name that is cut is no name.
    compared_width: int = 120
    #: Rows of a table that a person reads at a glance; --json gives all.
    compared_rows: int = 12
    #: Columns of a stage that are shown: what differs in one column mostly differs in its
    #: neighbours.
    compared_columns: int = 4

    # explain
    #: Stages of a replay, for a bar: a recording is explained without the pipeline, which is slow
    #: to load.
    replay_stages: int = 14

    # fleet
    #: Rows of a fleet that are printed unless more are asked for.
    fleet_rows: int = 20

    # progress_bar
    #: Bytes that take as long as whatever a recording takes besides its size.
    base_bytes: int = 2_000_000
    #: Recordings that are done before anything is said of the rest.
    forecast_min_recordings: int = 5

    # follow_panel
    #: Manoeuvres that are shown.
    followed_manoeuvres: int = 5
    #: Times a second that the panel is drawn: what changes faster cannot be read.
    drawn_hz: float = 4.0

    # frame_output
    #: Rows of a table on a screen, which shows its ends.
    frame_rows: int = 40
    #: Characters of a line of a table.
    text_table_characters: int = 10_000

    # print_tables
    #: Width in characters of a table that is piped: whoever pipes it has no screen to keep to.
    piped_width: int = 160
    #: Characters that a column of many rows is widened to at most.
    column_characters: int = 60
    #: Width in characters below which a table has no room left for its numbers.
    narrowest_width: int = 80

    # run
    #: Findings, losses and notes that are printed without -v; the others are counted.
    answer_lines: int = 3
    #: Rows of the table of loads: those of a campaign, not those of a shift.
    answer_loads: int = 24

    # sweep
    #: Width in characters of a table in a file: whoever reads it can scroll.
    file_width: int = 400


#: The values in use.
LIMITS: Final = ScreenLimits()
