"""Limits of what an explanation lists; no machine file sets them."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class ExplainLimits:
    """Limits of what an explanation lists; no machine file sets them.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # determined_parameters
    #: Correlation of the estimates of two parameters beyond which they trade off.
    trade_off_correlation: float = 0.95
    #: Standard deviation of the noise of a sign, and of a constant that drifts, as a fraction of 1.
    constant_noise_std_1: float = 0.01
    #: Fewest rows that show what a log determines.
    determined_min_rows: int = 20

    # explanation
    #: Time in s before and after a moment for which the gate is told.
    around_s: float = 15.0

    # worst_manoeuvres
    #: Shortest stretch of a reason that is listed, in s: shorter ones belong to their neighbours.
    stretch_min_s: float = 0.05
    #: Stretches that are listed at most,
    max_stretches: int = 24
    #: and manoeuvres.
    max_manoeuvres: int = 5
    #: Fraction of the log from which a stretch says nothing of a part of it.
    whole_log_fraction: float = 0.9


#: The values in use.
LIMITS: Final = ExplainLimits()
