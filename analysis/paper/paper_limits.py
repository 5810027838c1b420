"""Choices of how the paper's results are computed again that its text leaves open."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class PaperLimits:
    """Choices of how the paper's results are computed again that its text leaves open.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # campaign_figures
    #: Time in s before a trial's start that a figure shows, so that the gate opens in it,
    before_trial_s: float = 2.0
    #: and after its end, so that it closes.
    after_trial_s: float = 0.5

    # claims
    #: Ratio up to which two errors are called alike.
    alike_error_ratio: float = 1.2

    # confidence_intervals
    #: Probability of an interval,
    confidence_1: float = 0.95
    #: and resamples of the bootstrap that finds it.
    bootstrap_resamples: int = 1000

    # excitation_figures
    #: Window in s that the text calls optimal.
    optimal_window_s: float = 10.0
    #: Time in s since the first window in which the methods still converge.
    converging_s: float = 10.0
    #: Time in s that a figure shows.
    figure_s: float = 60.0
    #: Time in s at the end of a log in which the machine stands, so that there is noise alone.
    standing_s: float = 4.0

    # paper_excitation
    #: Phases in a sample at which a window may start.
    phases_per_sample: int = 10
    #: Periods after which the start is forgotten: 48 time constants m/b.
    settled_periods: int = 4
    #: Periods that Figures 2 to 4 show, and one more.
    figure_periods: int = 5

    # simulated_sources
    #: Window in samples that is held fixed in Table 3, and threshold in nat in Table 4: the values
    #: of section 4.3, which are also the defaults.
    fixed_window_samples: int = 320
    fixed_threshold_nat: float = 0.7
    #: Cruise in s that follows the start, for the claim about constant speed.
    cruise_s: float = 90.0
    #: Windows of Table 1 for each of which a long cruise is simulated once.
    windows_per_cruise: int = 5

    # table1
    #: Time in s from which recursive least squares starts.
    rls_start_s: float = 0.2
    #: Samples that are held at once.
    block_samples: int = 400_000
    #: Ratio up to which an error reaches its bound.
    reached_bound_ratio: float = 1.25


#: The values in use.
LIMITS: Final = PaperLimits()
