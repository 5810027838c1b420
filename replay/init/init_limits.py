"""Limits of what a first machine file guesses from a log."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class InitLimits:
    """Limits of what a first machine file guesses from a log.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # guess_by_replay
    #: Fraction of its prior to which a log would narrow a term if it determines it.
    narrowed_prior_fraction: float = 0.5

    # guess_machine
    #: Time of a log that is looked at, in ns.
    look_ns: int = 600 * 10**9
    #: Smallest value that is no reading of a machine in any unit.
    max_reading: float = 1e6


#: The values in use.
LIMITS: Final = InitLimits()
