"""Limits of the residuals' autocorrelation, and of its correction for what a fit removes."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class NumericsLimits:
    """Limits of the residuals' autocorrelation, and of its correction for what a fit removes.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # autocorrelation
    #: Residuals that show their correlation to two percent of a deviation; of more a part is taken.
    correlated_residuals: int = 131_072
    #: Lags that are looked at at most: a manoeuvre may be a whole shift.
    max_lags: int = 256
    #: Rounds of putting back what the fits took out; each adds what the one before still missed.
    loss_rounds: int = 10
    #: Degrees of freedom that fewer count as: a factor beyond 1.6 stands for "hardly known".
    min_degrees_of_freedom: float = 3.0

    # fit_loss
    #: Fits, evenly chosen, that stand for all.
    sampled_fits: int = 100


#: The values in use.
LIMITS: Final = NumericsLimits()
