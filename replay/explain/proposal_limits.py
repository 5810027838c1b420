"""Limits by which proposals for the machine file are tried and judged."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class ProposalLimits:
    """Limits by which proposals for the machine file are tried and judged.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # judge_proposal
    #: Ratio by which the uncertainty may grow for a cause that hardly moves the mass.
    max_u_growth: float = 1.05
    #: Standard uncertainties within which a mass has moved as claimed, and beyond which a claim is
    #: not 0.
    coverage_factor: float = 2.0
    #: Strength of a cause, over that before, below which a proposal leaves only a remainder.
    remaining_strength: float = 0.5
    #: Relative distance of z's reading at rest from gravity within which the accelerometer's scale
    #: is right.
    gravity_tolerance_1: float = 0.01
    #: Fraction by which a machine may weigh less than it does empty, besides its uncertainty.
    lighter_than_empty_1: float = 0.01
    #: Fewest starts of a log with two halves to try a proposal on.
    min_starts: int = 4

    # try_proposals
    #: Causes that are tried at most: with more there is no log to mend.
    max_proposals: int = 8


#: The values in use.
LIMITS: Final = ProposalLimits()
