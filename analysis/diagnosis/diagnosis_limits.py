"""Built-in limits of the checks, which no machine file can set."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class DiagnosisLimits:
    """Built-in limits of the checks, which no machine file can set.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # check_inputs
    #: Largest excess over the empty mass, in standard uncertainties, that passes for a payload if
    #: no state is known to be empty: 43 % at a scale of 10 %.
    payload_u: float = 3.0
    #: Largest distance, in logarithms, of a ratio of masses from a factor that explains it:
    #: friction and what is carried bend a mass so far.
    factor_tolerance: float = 0.08
    #: Time in s of the means by which the model is judged where noise hides it in the samples: a
    #: start lasts longer.
    explained_mean_s: float = 1.0

    # checks
    #: Shortest motion in s of which the correlation has a sign.
    correlation_min_moving_s: float = 1.0

    #: Time in s that a torque takes to fall once the drive is shut: 2.5 time constants of the
    #: slowest drive of `benchmarks/turning.py`.
    falling_torque_s: float = 0.5
    #: Pull of gravity in m/s², beyond what the machine gains, from which it is driven downhill.
    driven_downhill_min_m_s2: float = 0.1

    # excluded_stretches
    #: Largest change of the answer without a stretch, in its standard uncertainties, that is none.
    harmless_change_u: float = 1.0
    #: Periods of its cut-off over which a low-pass smears a reading, either way.
    smeared_periods: float = 1.0

    # fit_checks
    #: Standard deviations of both together from which a method is contradicted,
    contradicting_std: float = 3.0
    #: if it differs by more than this fraction of the mass.
    contradicting_fraction: float = 0.01
    #: Standard deviations from 0 from which a term is there.
    term_min_std: float = 3.0

    # measured_channels
    #: Time in s for which a reading repeats if it is frozen, while another channel changes
    frozen_s: float = 0.3
    #: by this fraction of its range,
    frozen_change_fraction: float = 0.15
    #: or by this one if the noise of the frozen channel shows elsewhere.
    frozen_noisy_change_fraction: float = 0.05
    #: Noise shows where no more than this fraction of the other readings repeats the one before,
    repeating_max_fraction: float = 0.02
    #: if these are more than this fraction of all.
    repeating_min_fraction: float = 0.1
    #: Fraction of its range below which the readings of a speed are next to a stand: it comes to a
    #: stand gradually, and a sensor that drops out falls to 0 from any speed.
    stand_edge_range_fraction: float = 0.1
    #: The same as a multiple of the threshold below which a speed reads 0: machines stop fast at a
    #: pile.
    stand_edge_threshold_ratio: float = 2.0
    #: Quantile of the steps from reading to reading under way that one to a stand may be: at 1 Hz a
    #: machine is as fast as that one reading before it stands. Braking is that hard in a fiftieth
    #: of the readings of a bus with 25 stops.
    stand_edge_step_quantile: float = 0.98
    #: Readings beside a 0 that do not count as under way, with the 0 itself.
    stand_edge_readings: int = 3
    #: Fewest readings of a run: of a slow channel two equal readings are none.
    run_min_readings: int = 5
    #: Largest step beside a run, over the smallest there, that is one step of the resolution.
    single_step_ratio: float = 1.5
    #: Such steps that a signal moves in half of the run's time beside it, if it is slow there.
    slow_max_steps: float = 6.0
    #: Readings on either side of a run that show whether the channel has noise,
    smooth_readings: int = 20
    #: and the largest fraction of them that turns back by more than such a step if it has none:
    #: white noise of two steps turns at a fifth of its readings.
    smooth_max_turns: float = 0.1
    #: Readings at an extreme, over those of the next value, from which they are clipped,
    clipped_count_ratio: int = 4
    #: and their least number.
    clipped_min_readings: int = 20
    #: Fewest runs at one value that is a limit: a sensor freezes at any value.
    limit_min_runs: int = 3
    #: Largest fraction of the readings that are beyond a limit.
    limit_max_beyond_fraction: float = 0.1
    #: Time in s in which readings at a limit are counted,
    limit_window_s: float = 0.5
    #: and the fraction of them from which the signal is at it: fewer are noise that reaches it. Cut
    #: off, they take 0.08 of the noise's deviation off the mean, a half of them 0.4.
    limit_min_fraction: float = 0.15

    # side_comparison
    #: Standard deviations from which a difference of the sides shows.
    sides_min_std: float = 5.0
    #: Length in s of the means that are compared,
    sides_mean_s: float = 0.1
    #: and the fewest of them.
    sides_min_means: int = 30
    #: Neighbouring means are correlated: one of so many counts as independent.
    sides_correlated_means: float = 5.0
    #: Largest yaw rate of a straight drive, in rad/s.
    straight_max_rad_s: float = 0.1
    #: Yaw rate in rad/s from which tyres scrub, as friction does: a few deviations of a gyroscope.
    scrubbing_rad_s: float = 0.03
    #: Fraction of the largest torque above which a start is hard,
    hard_torque_fraction: float = 0.8
    #: and below which it is soft.
    soft_torque_fraction: float = 0.45
    #: Standard deviation of a ratio of the sides above which the standstills are used as well,
    sides_ratio_std_1: float = 0.02
    #: where what opposes one side alone while it moves, as on a cross slope, is part of the ratio:
    #: so much of the largest torque, in machines that are sound.
    one_sided_resistance_1: float = 0.03


#: The values in use.
LIMITS: Final = DiagnosisLimits()
