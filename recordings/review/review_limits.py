"""Limits of what a review lists, and sizes of its figures."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class ReviewLimits:
    """Limits of what a review lists, and sizes of its figures.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # energy_columns
    #: Most decimal places in kWh: a tenth of a Wh.
    energy_max_digits: int = 4
    #: Fraction of the work that the 95 % uncertainty of a part may have; with more, no part is
    #: listed.
    energy_max_u_share: float = 0.5
    #: Fraction of the work below which a part that cannot be negative shows that parts are wrong.
    energy_min_share: float = -0.05

    # ledger_table
    #: Width in characters of a column of dates in the workbook: a date with its time.
    date_column_characters: int = 19

    # review_page
    #: Shortest recorded time in s for which a rate is stated.
    rate_min_s: float = 300.0
    #: Longest gap in s whose hours have their own rows: days without a log would hide the others.
    gap_by_hour_max_s: float = 86_400.0
    #: Most findings that a page lists: it is no list of all possible faults.
    max_findings: int = 3

    # review_plots
    #: Height of a figure, in units of the drawing.
    figure_height: int = 226
    #: Height of a bar, in units of the drawing.
    bar_height: float = 20.0
    #: Number of bars of a distribution.
    payload_bins: int = 12
    #: Most reasons of the gate that are drawn.
    max_reasons: int = 9
    #: Fewest loads that an axis has room for: with fewer, it would have ticks at fractions.
    scale_min_loads: int = 5

    # review_state
    #: Periods after the previous message beyond which a message is late.
    late_message_periods: float = 1.5

    # reviewer_verdicts
    #: Time in s by which the same dump may differ between replays.
    same_dump_s: float = 5.0

    # shift_facts
    #: Most checks that a headline names; the table has all of them.
    headline_max_checks: int = 3
    #: Number of longest standstills that are named.
    max_stands: int = 3
    #: Duration in s of a gap beyond which it is stated at the top: about one cycle.
    headline_gap_s: float = 120.0

    # shift_ledger
    #: Duration in s of a gap beyond which its cycle has a remark, and does not count in mean times.
    cycle_gap_s: float = 5.0
    #: Largest difference in s between the time by which a dump is named and that of the dump.
    near_dump_s: float = 5.0


#: The values in use.
LIMITS: Final = ReviewLimits()
