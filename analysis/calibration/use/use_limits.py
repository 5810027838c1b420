"""Built-in limits of what a calibration says of later logs, which no file can set."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class CalibrationUseLimits:
    """Built-in limits of what a calibration says of later logs, which no file can set.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # apply_calibration
    #: Probability of the empty machine's deviation by chance below which it is no longer the
    #: machine that was calibrated (three deviations): 0.3 % of good logs are refused.
    moved_machine_probability: float = 0.0027

    # learnt_priors
    #: Fewest logs that show what differs between them.
    min_logs: int = 3
    #: Logs differ where chance makes them differ as much with a smaller probability, in any term:
    #: with 5 % of each of eight terms a third of all campaigns had a variation that was none.
    variation_probability: float = 0.05
    #: Fraction of a prior that is left at least: a term stays in the fit.
    min_prior_fraction: float = 0.01
    #: Fraction of its prior up to which the uncertainty of a term in a log determines the term.
    informative_posterior_fraction: float = 0.995
    #: Standard deviations from which a later log contradicts.
    contradicting_std: float = 4.0

    # mass_differences
    #: Standard deviation by which effects that grow with the load change a slope beside the gain:
    #: rolling resistance of 1.5 % made 5 % of it, and so does a bias of 0.05 m/s²; priors allow for
    #: twice that.
    slope_by_load_std_1: float = 0.1
    #: Deviations of a slope from the gain beyond which it is the machine's own (a measured axle
    #: that carries another share of the force under load): no ratio of masses determines it then.
    slope_gain_max_std: float = 3.0


#: The values in use.
LIMITS: Final = CalibrationUseLimits()
