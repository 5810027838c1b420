"""Limits by which the columns of a log are recognised."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class RecogniseLimits:
    """Limits by which the columns of a log are recognised.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # columns
    #: Elements of a list whose elements are columns, at most: four wheels, three axes; a matrix has
    #: nine, a scan hundreds.
    list_max_elements: int = 4
    #: Messages whose lists are looked at: the first ones may be empty.
    list_messages: int = 50

    # correlations
    #: Rows that correlations are taken over at most,
    correlation_max_rows: int = 200_000
    #: and time in ns: of half an hour a loader drives enough,
    correlation_span_ns: int = 1800 * 10**9
    #: and time in s over which a slope is taken.
    slope_span_s: float = 0.2
    #: Fewest rows of a correlation.
    correlation_min_rows: int = 100
    #: Difference of two columns, over what they vary by, below which they read the same: a GPS and
    #: a wheel.
    same_reading_fraction: float = 0.1
    #: Correlation that says something.
    clear_correlation: float = 0.5
    #: Correlation that a force and a speed of one machine exceed, whatever the ground and the
    #: driver do.
    absent_correlation: float = 0.1
    #: Change of one column over the readings of another between which their units hold,
    unit_ratio_range: tuple[float, float] = (0.6, 1.7)
    #: if they correlate by so much: those of a position change with the speed, not with noise.
    unit_min_correlation: float = 0.9
    #: Gravity on an axis of an accelerometer, in m/s²: what it shows on a machine that may stand on
    #: a slope of 15 degrees, with the gain errors of a cheap one,
    gravity_m_s2: tuple[float, float] = (9.3, 10.2)
    #: and where the unit is g.
    gravity_g: tuple[float, float] = (0.95, 1.04)
    #: Bits of integers whose sign is lost.
    wrapped_bits: tuple[int, int] = (16, 32)
    #: Size of a force without a sign where the machine brakes, over that at starts, at least; what
    #: brakes by friction shows none there.
    unsigned_braking_fraction: float = 0.25
    #: Fraction of its largest by which noise takes a force without a sign below 0.
    unsigned_noise_fraction: float = 0.05

    # drives
    #: Speed in m/s below which power over speed is the losses of a drive that hardly moves.
    power_min_speed_m_s: float = 0.3

    # joints
    #: Joints of a message that are looked at.
    max_joints: int = 64

    # profile
    #: Characters of a course, and the bars it is drawn with.
    sparkline_characters: int = 16
    #: Values that are read in one pass, 64 MB of them: bounds the memory of a table of thousands of
    #: columns;
    values_per_pass: int = 8_000_000
    #: and fields at least, which bounds the passes of a long one.
    fields_per_pass: int = 16

    # words
    #: Letters beyond which a word may be a part of a compound: Zugkraft, Motordrehzahl.
    part_word_min_letters: int = 4


#: The values in use.
LIMITS: Final = RecogniseLimits()
