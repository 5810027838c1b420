"""Built-in limits of the calibration line and its uncertainty, which no file can set."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class LineLimits:
    """Built-in limits of the calibration line and its uncertainty, which no file can set.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # calibration_points
    #: Fewest loads that show whether a line is straight: one more than it has parameters.
    min_loads: int = 3

    # distance_regression
    #: Iterations at most.
    distance_max_iterations: int = 100
    #: Steps below this fraction of the parameters' own deviations change nothing that is printed.
    distance_step_std: float = 1e-8

    # line_fit
    #: Probability below which a ratio is taken for a lack of fit.
    lack_of_fit_probability: float = 0.05

    # line_inversion
    #: Smallest probability that is told apart from rarer ones.
    min_tail_probability: float = 1e-9

    # line_model
    #: Rounds of line and variances at most.
    line_max_rounds: int = 20
    #: Change of a slope, as a fraction of its own deviation, below which it has converged.
    line_step_std: float = 1e-4
    #: Standard deviation of rounding, as a fraction of the largest mass: it keeps exact points from
    #: having none.
    rounding_mass_fraction: float = 1e-10
    #: Days from which their scatter needs no Student factor of its own.
    enough_days: int = 5

    # outliers
    #: Probability below which a value is named as an outlier.
    outlier_probability: float = 0.05
    #: Fewest readings of a run that show an outlier.
    outlier_min_readings: int = 3
    #: Probability, over all pairs, below which two runs are named as exchanged: a warning that is
    #: wrong once in a hundred campaigns.
    swap_probability: float = 0.01
    #: Probability above which the size of what two runs differ by is that of their loads: one
    #: exchange in a hundred is missed by it.
    swap_size_probability: float = 0.01

    # point_errors
    #: Spread of estimates, as a fraction of their size, below which it is rounding, not
    #: information.
    min_spread_fraction: float = 1e-9

    # variance_components
    #: Scoring steps at most.
    scoring_max_steps: int = 60
    #: Change of every variance, as a fraction of their sum, below which the iteration ends.
    scoring_tolerance: float = 1e-7
    #: Fraction of a variance that a step leaves at least,
    scoring_min_shrink: float = 0.1
    #: and fraction of the largest at the start that each keeps: without a variance a point has no
    #: weight.
    scoring_floor: float = 1e-6


#: The values in use.
LIMITS: Final = LineLimits()
