"""Built-in limits of the joint fit, which no machine file can set."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class WeighingLimits:
    """Built-in limits of the joint fit, which no machine file can set.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # empty_mass_datum
    #: Largest difference of the log's empty mass and the stated one, in its standard uncertainties.
    empty_mass_agreement_u: float = 3.0
    #: Relative standard uncertainty of a scale of which the machine file says nothing, where it has
    #: to be told from another machine.
    unknown_scale_u: float = 0.1

    # fit_columns
    #: Rows fitted per length of the mean: two hold nearly all that its means hold.
    rows_per_mean: int = 2
    #: Shortest stretch, in s: shorter ones determine nothing of their own.
    shortest_stretch_s: float = 0.5
    #: Smallest share of the force that load transfer leaves.
    load_transfer_min_gain: float = 0.5
    #: Least relative load: no state is lighter than a tenth of the mean.
    least_relative_load: float = -0.9
    #: Quantiles of the manoeuvres' masses between which the middle of empty and loaded lies.
    load_contrast_quantiles: tuple[float, float] = (0.1, 0.9)
    # force_rate
    #: A derivative of the force below so many standard deviations is noise.
    force_rate_min_std: float = 4.0
    #: Half widths, in s, of the parabolas that give it, beside that of one row.
    force_rate_half_widths_s: tuple[float, ...] = (0.04, 0.06, 0.1, 0.16)
    #: Half width in s of the two parabolas of its second derivative: a belt of 20 Hz needs a
    #: short one, and its noise is corrected for.
    force_bend_half_width_s: float = 0.01
    #: Standard deviations within which two parabolas agree: with 3 and more the wide ones blur the
    #: cut of a throttle, and of slip by 2 % less than a quarter was found in a noisy force.
    force_rate_agreement_std: float = 2.0

    # fit_task
    #: A lag that changes by less, in s, has converged.
    lag_tolerance_s: float = 1e-4
    #: Largest offset that is taken off the force, in widths of its prior.
    max_offset_prior_std: float = 3.0
    #: Longest lag that is searched, in s.
    longest_lag_s: float = 0.3
    #: Smallest width of the prior of slip by the wheels, over its prior: no further trusted.
    min_slip_std_fraction: float = 0.05
    #: Share of its prior below which the wheels determine slip: of a third it was 2 σ off.
    slip_posterior_fraction: float = 0.1
    #: Prior of the share of their slip stiffness that wheels or tracks have in proportion to the
    #: load on them, and its standard deviation: tyres on asphalt and tracks on sand near 1
    #: (Pacejka, chapter 4; Wong, Theory of Ground Vehicles, chapter 2), on clay near 0.
    slip_stiffness_by_load_1: float = 0.5
    #: Fewest drives between stands or holes: fewer do not separate a drift from a change of load.
    drift_min_drives: int = 6

    # joint_fit
    #: Rounds of finding the lag, shifting the force by it, and fitting again.
    lag_rounds: int = 4
    #: Rounds of the fits that choose the mean: a lag left in would decide the choice.
    pilot_rounds: int = 2
    #: Rounds of finding a squat under loads whose size it changes.
    squat_rounds: int = 4
    #: Rounds of load states and the fit that removes the nuisances.
    state_rounds: int = 4
    #: Rounds in which suggested loads are held: with the second the route has its dumps.
    held_rounds: int = 2
    #: Smallest mass that is one, as a share of force over acceleration.
    min_mass_fraction: float = 0.1
    #: Largest share of noise in a direction of the columns: with more a mean is too short.
    max_noise_fraction: float = 0.3
    #: Standard deviation over the smallest one up to which the shortest mean is taken.
    near_best_std_ratio: float = 1.1
    #: Difference of masses, in standard deviations, from which the mean's length matters.
    mean_length_std: float = 2.5
    #: The same as a share of the mass.
    mean_length_fraction: float = 0.005
    #: Means, in rows, on a slow grid whose shortest is a row: cars at 1 Hz were 1 to 3 % off.
    slow_grid_mean_rows: tuple[int, int, int] = (1, 2, 4)
    #: As `mean_length_fraction`, on such a grid.
    slow_grid_mean_length_fraction: float = 0.002
    #: Error that no mean shows there, as a share of the mass per second of step: 0.3 % of a bus.
    slow_grid_hidden_1_s: float = 0.003
    #: Misfit ratio of a fit of several loads above which its mean is too short: a swinging body had
    #: 2.1 to 4, with payloads 10 to 15 % low by means of 0.02 to 0.1 s; without it 0.4 to 1.5.
    max_misfit_ratio: float = 2.0
    #: Mean, in s, that is tried then, however short the starts.
    transient_mean_s: float = 0.8
    #: Fewest means of a stretch that have no sample in common.
    disjoint_means_per_stretch: int = 6
    #: Lag in s up to which a delayed and a low-passed force do not differ.
    short_lag_s: float = 0.003
    #: Delay in s of the motion with which its effect on the masses is measured.
    probe_delay_s: float = 0.005
    #: Gain of the motion with which its effect on the masses is measured.
    probe_gain_1: float = 0.01
    #: Lengths of the mean that are tried, in s; the smallest deviation of the mass decides.
    means_s: tuple[float, ...] = (0.05, 0.1, 0.2, 0.4, 0.8, 1.6)
    #: Stretches that show which mean is best.
    pilot_stretches: int = 24

    # missing_terms
    #: Prior standard deviation of a gain that depends on speed or force: 7 to 12 % were tried.
    missing_term_prior_std: float = 0.1
    #: Prior of an elasticity, in s²: a mass that swings at 5 Hz.
    elasticity_prior_std_s2: float = 1e-3
    #: Standard deviations from which it is one: none of a hundred other machines, belts 73 to 86.
    elasticity_min_std: float = 10.0
    #: Part of the log in which the friction of a cold machine falls by a factor of e.
    warming_fraction: float = 0.15
    #: Standard deviations from which a term is significant: 99 % of sound logs have at most 3,
    missing_term_min_std: float = 3.0
    #: if the log determines what it moves a mass to this share, or it is collinear with others, and
    #: to the second one if it is beyond doubt (an axle that lets go on the way was, 7 to 10 std),
    missing_term_max_effect_std: tuple[float, float] = (0.02, 0.05)
    certain_term_min_std: float = 6.0
    #: and it moves a mass by so many of its standard uncertainties.
    missing_term_min_relative_effect: float = 0.5
    #: Estimate of a gain by fitted over measured force (ten cars 0.7 to 1.2, grades -0.9 to 0.3),
    min_instrumented_ratio: float = 0.5
    #: that from which it is named as a cause (a low gear 0.63 and more, washboards up to 0.6),
    nameable_instrumented_ratio: float = 0.62
    #: and the largest ratio of the two forces.
    max_fitted_over_measured_force: float = 3.0
    #: Largest error of a sensor that is named, at the 95th percentile of the force and over it:
    #: tyres out of round and gusts looked like 0.4 to 1.
    max_saturation_1: float = 0.25
    #: Widths of a gain at low speed, and steps of a gain, as fractions of the largest speed.
    low_speed_fractions: tuple[float, ...] = (0.2, 0.35, 0.7)
    gain_step_fractions: tuple[float, ...] = (0.3, 0.5, 0.7)

    # empty_mass_drift
    #: Empty loads that tell a drift: three at either end; its least standard deviations and share.
    empty_drift_min_states: int = 6
    empty_drift_min_std: float = 3.0
    empty_drift_min_1: float = 0.005
    #: Largest loss of mass by fuel an hour, over the mass: twice what loaders burn.
    fuel_loss_1_h: float = 0.002
    #: Standard uncertainty of the gain over its drift: it may be as stated at either end.
    empty_drift_u_1: float = 0.75

    # empty_mass_step
    #: Empty states on either side of a step, its least scatters, and its least share.
    empty_step_side_min_states: int = 3
    empty_step_min_std: float = 6.0
    empty_step_min_1: float = 0.03

    # fitted_stretches
    #: Speed of a drive that is fast, and of one that is slow, as fractions of
    fast_1: float = 0.6
    slow_1: float = 0.4
    #: this quantile of the speed of a log: under a chute a machine creeps at a fifth of it.
    driving_speed_quantile: float = 0.9
    #: Path in m below which a machine that has stopped in a pile does not drive on.
    lurch_m: float = 0.3

    # force_hysteresis
    #: Prior standard deviation of half the loop over the largest force: sensors have 1 to 5 %.
    hysteresis_prior_share: float = 0.03
    #: The force has turned when it went back by so much of the largest force, half of a loop,
    hysteresis_turn_share: float = 0.01
    #: and by so many standard deviations of the noise of a mean,
    hysteresis_turn_std: float = 8.0
    #: which takes so many seconds at most: a force is held for longer.
    hysteresis_mean_s: float = 1.0
    #: A log shows hysteresis from so many standard deviations and this share of the force on.
    hysteresis_min_std: float = 8.0
    hysteresis_min_share: float = 0.002
    #: Standard uncertainty of what it moves, over itself: loops are no parallelograms.
    hysteresis_shape_u_1: float = 0.2

    # swinging_mass
    #: Prior standard deviation of the swinging mass over the machine's: a full tanker has 0.4.
    swinging_mass_prior_share: float = 0.5
    #: Frequencies in Hz that are searched, a tenth apart: from 15 m of rope to a coupling,
    #: the damping ratio with which they are (a swing that decays sooner looks like a delay),
    #: and the range of that of a mass that swings.
    swing_frequencies_hz: tuple[float, ...] = tuple(0.13 * 1.1**k for k in range(40))
    swing_damping_1: float = 0.04
    swing_damping_range_1: tuple[float, float] = (0.003, 0.18)
    #: Range of the relative growth of the mass on a spring over that of the machine: a load of 1 t
    #: on a mast of 1.5 t had 3.
    swinging_mass_growth_range_1: tuple[float, float] = (-2.0, 10.0)
    #: Least and largest ratio of that mass to its mean.
    swinging_mass_ratios: tuple[float, float] = (0.25, 4.0)
    #: Usual steps of the logarithms of frequency and damping, and of the growth,
    swing_refining_steps: tuple[float, float, float] = (0.05, 0.3, 0.2)
    #: and relative step of their differences.
    swing_difference_step: float = 1e-3
    #: Share of a column's size below which what is left is rounding.
    swing_rounding_1: float = 1e-9
    #: Fewest periods of a drive, or a change of the ground looks like a swing,
    swing_min_periods: float = 2.0
    #: and fewest samples of a period.
    swing_min_samples_per_period: float = 8.0
    #: Duration of a row of the search in s, its largest number of rows, and fewest manoeuvres.
    swing_row_s: float = 0.05
    swing_max_rows: int = 30_000
    swing_min_manoeuvres: int = 6
    #: Duration of a row by which they are refined, in periods: in shorter ones the noise of the
    #: acceleration made the damping a third too large.
    swing_row_periods: float = 0.1
    #: Frequencies within this ratio are one peak, within which it is refined,
    swing_peak_ratio: float = 1.6
    #: and fewest other frequencies that show whether it is one: a recurring step of the force
    #: looked like a swing in half of the logs of 2 Hz, in which there are none.
    swing_min_rivals: int = 6
    #: Least share of the residual's squares that a swinging mass explains in the search,
    swing_min_share: float = 0.1
    #: and ratio of the share that it explains when refined to what any frequency explains of the
    #: rest: 7.6 to 800 of liquids, masts, trailers and trains, 0.1 to 4.9 of other machines.
    swing_min_share_ratio: float = 6.0
    #: Time in a drive, in periods, in which a force that recurs in every drive is constant.
    swing_time_periods: float = 0.125
    #: Share of a swing's squares in which drives differ, from which they are compared,
    swing_min_difference_share: float = 0.03
    #: and least ratio of the force that differs with it to the swing: of liquids, masts, trailers
    #: and trains 0.76 to 1.04, of forces that recur in every drive -2 to 0.6, seldom more.
    swing_min_difference_ratio: float = 0.7
    #: Least swinging mass over the machine's: a recurring step of the force had 0.013.
    swinging_mass_min_share: float = 0.02

    # log_effects
    #: Prior probability that a log has an effect.
    effect_prior_probability: float = 0.2
    #: Width of the prior of an effect that is left out, over its own.
    left_out_prior_ratio: float = 0.02

    # low_gears
    #: Speed in m/s from which a vehicle has gears for the road: 40 km/h; loaders are slower.
    road_speed_m_s: float = 11.0
    #: Speed in m/s of the first gear. Only a log that drives so slowly determines the gears,
    first_gear_m_s: float = 4.0
    #: for at least this share of its samples; else the prior alone would separate them.
    first_gear_min_fraction: float = 0.05
    #: Speeds in m/s at which a quarter is left of what the first gear has beyond the top one: a
    #: lorry's low gears end at 4 m/s, a car's at 10.
    gear_quarter_speeds_m_s: tuple[float, float] = (4.0, 10.0)
    #: Of a measured gear ratio: smallest over largest of the fitted samples up to which there is a
    #: term of it,
    gear_ratio_min_change: float = 0.8
    #: time in s within which a gear changes,
    gear_change_s: float = 0.1
    #: logarithm of the smallest step of a gearbox, 1.15,
    gear_step_log: float = 0.14
    #: and prior of the rotating mass in the lowest gear, over that of a log without a ratio: what
    #: an engine adds to a lorry in its first gears is half of its mass and more.
    gear_ratio_prior_ratio: float = 3.0

    # mass_budget
    #: Negative viscous friction widens a mass from so many standard deviations on.
    falling_friction_std: float = 3.0
    #: Shift by doubled priors, in standard deviations, from which the answer depends on them.
    prior_dependence_std: float = 1.5
    #: Relative standard uncertainty of what the ground along the way does to a difference of loads.
    ground_shape_u_1: float = 0.15
    #: Share of a gain's drift by which either end of the log differs from its mean.
    half_gain_drift: float = 0.5

    # motion_samples
    #: Time in s before a manoeuvre in which the break-away lies: mean and phases see it late.
    break_away_look_back_s: float = 0.3
    #: Speed that moves, in standard deviations of its noise,
    moving_speed_std: float = 4.0
    #: and at least, in m/s.
    moving_speed_m_s: float = 0.01
    #: Time in s after a break-away, known to a few samples, in which friction may be of the stand.
    mixed_friction_s: float = 0.05
    #: The same at least, in samples, where a zero-phase low-pass reached across it,
    mixed_friction_filtered_samples: int = 3
    #: and elsewhere.
    mixed_friction_samples: int = 1
    #: Driving without a stand is cut into this, in s: longer than loaders drive between stands.
    longest_manoeuvre_s: float = 60.0
    #: Silence in s that separates two records: files from 0 follow after 10 s, networks sooner.
    record_break_s: float = 8.0
    #: Margin beside a gap in which nothing is fitted, in s.
    gap_margin_s: float = 0.1
    #: Longest path of a bench, in m, on which a spring or gravity may push back,
    bench_path_m: float = 6.0
    #: and its fewest passes.
    bench_min_passes: float = 6.0
    #: Time in s around a piece from where a lag or derivative may take samples.
    piece_margin_s: float = 0.6

    # nuisances
    #: Mean square of the progress, which goes from -1/2 to 1/2.
    progress_mean_square: float = 1.0 / 12.0
    #: Mean of its fourth power over that of its square: what its cube has of its slope.
    progress_cube_slope: float = 0.15
    #: Standard deviation of an offset, in N, below which nothing is left to find.
    min_offset_std_N: float = 1e-3

    # other_motion
    #: Variance of a sample of a central difference over that of the speed, by the step squared,
    central_difference_variance: float = 0.5
    #: and of a longer mean, which is the difference of two samples.
    mean_difference_variance: float = 2.0
    #: Time in s over which forces are averaged to compare the two sensors: a part of a start,
    compared_mean_s: float = 1.0
    #: fewest such means,
    compared_min_means: int = 20
    #: and ratio of their residual forces from which the force refutes the other sensor: 3 and more
    #: for wheels on hills of 2 %, about 1 on level ground with either sensor's noise or gain.
    refuted_residual_ratio: float = 2.0

    # record_places
    #: Rounds of moving records onto each other.
    place_rounds: int = 12
    #: Largest offset of a record whose path is centred, over the path.
    max_record_offset_1: float = 0.5
    #: Largest move of a record in a round, over the path: half of the shortest half wave.
    max_record_step_1: float = 0.06
    #: Moves of less have converged, over the path.
    record_tolerance_1: float = 1e-4
    #: Standard deviation of a free column of unit mean square, over that of the force.
    free_column_std: float = 1e3

    # fit_checks
    #: Viscous friction that is negative by at most this share of the largest force, at top speed,
    #: falls with the speed (mixed lubrication, gears): machines with grease that breaks away,
    #: four gears or a converter had up to 0.19, and masses that are right; friction of a
    #: hydrostatic drive whose speed has the wrong sign 0.9, of a truck 0.19, whose force then
    #: opposes every start (`driving_share`).
    falling_friction_1: float = 0.2

    # weigh
    #: Braking is left out if it moves the mass by so many standard uncertainties.
    braking_left_out_u: float = 3.0
    #: It is doubted if it moves it by so many of the answer's,
    braking_doubted_u: float = 2.0
    #: and in either case moves it by at least this share.
    braking_min_fraction: float = 0.005
    #: Standard deviations from which a term in a·|a| shows,
    curvature_min_std: float = 6.0
    #: if it moves the mass by this share,
    curvature_min_fraction: float = 0.01
    #: and by no more than this: a term that moves it farther is collinear with it.
    curvature_max_fraction: float = 0.5
    #: Rounds of the fit that finds the errors of a calibration's means: terms are products.
    learnt_mean_rounds: int = 2
    #: Shortest driving that is fitted, in s.
    shortest_log_s: float = 1.0

    # wheel_kinematics
    #: Share of the disagreement, beyond the speed's noise, below which gravity is taken off,
    gravity_disagreement_ratio: float = 0.8
    #: and share of the mismatch above which the difference may be chance.
    gravity_mismatch_ratio: float = 0.95
    #: Samples over which noise accumulates.
    accumulated_noise_samples: int = 100
    #: Standard deviation with which a gain is searched without leaning on its prior.
    gain_search_std_1: float = 0.3
    #: Standard deviations from which a gain counts,
    gain_min_std: float = 3.5
    #: and its least size.
    gain_min_1: float = 0.01
    #: Largest squat, as a share of the acceleration: 0.46° a m/s².
    max_squat_1: float = 0.08
    #: Relative standard uncertainty of the share of a squat that the speed's own scale makes.
    speed_scale_squat_u: float = 0.25
    #: Slip below 0 by so many standard deviations is a gain, and is fitted again
    negative_slip_std: float = 2.0
    #: with a prior of slip that is narrower by this factor.
    negative_slip_prior_ratio: float = 0.02
    #: Passes in which slip and ground speed are found in turn.
    slip_passes: int = 3
    #: A delay started from an earlier fit that changes by less, in s, has converged.
    delay_tolerance_s: float = 5e-4
    #: Longest delay that is searched, in s.
    longest_delay_s: float = 0.15
    #: Largest slip of a wheel that weighs, as a fraction of its speed.
    max_slip_fraction: float = 0.4
    #: Residuals over the noise of the speed from which wheels and accelerometer are inconsistent.
    max_kinematic_mismatch: float = 3.0

    # force_by_position
    #: Half waves that a force by the place may have on the path.
    path_half_waves: int = 8

    # fuel_on_board
    #: Relative standard uncertainty of a fuel rate of which the machine file says nothing,
    unknown_fuel_rate_u: float = 0.1
    #: and of the density, by season and temperature.
    fuel_density_u: float = 0.01

    # joint_result
    #: Masses in a sum from which the whole covariance is multiplied, which is then faster.
    covariance_masses: int = 256


#: The values in use.
LIMITS: Final = WeighingLimits()
