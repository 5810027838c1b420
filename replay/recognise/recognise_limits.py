"""Limits by which the columns of a log are recognised."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class RecogniseLimits:
    """Limits by which the columns of a log are recognised.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # columns
    #: Most elements of a list whose elements become columns: four wheels, three axes; a matrix has
    #: nine, a scan hundreds.
    list_max_elements: int = 4
    #: Number of first messages in which lists are examined: in some, they may be empty.
    list_messages: int = 50

    # correlations
    #: Most rows over which correlations are computed.
    correlation_max_rows: int = 200_000
    #: Longest time in ns over which correlations are computed: in half an hour, a loader drives
    #: enough.
    correlation_span_ns: int = 1800 * 10**9
    #: Time in s over which a slope is computed.
    slope_span_s: float = 0.2
    #: Fewest rows of a correlation.
    correlation_min_rows: int = 100
    #: Standard deviation of the difference of two columns, over that of one, below which they have
    #: the same readings, such as the speeds by GPS and by a wheel.
    same_reading_fraction: float = 0.1
    #: Smallest correlation that is evidence.
    clear_correlation: float = 0.5
    #: Correlation that force and acceleration of a machine exceed on any ground, with any driver.
    absent_correlation: float = 0.1
    #: Range of the ratio of a column's derivative to another column in which their units agree.
    unit_ratio_range: tuple[float, float] = (0.6, 1.7)
    #: Smallest correlation with which this ratio is judged, so that noise does not determine it.
    unit_min_correlation: float = 0.9
    #: Range of gravity on an axis of an accelerometer, in m/s²: on slopes of up to 15 degrees, with
    #: the gain errors of a cheap sensor.
    gravity_m_s2: tuple[float, float] = (9.3, 10.2)
    #: The same range in g.
    gravity_g: tuple[float, float] = (0.95, 1.04)
    #: Bits of integers whose sign a reader may have lost.
    wrapped_bits: tuple[int, int] = (16, 32)
    #: Smallest ratio of an unsigned force at braking to that at starts; friction brakes show none.
    unsigned_braking_fraction: float = 0.25
    #: Fraction of its maximum by which noise may take an unsigned force below 0.
    unsigned_noise_fraction: float = 0.05

    # drives
    #: Speed in m/s below which power over speed is dominated by losses of the drive.
    power_min_speed_m_s: float = 0.3

    # joints
    #: Most joints of a message that are read.
    max_joints: int = 64

    # profile
    #: Characters of a sparkline.
    sparkline_characters: int = 16
    #: Values that are read in one pass, 64 MB, which bounds the memory for a table of thousands of
    #: columns.
    values_per_pass: int = 8_000_000
    #: Fewest fields that are read in one pass, which bounds the number of passes over a long table.
    fields_per_pass: int = 16
    #: Largest y component of a twist over the largest x component from which it may be in another
    #: frame: machines that drive along x slide by less, and a heading of 6° on the map gives it.
    twist_across_fraction: float = 0.1

    # words
    #: Letters beyond which a word may be part of a compound: Zugkraft, Motordrehzahl.
    part_word_min_letters: int = 4


#: The values in use.
LIMITS: Final = RecogniseLimits()
