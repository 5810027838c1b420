"""Limits of what a review lists, and sizes of its figures."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class ReviewLimits:
    """Limits of what a review lists, and sizes of its figures.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # energy_columns
    #: Most digits behind the point in kWh: a tenth of a Wh.
    energy_max_digits: int = 4
    #: Parts of the work are listed unless one is less sure than this share of it, with 95 %,
    energy_max_u_share: float = 0.5
    #: or one that cannot be negative is less than this.
    energy_min_share: float = -0.05

    # ledger_table
    #: Width of a column of dates in the workbook, in characters: a date with its time.
    date_column_characters: int = 19

    # review_page
    #: Shortest recorded time in s of which a rate is stated.
    rate_min_s: float = 300.0
    #: Longest gap in s whose hours have rows of their own: days without a log would bury the rest.
    gap_by_hour_max_s: float = 86_400.0
    #: Findings that a page lists: it is no list of all that may be wrong.
    max_findings: int = 3

    # review_plots
    #: Height of a figure, in units of the drawing,
    figure_height: int = 226
    #: and of a bar.
    bar_height: float = 20.0
    #: Bars of a distribution.
    payload_bins: int = 12
    #: Reasons of the gate that are drawn.
    max_reasons: int = 9
    #: Loads that a scale has room for at least: one of fewer would have fractions of them.
    scale_min_loads: int = 5

    # review_state
    #: Periods after which a message is late.
    late_message_periods: float = 1.5

    # reviewer_verdicts
    #: Time in s by which another replay may find the same dump later.
    same_dump_s: float = 5.0

    # shift_facts
    #: Checks that a headline names: it is no list of all that may be wrong; the table has all.
    headline_max_checks: int = 3
    #: Longest stands that are named.
    max_stands: int = 3
    #: Length in s of a hole that is stated at the top: about one cycle.
    headline_gap_s: float = 120.0

    # shift_ledger
    #: Length in s of a hole from which a cycle with it says so, and is left out of the mean times.
    cycle_gap_s: float = 5.0
    #: Time in s before or after the one that is asked for, within which a dump is meant.
    near_dump_s: float = 5.0


#: The values in use.
LIMITS: Final = ReviewLimits()
