"""Limits of what reports list, and sizes of their drawings."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class ReportLimits:
    """Limits of what reports list, and sizes of their drawings.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # clock_text
    #: Most ticks of a time axis whose labels do not touch.
    time_max_ticks: int = 6

    # force_acceleration
    #: Reasons that are named besides "accepted"; the others are "other".
    named_reasons: int = 3

    # picture
    #: Dots per inch of a PNG.
    picture_dpi: int = 150

    # planar_text
    #: Fraction of the variance below which a source is not listed.
    small_variance_fraction: float = 0.005

    # shift_text
    #: Ratio of the smallest detectable to the mean load above which loads may be missing: half
    #: loads are common at the end of a heap.
    missed_load_fraction: float = 0.5

    # svg_shapes
    #: Approximate number of ticks of an axis.
    ticks: int = 5
    #: Width of a character, in units of the drawing.
    character_width: float = 6.2

    # answer_text
    #: Characters of the longest bar.
    bar_characters: int = 24
    #: Fraction of the calibrated mass's uncertainty above which the part due to driving unlike the
    #: campaign is stated.
    unlike_driving_fraction: float = 0.3


#: The values in use.
LIMITS: Final = ReportLimits()
