"""Limits by which proposals for the machine file are tried and judged."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class ProposalLimits:
    """Limits by which proposals for the machine file are tried and judged.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # judge_proposal
    #: Largest ratio of the uncertainties after and before, for a cause that hardly moves the mass.
    max_u_growth: float = 1.05
    #: Number of standard uncertainties within which a change of mass agrees with the claim, and
    #: beyond which a claimed change is significant.
    coverage_factor: float = 2.0
    #: Ratio of a cause's strength after and before, below which the proposal has removed it.
    remaining_strength: float = 0.5
    #: Relative distance of z's reading at rest from gravity within which the accelerometer's scale
    #: is right.
    gravity_tolerance_1: float = 0.01
    #: Fraction by which the lightest load may be below the empty mass, besides its uncertainty.
    lighter_than_empty_1: float = 0.01
    #: Fewest starts of a log that is halved to test a proposal.
    min_starts: int = 4

    # try_proposals
    #: Most causes that are tried: a log with more cannot be corrected by settings.
    max_proposals: int = 8


#: The values in use.
LIMITS: Final = ProposalLimits()
