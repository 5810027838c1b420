"""Limits of the noise that is estimated from a log; no machine file sets them."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class NoiseLimits:
    """Limits of the noise that is estimated from a log; no machine file sets them.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # channel_noise
    #: Time in s after a stop that is no standstill yet: the machine rocks.
    settle_after_stop_s: float = 0.6
    #: The same before a start, whose torque rises first.
    settle_before_start_s: float = 0.3
    #: Standard errors by which a ratio of two powers exceeds 1 if the power grows in motion.
    growth_min_std: float = 3.0
    #: Standard deviation, as a fraction of a column's largest value, below which changes are
    #: rounding.
    rounding_range_fraction: float = 1e-9
    #: Fraction of its largest power below which the spectrum at standstill is a filter's stop band.
    growth_stop_band_fraction: float = 1e-3
    #: Standstills that are looked at: more say nothing new.
    max_standstills: int = 100
    #: Values in a piece of standstill up to which a column reads a constant.
    constant_max_values: int = 3

    # column_noise
    #: Standard deviation of the noise of Coulomb's sign, which is nearly exact.
    sign_noise_std_1: float = 0.001
    #: Means of so many samples of a derivative are differences.
    derivative_mean_samples: int = 20

    # grid_noise
    #: Rows of noise that covariances are taken from: sums over all lags are right to 5 %.
    simulated_rows: int = 65_536
    #: Repetitions of a short log at most.
    max_repetitions: int = 64
    #: Seed of the random numbers: a replay gives the same noise each time.
    simulation_seed: int = 2026
    #: Fraction of its power in the fast band below which a column's filter hides its noise.
    hidden_power_fraction: float = 0.01
    #: Relative difference below which two rates are one: a derivative taken at the other has the
    #: same response.
    same_rate_1: float = 0.02

    # noise_spectra
    #: Ratio to its limit from which an estimate is too large: by more than its own error.
    excess_ratio: float = 1.25
    #: Rows beyond which the residual of the equation is a limit.
    residual_min_rows: int = 20
    #: Samples of a piece of standstill at most; each has a straight line of its own.
    piece_max_samples: int = 192
    #: Samples of a piece at least: shorter stretches tell too little.
    piece_min_samples: int = 40
    #: Pieces that are looked at: more say nothing new,
    max_pieces: int = 100
    #: and blocks likewise.
    max_blocks: int = 1000
    #: Samples of a mean that shows whether a standstill has settled.
    short_mean_samples: int = 10
    #: Median distances from its level beyond which such a mean has left it.
    unsettled_median_distances: float = 7.0
    #: Rounds of trimming a standstill at both ends.
    trim_rounds: int = 3
    #: Variance over the median from which a piece holds an event (a bucket that is set down).
    event_variance_ratio: float = 4.0
    #: Samples of a block whose power is taken at each frequency; a block begins at every half of
    #: it.
    block_samples: int = 48
    #: Fast power over the median from which a block holds a step,
    step_power_ratio: float = 2.0
    #: and what it may have beyond that, over the number of blocks: medians of few scatter.
    step_power_scatter: float = 10.0
    #: Fraction of its largest power below which a spectrum is a filter's stop band.
    stop_band_fraction: float = 1e-4
    #: Fewest blocks that have a median.
    min_blocks: int = 3
    #: Readings that are searched for a step of quantisation.
    quantisation_samples: int = 4096
    #: Times that a reading occurs if it is a multiple of the step,
    multiple_min_times: int = 3
    #: and the fraction of the readings that are such multiples.
    multiple_min_fraction: float = 0.3
    #: Largest distance of a multiple from a whole number of steps.
    multiple_tolerance_1: float = 1e-3
    #: Samples over which the slope of a quantised column is taken.
    slope_samples: int = 10
    #: Frequency in Hz above which changes are noise, not driving,
    fast_hz: float = 10.0
    #: at most this fraction of the rate.
    fast_max_rate_fraction: float = 0.25
    #: Periods in a block below which white noise comes out too large: by half at one, a tenth at
    #: two.
    leak_periods: float = 3.0
    #: Top of the band above that, over its bottom: its power tells how much there is below it.
    fast_band_ratio: float = 2.5
    #: Lags that count as correlated in the power at zero frequency.
    correlated_lags: int = 24


#: The values in use.
LIMITS: Final = NoiseLimits()
