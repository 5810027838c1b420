"""Limits of the methods' iterations and corrections."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class MethodLimits:
    """Limits of the methods' iterations and corrections.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # attenuation
    #: Fraction of a correction for attenuation that is uncertain.
    uncertain_correction_fraction: float = 0.5

    # huber
    #: Steps of iterative reweighting: they converge linearly, and more change nothing that matters.
    reweighting_max_steps: int = 100
    #: Steps by Newton's method before it, which mostly needs no more than five.
    newton_steps: int = 12
    #: Relative change of the estimate below which it has converged.
    huber_tolerance: float = 1e-12

    # ls
    #: Condition number beyond which the normal equations keep fewer than about eleven digits.
    poor_condition: float = 50.0

    # tls
    #: Steps to the root: Newton's method needs three or four, and halving a bracket to working
    #: precision fifty.
    root_max_steps: int = 100


#: The values in use.
LIMITS: Final = MethodLimits()
