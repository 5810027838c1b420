"""Bounds of the expressions of a machine file."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class ExpressionLimits:
    """Bounds of the expressions of a machine file.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # parse
    #: Characters of an expression, a line of a machine file,
    expression_characters: int = 500
    #: and depth of its brackets.
    bracket_depth: int = 30

    # values
    #: Fraction of a quantile below which a divisor is near zero: the quotient would be its noise.
    near_zero_fraction: float = 0.01
    #: The quantile, in percent.
    divisor_percentile: float = 99.0


#: The values in use.
LIMITS: Final = ExpressionLimits()
