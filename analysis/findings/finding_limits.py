"""Thresholds of the causes. They are fixed: no machine file can set them."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class FindingLimits:
    """Limits of the causes; a comment says what a value limits, its unit and its choice."""

    # constant_forces
    #: Squared deviations that a further cause must explain.
    cause_cost: float = 9.0
    #: Interval in s of rows that count as independent where motions are compared.
    independent_rows_s: float = 0.2
    #: Standard deviations from which a standing reading is one,
    standing_reading_std: float = 5.0
    #: its least size as an acceleration, in m/s²,
    standing_reading_m_s2: float = 0.004
    #: and as a fraction of the largest force.
    standing_reading_fraction: float = 0.002
    #: Fewest rows of an explanation.
    constant_min_rows: int = 30

    # delay_causes
    #: Square root of the likelihood gain that chance stays below.
    likelihood_gain_root: float = 3.45
    #: Delay in s that stamps are trusted to: the strength of a short delay is measured by it.
    trusted_stamp_s: float = 0.002
    #: Smallest delay in s that is reported: half a period at 100 Hz. A bus makes as much, and less
    #: than that, which 10 of 250 sound machines seemed to have, moved no mass by 0.4 u.
    min_delay_s: float = 0.005
    #: Delay in s from which a later accelerometer has been filtered.
    filter_delay_s: float = 0.06
    #: Factor of its strength by which a delay of the whole motion is ranked before its effects.
    long_delay_rank: float = 100.0
    #: Delay in s between two sensors of the force from which it is reported: a bus is late by less,
    source_delay_s: float = 0.02
    #: its standard deviations,
    source_delay_std: float = 5.0
    #: longest in s that is looked for,
    longest_source_delay_s: float = 0.5
    #: parts of the log that it is estimated in, for its standard deviation,
    source_delay_parts: int = 8
    #: and correlation in a part from which two sensors follow one demand.
    source_correlation: float = 0.9

    # find_causes
    #: Change of the mass, in its standard uncertainties, from which a cause widens the answer.
    widening_change_u: float = 1.0
    #: Least that it may move it, likewise, to account for failed checks: about its uncertainty.
    accounting_change_u: float = 0.5

    # finding_inputs
    #: Time in s after motion from which a stand is judged: a machine swings after it has stopped,
    stand_after_motion_s: float = 1.2
    #: and time in s before motion up to which it is.
    stand_before_motion_s: float = 0.2
    #: Length in s of means of a stand, which hardly depend on each other,
    stand_block_s: float = 0.5
    #: and their fewest.
    stand_min_blocks: int = 6
    #: Fraction of the largest force that a machine has at a stand, by drag of its drive.
    idle_force_fraction: float = 0.05
    #: Gap before an error code, as a fraction of the largest usual distance from the middle:
    #: readings of a sensor that clips come up to its limit.
    error_code_gap_fraction: float = 0.25
    #: Largest fraction of the readings that are error codes,
    error_code_max_fraction: float = 0.1
    #: and quantile of one side's distances from the middle above which they are looked for.
    error_code_searched_quantile: float = 0.75

    # fit_causes
    #: Standard deviations from 0 from which a term of the fit shows.
    term_min_std: float = 3.45
    #: The same of the wheel radius: a boom that moves is in the accelerometer alone.
    wheel_radius_min_std: float = 4.0
    #: Slip at full force above which something else is wrong: wheels that slip by more spin.
    max_slip_1: float = 0.5
    #: Error of an IMU that rocks on its mount, as a fraction of the acceleration.
    rocking_imu_fraction: float = 0.03
    #: Smallest error of a gain: no accelerometer scale is trusted to less, and MEMS drift so far,
    trusted_gain_1: float = 0.005
    #: nor Coulomb friction to a smaller fraction of the largest force,
    trusted_coulomb_fraction: float = 0.002
    #: nor the measured share of the force to a smaller change, per m/s²,
    trusted_share_change_s2_m: float = 0.01
    #: nor one larger than with half on the driven axle and a height of 0.8 of the wheelbase,
    max_share_change_s2_m: float = 0.17
    #: nor one that explains less of the residual (gusts 0.03 to 0.13), if it exceeds the noise so,
    min_share_change_explained_1: float = 0.15
    min_misfit_ratio: float = 1.5
    #: nor a gain to a smaller drift over a log: friction that warms looks like 0.02.
    trusted_gain_drift_1: float = 0.03
    #: Relative standard uncertainty of an answer from too little excitation.
    poor_answer_u: float = 0.06
    #: Fraction of the mass that priors alone leave open if regressors are collinear.
    open_mass_fraction: float = 0.06
    #: Smallest resistance of a pile, over the empty machine's weight.
    pile_weight_fraction: float = 0.01
    #: Change of the mass by braking, in standard uncertainties of the answer, that is one.
    braking_change_u: float = 1.5
    #: Fraction of braking that the force does not see, below which brakes count as seen.
    seen_braking_fraction: float = 0.002
    #: Largest uncertainty without braking over that with it: less motion determines less.
    braking_u_ratio: float = 4.0

    # setting_causes
    #: Growth of an estimate's own standard deviation at steady speed from which it winds up: three
    #: quarters of what it knew are then forgotten.
    wind_up_growth: float = 2.0
    #: Fewest estimates at steady speed.
    wind_up_min_estimates: int = 100
    #: Fraction of the windows from which braking takes a large part of them.
    braking_windows_fraction: float = 0.5
    #: Relative distance within which the masses of driving and braking are one: brakes that are
    #: seen to nine tenths put them six to ten hundredths apart.
    braking_mass_tolerance: float = 0.04
    #: Relative standard deviation of each below which they are compared.
    braking_mass_u: float = 0.02

    # changing_loads
    #: Probability that a log without a growing load shows one.
    growth_false_alarm_probability: float = 5e-4
    #: Factor of certainty for a load that falls: what pours in may pour fast.
    falling_load_factor: float = 1.25
    #: Factor of certainty for one manoeuvre alone: warming friction reaches 1.21 in sound logs.
    single_growth_factor: float = 1.3
    #: Fewest rows of a manoeuvre,
    growth_min_rows: int = 10
    #: and smallest fraction of a column that other terms leave.
    growth_min_left_fraction: float = 0.02
    #: Longest drive in s that still loads: after it, the end of the drive would weigh by its time.
    longest_loading_s: float = 15.0

    # mass_drifts
    #: Fewest manoeuvres that tell a steady change from steps.
    steady_min_manoeuvres: int = 5
    #: Mass over the lightest load up to which a load is as light, and from which it is heavier,
    as_light_ratio: float = 1.04
    heavier_ratio: float = 1.08
    #: Ratio of lightest loads before and after a time from which they are not one machine,
    lightest_load_step_ratio: float = 1.15
    #: with the difference in standard deviations.
    lightest_load_step_std: float = 4.0
    #: Relative distance within which it is that of two units: slip by load makes 2 %.
    step_unit_tolerance: float = 0.03

    # likelihood_search
    #: Difference of gains (twice the log likelihood) below which causes are indistinguishable.
    indistinguishable_gain: float = 6.0
    #: The same as a fraction of the gain, for brakes and what resembles them.
    indistinguishable_brake_fraction: float = 0.5
    #: Gain from which a cause is picked,
    picked_gain: float = 11.0
    #: and most causes of a log.
    max_picked_causes: int = 4
    #: Delay in s from which it is tried as a whole,
    long_delay_s: float = 0.03
    #: and picked if it leaves less than this fraction.
    long_delay_residual_ratio: float = 0.5
    #: Residual-to-noise variance ratio above which the wheel equation is ignored.
    wheel_noise_ratio: float = 8.0
    #: A delay that moves by less, in s, has converged,
    delay_tolerance_s: float = 3e-4
    #: within so many rounds,
    delay_rounds: int = 5
    #: and is no longer than this, in s.
    longest_likelihood_delay_s: float = 0.2

    # long_delays
    #: Longest delay that is searched, in s,
    longest_delay_s: float = 2.5
    #: and shortest: the likelihood search finds shorter ones.
    shortest_long_delay_s: float = 0.15
    #: Length in s of the means that are compared.
    delay_mean_s: float = 0.1
    #: Length in s of the beginning of a longer log that is compared.
    delay_search_span_s: float = 1200.0
    #: Correlation of channels of one motion once the delay is removed,
    same_motion_correlation: float = 0.8
    #: and the fraction of it that they stay below with the delay.
    delayed_correlation_ratio: float = 0.9
    #: or fraction of the unexplained variance that removing a delay leaves, where the motion is so
    #: slow that they correlate all the same.
    delayed_rest_ratio: float = 0.25
    #: Fraction of the largest force that drives: brakes are not in it.
    driving_force_fraction: float = 0.3
    #: Time in s before, in which it stands or drives the other way.
    driving_start_s: float = 0.5

    # an IMU on the boom
    #: Change of the reading at standstill per rad of the boom's angle, as a fraction of gravity:
    #: 1 of an IMU on the boom itself, 0.25 of one on a link; a frame squats by 0.01, and a ramp of
    #: 10 % to where all loads are dumped is 0.1.
    boom_gravity_fraction_per_rad: float = 0.15
    #: Variance of the readings that the angle leaves unexplained, at most: ground is not a
    #: function of it.
    boom_unexplained_1: float = 0.2
    #: Least standard deviation of the angle over the standstills, in rad.
    boom_min_std_rad: float = 0.05

    # a loose accelerometer
    #: Gain of a loose accelerometer on the wheels' acceleration, at least,
    loose_gain_1: float = 1.02
    #: by so many standard deviations.
    loose_gain_std: float = 2.0
    #: Length in s of the part of a start that is examined,
    start_window_s: float = 1.28
    #: from so long after its force rises, in s,
    start_rise_s: float = 0.1
    #: after a stand of so long, in s.
    start_stand_s: float = 0.4
    #: Force of a start as a fraction of the largest force,
    start_force_fraction: float = 0.3
    #: for this fraction of the window.
    start_held_fraction: float = 0.9
    #: Fewest starts, or standstills.
    loose_min_starts: int = 3
    #: Frequencies of a rocking mount, in Hz.
    rocking_band_hz: tuple[float, float] = (2.5, 10.0)
    #: Power of a peak over the bands below and above it,
    rocking_peak_ratio: float = 3.4
    #: which are these multiples of its frequency
    below_peak_band: tuple[float, float] = (0.4, 0.72)
    #: on either side,
    above_peak_band: tuple[float, float] = (1.35, 2.2)
    #: and over the power at rest at its frequency: an engine shakes always.
    peak_over_standing_ratio: float = 4.0

    # masked_causes
    #: Length in s of the beginning of a longer log that is searched again.
    masked_searched_s: float = 3600.0
    #: Further searches of a log.
    masked_rounds: int = 3

    # part_of_work
    #: Fewest counted cycles with digging from which digging is the work; fewer may be a pile met by
    #: chance.
    work_min_cycles: int = 3

    # refit
    #: Deviation between a refit and a replay, as a fraction of that by noise: what a replay accepts
    #: besides, and the mean that it takes.
    replay_std_fraction: float = 0.5
    #: Relative uncertainty of the change: the mended channel is not all that the cause affected.
    change_u: float = 0.05
    #: Rounds of a refit, one more if the lag moves;
    refit_rounds: int = 3
    #: of more stretches the first ones alone find lag and slip.
    refit_pilot_stretches: int = 24
    #: Change of the lag in s that is a move.
    refit_lag_moves_s: float = 1e-3
    #: Time in s around samples that a shift of force and speed reaches.
    refit_reach_s: float = 0.4
    #: Relative uncertainty of the change if starts were cut.
    cut_start_u: float = 0.5
    #: Accelerometers that differ by a constant within this, in m/s², are one to the wheels.
    zero_shift_m_s2: float = 1e-9
    #: Stretches of a log that are refitted.
    refit_max_stretches: int = 48
    #: Fewest samples of a refit,
    refit_min_samples: int = 200
    #: and of a stretch.
    refit_min_stretch_samples: int = 20

    # residual_causes
    #: Samples of a spectrum, half of which the next one shares.
    spectrum_samples: int = 128
    #: Fewest spectra, and most that are computed.
    spectrum_counts: tuple[int, int] = (6, 4000)
    #: Fraction of the spectra that is averaged; the strongest hold stops and knocks.
    averaged_spectra_fraction: float = 0.85
    #: Frequencies of a resonance, in Hz,
    resonance_band_hz: tuple[float, float] = (2.0, 20.0)
    #: of slow noise, in Hz,
    slow_noise_hz: float = 1.2
    #: from which the power up to a resonance must rise, in Hz,
    below_resonance_hz: float = 0.7
    #: and of the reference, in Hz.
    reference_band_hz: tuple[float, float] = (3.0, 10.0)
    #: Ratios of power that chance and resampling stay below: of a peak,
    resonance_peak_ratio: float = 4.0
    #: Standard deviations from which a term that the model lacks is reported; it widens from 3.
    named_term_min_std: float = 5.0
    #: Half of a reported hysteresis loop over the largest force: half of what such sensors have.
    hysteresis_share: float = 0.003
    #: of noise in motion, if standstill has this part of its power at least,
    driving_noise_ratio: float = 1.9
    still_noise_ratio: float = 1e-6
    #: and of slow noise.
    slow_noise_ratio: float = 2.6

    # scale
    #: Standard uncertainties, with the scale's, that chance stays below.
    wrong_scale_u: float = 3.0

    # sign_causes
    #: Correlation that has a sign.
    signed_correlation: float = 0.3
    #: Share of starts in the direction of the force below which the speed has the wrong sign.
    opposed_driving_share: float = 0.2
    #: Standard deviations from which a gain has one.
    signed_gain_std: float = 8.0
    #: A force is unsigned if at most this fraction of decelerating samples opposes the motion,
    unsigned_opposing_fraction: float = 0.1
    #: or where it reverses in more than this fraction of the samples.
    unsigned_reverse_min_fraction: float = 0.05
    #: A force drives above this share of the largest that makes the speed rise,
    unsigned_force_fraction: float = 0.3
    #: and the speed has lost its sign where so much of that driving is of the other sign,
    unsigned_reverse_fraction: float = 0.1
    #: with forces over accelerations that are alike to this factor.
    unsigned_mass_ratio: float = 2.0
    #: which last so long in all, in s,
    unsigned_braking_s: float = 0.3
    #: and are at least so many,
    unsigned_min_samples: int = 3
    #: and at most this fraction of its readings is negative.
    unsigned_negative_fraction: float = 0.002
    #: or, where it drives in reverse, none below 0 by more than this fraction of the largest.
    unsigned_noise_fraction: float = 0.05
    #: Speed in m/s that is reverse.
    reverse_speed_m_s: float = 0.05
    #: Factor of its strength by which a sign, which has no size, is ranked first.
    sign_rank: float = 30.0
    #: Correlation of left and right below which they oppose each other.
    opposing_sides_correlation: float = -0.5
    #: Turn above the gyroscope's noise that distinguishes the sides, in rad/s.
    turn_rad_s: float = 0.03
    #: Relative standard deviation below which an ungated mass or a gain is known,
    known_ratio_u: float = 0.05
    #: and below which the fit's mass is.
    known_mass_u: float = 0.15
    #: Relative distance within which a ratio is that of a unit,
    unit_ratio_tolerance: float = 0.06
    #: and within which a mass is: load and friction affect it more.
    unit_mass_tolerance: float = 0.35
    #: Ratios nearer to each other are indistinguishable.
    ratio_resolution: float = 0.015

    # unexplained
    #: Strength of a check without a number, or without a limit to compare it with.
    numberless_check_strength: float = 1.0

    # whitened_rows
    #: Samples of a mean of the force's rows,
    force_mean_samples: int = 5
    #: and of the wheels'.
    wheel_mean_samples: int = 10
    #: Fewest means of a stretch of the wheel equation.
    wheel_min_means: int = 10
    #: Samples of the means that show noise that accumulates.
    accumulated_noise_samples: int = 100
    #: Rows over which correlated residuals count for less.
    correlated_rows: int = 10
    #: Fraction of a cause's column that others must leave: with less it is indistinguishable from
    #: what a model never has.
    min_column_left_fraction: float = 0.012
    #: Mean square of the progress over a log, which goes from -1/2 to 1/2.
    progress_mean_square: float = 1.0 / 12.0
    #: Samples of the parabola that gives a derivative.
    force_rate_samples: int = 9
    #: Smallest noise variance of a whitened row, of which 1 is expected.
    min_row_variance: float = 0.5

    # accelerometer_causes
    #: Gravity on z in m/s² that a tilt must take to be told from a bias.
    tilt_min_gravity_m_s2: float = 0.05
    #: Smallest yaw of a misalignment, in rad: less is mounting.
    misalignment_min_yaw_rad: float = 0.03
    #: Fraction of the wheels' acceleration below which an accelerometer is low-passed,
    low_passed_gain_1: float = 0.6
    #: by so many standard deviations.
    low_passed_std: float = 2.0
    #: Standard deviation of a gain below which it may be the ratio of two units.
    unit_gain_std_1: float = 0.02
    #: Fraction of gravity at standstill below which an accelerometer reads none.
    gravity_min_fraction: float = 0.5
    #: Smallest pitch, in rad, whose gravity is missed.
    slope_min_pitch_rad: float = 0.002
    #: Shortest time in s over which a machine on level ground slows down without drive,
    descent_window_s: float = 3.0
    #: at the least deceleration in m/s² by rolling resistance, that of a railway vehicle,
    least_rolling_m_s2: float = 0.02
    #: by so many times the noise and resolution of the speed.
    descent_noise_factor: float = 3.0
    #: Time in s at either end of it over which the speed is averaged.
    descent_end_s: float = 0.25
    #: Mean force along the motion up to which there is no drive, as a fraction of the largest
    #: force: a cruise on level ground takes more.
    descent_force_fraction: float = 0.01
    #: Total time in s of descents: 0 in 70 logs of level ground, 90 to 120 s on slopes of 4 to 6 %.
    descent_min_s: float = 10.0
    #: Factor of its strength by which an upside-down mounting is ranked before what has a size.
    upside_down_rank: float = 100.0


#: The values in use.
LIMITS: Final = FindingLimits()
