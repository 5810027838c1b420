"""Limits of guessing a first machine file from a log."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class InitLimits:
    """Limits of guessing a first machine file from a log.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # guess_by_replay
    #: Ratio of posterior to prior standard deviation below which a log determines a term.
    narrowed_prior_fraction: float = 0.5

    # guess_machine
    #: Duration of the part of a log that is read, in ns.
    look_ns: int = 600 * 10**9
    #: Magnitude from which a value is implausible for a machine in any unit.
    max_reading: float = 1e6


#: The values in use.
LIMITS: Final = InitLimits()
