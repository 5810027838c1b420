"""Limits of what reports list, and sizes of their drawings."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class ReportLimits:
    """Limits of what reports list, and sizes of their drawings.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # clock_text
    #: Ticks of an axis of time that do not touch each other.
    time_max_ticks: int = 6

    # force_acceleration
    #: Reasons that are named beside the accepted; the rest is "other".
    named_reasons: int = 3

    # picture
    #: Dots an inch of a PNG.
    picture_dpi: int = 150

    # planar_text
    #: Fraction of the variance below which a source is not listed.
    small_variance_fraction: float = 0.005

    # shift_text
    #: Smallest detectable load, over the mean one, from which loads may be missing: starts of half
    #: a load are common at the end of a heap.
    missed_load_fraction: float = 0.5

    # svg_shapes
    #: Ticks of an axis, about.
    ticks: int = 5
    #: Width of a character, in units of the drawing.
    character_width: float = 6.2

    # answer_text
    #: Characters of the longest bar.
    bar_characters: int = 24
    #: Fraction of the whole uncertainty from which the cost of driving unlike a campaign is stated.
    unlike_driving_fraction: float = 0.3


#: The values in use.
LIMITS: Final = ReportLimits()
