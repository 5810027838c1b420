"""Limits of the fit of three axes and of what their motion determines."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class PlanarFitLimits:
    """Limits of the fit of three axes and of what their motion determines.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # base_parameters
    #: Smallest residual of an axis, as a fraction of the forces: axes are weighted by their
    #: residuals, which rounding alone must not decide.
    min_residual_fraction: float = 1e-9
    #: Relative change of every weight below which they have converged,
    weight_tolerance: float = 1e-3
    #: and the rounds after which they are taken as they are.
    weight_max_rounds: int = 30
    #: Degrees of freedom that the residuals of a fit with priors keep at least, over their number.
    min_degrees_of_freedom_fraction: float = 0.1
    #: Largest fraction of a column's sum of squares that is noise: its size is known to a tenth or
    #: so.
    max_noise_fraction: float = 0.9

    # identifiability
    #: Distance of (V_r V_rᵀ)_ii from 1 within which it is 1, where A is exact.
    exact_slack: float = 1e-8
    #: Multiple of its noise above which a direction counts, where A is measured,
    noise_margin: float = 10.0
    #: and what noise turns V_r by, which is not taken for a combination.
    noisy_slack: float = 1e-3
    #: Ratio by which a later parameter must stand out further to be the pivot instead.
    pivot_preference: float = 100.0


#: The values in use.
LIMITS: Final = PlanarFitLimits()
