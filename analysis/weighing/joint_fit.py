"""The joint fit of masses, friction and nuisance terms, iterated in rounds."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from analysis.model.settings import PriorSettings
from analysis.stages.signals.grid_rate import count_rows_in_duration
from analysis.weighing.body_squat import estimate_load_squat
from analysis.weighing.fit_columns import (
    FitColumns,
    FitRows,
    PreviousEstimates,
    RelativeLoads,
    average_and_weight_fit_columns,
)
from analysis.weighing.fit_task import FitTask
from analysis.weighing.force_by_position import PLACE
from analysis.weighing.force_hysteresis import HYSTERESIS, choose_hysteresis_width_and_mean_length
from analysis.weighing.joint_result import JointFit, MotionResponses
from analysis.weighing.load_states import LoadStates
from analysis.weighing.log_effects import MostProbableEffects
from analysis.weighing.low_gears import LOW_GEARS
from analysis.weighing.motion_samples import CachedNoise, ColumnNoiseModel, Floats, MotionSamples
from analysis.weighing.nuisances import NUISANCES, Nuisance
from analysis.weighing.slip_by_load import SLIP_BY_LOAD
from analysis.weighing.swinging_mass import SWINGING_MASS
from analysis.weighing.uneven_ground import GRADE, GROUND, does_load_search_include_ground
from analysis.weighing.weighing_limits import LIMITS
from analysis.weighing.wheel_comparison import (
    compare_wheels_with_accelerometer,
    do_wheels_show_squat,
)
from analysis.weighing.wheel_kinematics import WheelKinematics


@dataclass(frozen=True)
class JointFitInputs:
    """Samples of a log with their noise, priors and wheel comparison.

    Attributes:
        motion: the samples.
        noise: noise of acceleration, speed and force.
        priors: priors of the nuisances.
        kinematics: comparison of wheels and accelerometer, by the measured force; None if absent.
        ground_variance_ratio_1_s: see `PreviousEstimates`.
    """

    motion: MotionSamples
    noise: ColumnNoiseModel
    priors: PriorSettings
    kinematics: WheelKinematics | None
    ground_variance_ratio_1_s: float = 0.0

    @classmethod
    def prepare_from_motion(
        cls,
        motion: MotionSamples,
        noise: ColumnNoiseModel,
        priors: PriorSettings,
        earlier_fit: JointFit | None = None,
    ) -> Self:
        """Inputs of a fit, with a new comparison of wheels and accelerometer.

        An earlier fit gives the variance of the ground force and the springs of the body.
        """
        noise = CachedNoise(noise)
        ground_variance_ratio_1_s = (
            0.0 if earlier_fit is None else earlier_fit.previous_estimates.ground_variance_ratio_1_s
        )
        known = None if earlier_fit is None else earlier_fit.kinematics
        wheels = estimate_wheel_kinematics(motion, noise, priors, known)
        return cls(motion, noise, priors, wheels, ground_variance_ratio_1_s)


def fit_jointly(inputs: JointFitInputs, states: LoadStates | None = None) -> JointFit:
    """Fit over the shortest mean whose uncertainty is nearly the smallest."""
    motion = inputs.motion
    several = states is not None and states.state_count > 1
    ratio_1_s = inputs.ground_variance_ratio_1_s
    # a short log has the ratio once its loads are known
    has_ground = ratio_1_s > 0.0 or does_load_search_include_ground(motion)
    terms = select_terms_of_motion(motion, has_several_loads=several, has_ground=has_ground)
    whole = FitTask(
        motion, inputs.noise, inputs.priors, terms, inputs.kinematics, states, ratio_1_s
    )
    part = whole.cut_to_first_stretches(LIMITS.pilot_stretches)
    part = part if part.motion.has_enough_motion else whole
    longest = (
        int(np.median(np.bincount(motion.stretch_of_sample[motion.is_fittable])))
        / LIMITS.disjoint_means_per_stretch
    )
    means = {count_rows_in_duration(mean_s, motion.rate_hz) for mean_s in LIMITS.means_s}
    means = sorted(means | {*LIMITS.slow_grid_mean_rows} if 1 in means else means)
    lengths = [samples for samples in means if samples <= max(longest, means[0])]
    columns = FitColumns.from_motion(part.motion, inputs.noise, terms, part.initial_estimates)
    first = [
        part.fit_over_sample_means(
            samples,
            LIMITS.pilot_rounds,
            fit_rows=columns.average_and_weight_columns(inputs.noise, samples),
        )
        for samples in lengths
    ]
    # while the lag is mostly uncorrected, the fit may give no mass at all
    first = [
        found
        for found in first
        if found.mass_kg > LIMITS.min_mass_fraction * motion.approximate_mass_kg
    ] or first
    telling = [
        found for found in first if found.solution.noise_share <= LIMITS.max_noise_fraction
    ] or first[-1:]
    least_kg = min(found.u_kg for found in telling)
    # the shortest that is nearly as good: a long mean hides errors of the model
    best = next(
        found for found in telling if not found.u_kg > LIMITS.near_best_std_ratio * least_kg
    )
    whole = copy_task_with_updated_wheel_comparison(inputs, whole, best)
    chosen = fit_delayed_or_low_passed_force(whole, best.samples_per_mean)
    share = _compute_relative_change_by_mean_length(
        first, next(k for k, found in enumerate(first) if found is best)
    )
    transient = count_rows_in_duration(LIMITS.transient_mean_s, motion.rate_hz)
    misfit = chosen.solution.misfit_ratio
    swings = several and motion.by_accelerometer and misfit > LIMITS.max_misfit_ratio
    if swings and transient > best.samples_per_mean:
        # a common misfit of all starts that no term models averages out over a longer mean
        longer = fit_delayed_or_low_passed_force(whole, transient)
        if longer.solution.misfit_ratio < misfit:
            share, chosen = _compute_relative_change_by_mean_length([chosen, longer], 1), longer
    return replace(chosen, averaging_share=share)


def select_terms_of_motion(
    motion: MotionSamples, *, has_several_loads: bool, has_ground: bool
) -> tuple[Nuisance, ...]:
    """Terms that apply to these samples; terms by load only with several loads."""
    ground = (*GROUND, *GRADE) if has_ground else ()
    return tuple(
        term
        for term in (*NUISANCES, SLIP_BY_LOAD, *PLACE, *LOW_GEARS, *SWINGING_MASS, *ground)
        if (has_several_loads or not term.by_load) and term.applies(motion)
    )


def copy_task_with_updated_wheel_comparison(
    inputs: JointFitInputs, task: FitTask, pilot_fit: JointFit
) -> FitTask:
    """Task whose wheels are compared again if a first fit has a lag or load transfer."""
    known = pilot_fit.previous_estimates
    if not (abs(pilot_fit.force_delay_s) > LIMITS.short_lag_s or known.load_transfer_s2_m):
        return task
    # slip depends on the force on the ground at the same instant
    in_time = inputs.motion.advance_force(pilot_fit.force_delay_s)
    acting = replace(in_time, force=known.estimate_ground_force_newtons(in_time))
    wheels = estimate_wheel_kinematics(acting, inputs.noise, inputs.priors, inputs.kinematics)
    return replace(task, kinematics=wheels)


def fit_delayed_or_low_passed_force(task: FitTask, samples_per_mean: int) -> JointFit:
    """Fit all stretches, with the force treated either as delayed or as low-passed."""
    moved = task.fit_over_sample_means(samples_per_mean, LIMITS.lag_rounds)
    if abs(moved.force_delay_s) < LIMITS.short_lag_s:
        return moved
    filtered = task.fit_over_sample_means(samples_per_mean, 2, is_force_advanced=False)
    filters = filtered.solution.residual_rms < moved.solution.residual_rms
    chosen, other = (filtered, moved) if filters else (moved, filtered)
    if not chosen.posterior_fit.misfit.any():
        return chosen
    return replace(chosen, lag_shape_kg=chosen.masses_kg - other.masses_kg)


def estimate_wheel_kinematics(
    motion: MotionSamples,
    noise: ColumnNoiseModel,
    priors: PriorSettings,
    earlier_kinematics: WheelKinematics | None,
) -> WheelKinematics | None:
    """Compare wheels and accelerometer, or take the comparison from a calibration.

    The springs of the body are those of an earlier comparison, if there is one.
    """
    springs = None if earlier_kinematics is None else earlier_kinematics.springs
    found = compare_wheels_with_accelerometer(motion, noise, priors, springs=springs)
    return None if found is None else found.copy_with_learnt_slip_gain_and_delay(priors)


def _compute_relative_change_by_mean_length(
    fits_by_length: list[JointFit], length_index: int
) -> float:
    """Relative effect of the length of the mean on the mass; 0 if it is within the noise."""
    best, longer = fits_by_length[length_index], fits_by_length[length_index + 1 :]
    if best.mass_kg == 0.0:
        return 0.0
    rows = fits_by_length[0].samples_per_mean == 1
    if any(
        do_fit_masses_differ_significantly(best, other, are_means_single_rows=rows)
        for other in longer
    ):
        # uniform distribution between the two
        return (longer[-1].mass_kg / best.mass_kg - 1.0) / float(np.sqrt(3.0))
    if (
        not longer
        and length_index
        and do_fit_masses_differ_significantly(
            best, fits_by_length[length_index - 1], are_means_single_rows=rows
        )
    ):
        # the longest can only be compared with a shorter one, and may be as wrong as that
        return 1.0 - fits_by_length[length_index - 1].mass_kg / best.mass_kg
    return LIMITS.slow_grid_hidden_1_s / best.motion.rate_hz if rows else 0.0


def do_fit_masses_differ_significantly(
    fit_a: JointFit, fit_b: JointFit, *, are_means_single_rows: bool
) -> bool:
    """Whether means of two lengths give significantly different masses.

    For means of a single row every relevant difference counts, even if noise explains it.
    """
    difference_kg = abs(fit_a.mass_kg - fit_b.mass_kg)
    if are_means_single_rows:
        return difference_kg > LIMITS.slow_grid_mean_length_fraction * abs(fit_a.mass_kg)
    first, second = fit_a.u_kg, fit_b.u_kg
    expected_kg = float(np.sqrt(max(abs(first**2 - second**2), min(first, second) ** 2 / 4.0)))
    return difference_kg > max(
        LIMITS.mean_length_std * expected_kg, LIMITS.mean_length_fraction * abs(fit_a.mass_kg)
    )


def refit_with_extra_terms(
    earlier_fit: JointFit,
    noise: ColumnNoiseModel,
    priors: PriorSettings,
    extra_terms: tuple[Nuisance, ...] = (),
    rounds: int = 1,
    fit_rows: FitRows | None = None,
) -> JointFit:
    """Fit the same samples with other priors or additional terms.

    Effects that the log is unlikely to have stay excluded.

    Args:
        earlier_fit: the earlier fit.
        noise: noise of acceleration, speed and force.
        priors: priors of the nuisances.
        extra_terms: terms to add after the others.
        rounds: maximum number of rounds.
        fit_rows: `make_refit_rows` of the earlier fit, with at least these terms, if already
            computed.
    """
    if earlier_fit.effects is not None:
        priors = earlier_fit.effects.copy_priors_excluding_unlikely_effects(priors)
    terms = (*earlier_fit.terms, *extra_terms)
    task = FitTask(
        earlier_fit.motion, noise, priors, terms, earlier_fit.kinematics, earlier_fit.states
    )
    fit_rows = fit_rows and fit_rows.select_terms(terms)
    fitted = task.fit_over_sample_means(
        earlier_fit.samples_per_mean,
        rounds,
        is_force_advanced=earlier_fit.is_force_advanced_by_lag,
        initial_fit=earlier_fit,
        fit_rows=fit_rows,
    )
    if fitted.mass_count != earlier_fit.mass_count:
        # the result holds for other loads
        return fitted
    return replace(
        fitted,
        lag_shape_kg=earlier_fit.lag_shape_kg,
        averaging_share=earlier_fit.averaging_share,
        effects=earlier_fit.effects,
        squat=earlier_fit.squat,
        hysteresis_kg=earlier_fit.hysteresis_kg,
    )


def make_refit_rows(
    earlier_fit: JointFit, noise: ColumnNoiseModel, extra_terms: tuple[Nuisance, ...] = ()
) -> FitRows:
    """Rows of the first round of a refit from `earlier_fit`, with additional terms if any."""
    terms = (*earlier_fit.terms, *extra_terms)
    return average_and_weight_fit_columns(
        earlier_fit.motion,
        noise,
        terms,
        earlier_fit.samples_per_mean,
        earlier_fit.previous_estimates,
    )


def refit_without_unlikely_effects(
    fit: JointFit, noise: ColumnNoiseModel, priors: PriorSettings
) -> JointFit:
    """Refit without the effects that the log is unlikely to have."""
    likely = MostProbableEffects.from_fit(
        fit.posterior_fit, fit.mass_count, fit.terms, fit.prior_std
    )
    fit = replace(fit, effects=likely)
    return (
        refit_with_extra_terms(fit, noise, priors, rounds=2) if likely and likely.left_out else fit
    )


def refit_with_hysteresis_if_significant(
    fit: JointFit,
    noise: ColumnNoiseModel,
    priors: PriorSettings,
    terms_of_checks: tuple[Nuisance, ...],
) -> tuple[JointFit, FitRows]:
    """Add hysteresis of the force if the log shows it or the priors expect it.

    Args:
        fit: the fit without hysteresis.
        noise: noise of acceleration, speed and force.
        priors: priors of the nuisances.
        terms_of_checks: terms that later refits add.

    Returns:
        The fit, and its rows by `make_refit_rows` with the terms of the checks.
    """
    fit.solution.compute_uncertainty_and_release_samples()
    play = choose_hysteresis_width_and_mean_length(fit.motion, noise, fit.samples_per_mean)
    played = replace(fit, previous_estimates=replace(fit.previous_estimates, play=play))
    rows = make_refit_rows(played, noise, (*terms_of_checks, HYSTERESIS))
    tested = refit_with_extra_terms(fit, noise, priors, (HYSTERESIS,), fit_rows=rows)
    half_width_N = float(tested.theta[-1])
    # the standard deviation takes longer than the estimate
    shown = (
        half_width_N > LIMITS.hysteresis_min_share * fit.motion.force_95_percentile_newtons
        and (
            half_width_N
            > LIMITS.hysteresis_min_std * float(tested.posterior_fit.parameter_stds[-1])
        )
    )
    if not (shown or priors.hysteresis_share):
        return fit, rows
    looped = refit_with_extra_terms(played, noise, priors, (HYSTERESIS,), rounds=2)
    if looped.mass_count != fit.mass_count or not np.isfinite(looped.theta).all():
        return fit, rows
    looped = replace(looped, hysteresis_kg=looped.masses_kg - fit.masses_kg)
    return looped, make_refit_rows(looped, noise, terms_of_checks)


def refit_with_gain_change_by_load(fit: JointFit, priors: PriorSettings) -> JointFit:
    """Add a change of the accelerometer's gain with the load, if the motion shows one."""
    wheels, loads, states = fit.kinematics, fit.previous_estimates.relative_loads, fit.states
    if wheels is None or loads is None or states is None:
        return fit
    squats = wheels.squat[0] > 0.0 or do_wheels_show_squat(wheels, fit.motion)
    told = fit.motion.without_gravity is None or squats
    if not (fit.motion.by_accelerometer and told):
        return fit
    first = np.unique(states.state_of_manoeuvre, return_index=True)[1]
    route = fit.previous_estimates.route
    for _ in range(LIMITS.squat_rounds):
        squat = estimate_load_squat(
            fit.motion, wheels, loads, loads.value[first], priors.gain_by_load, route
        )
        fit = replace(fit, squat=squat)
        # an uncorrected squat changes the relative loads
        shares = loads.weight_shares
        loads = (
            RelativeLoads.from_masses(
                states.manoeuvre_ids, fit.masses_kg[states.state_of_manoeuvre], shares
            )
            or loads
        )
    return fit


def add_mass_responses_to_motion_errors(
    fit: JointFit, noise: ColumnNoiseModel, priors: PriorSettings
) -> JointFit:
    """Compute the masses' responses to errors of the motion by a refit with each error."""
    if fit.kinematics is None or not fit.motion.by_accelerometer:
        return fit
    known, count = fit.previous_estimates, fit.mass_count

    def compute_mass_response(changed_estimates: PreviousEstimates, step: float) -> Floats:
        changed_fit = replace(fit, previous_estimates=changed_estimates)
        other = refit_with_extra_terms(changed_fit, noise, priors)
        return (other.theta[:count] - fit.theta[:count]) / step

    later = replace(known, speed_delay_s=known.speed_delay_s + LIMITS.probe_delay_s)
    larger = replace(known, motion_gain=known.motion_gain + LIMITS.probe_gain_1)
    swing, swung = known.swing, np.zeros(count)
    if swing.lever_s2:
        farther = replace(swing, lever_s2=swing.lever_s2 + swing.u_s2)
        swung = compute_mass_response(replace(known, swing=farther), 1.0)
    responses = MotionResponses(
        compute_mass_response(later, LIMITS.probe_delay_s),
        compute_mass_response(larger, LIMITS.probe_gain_1),
        swung,
    )
    return replace(fit, motion_responses=responses)
