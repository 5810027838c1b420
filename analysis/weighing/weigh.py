"""Weigh a log: the joint fit, its sensitivity to the priors, and the checks by refits."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np
import polars as pl

from analysis.model.axes import X
from analysis.model.machine import Machine
from analysis.model.prior_settings import LearntTerm, PriorSettings
from analysis.stages.noise.column_noise import ColumnNoise, DerivativeNoise
from analysis.stages.signals.grid_rate import count_rows_in_duration
from analysis.stages.signals.signal_limits import LIMITS as SIGNAL_LIMITS
from analysis.weighing.braking_comparison import compare_masses_with_and_without_braking
from analysis.weighing.empty_mass_drift import EmptyMassDrift, estimate_empty_mass_drift
from analysis.weighing.fitted_stretches import (
    count_runs_so_far,
    count_standstills_so_far,
    mark_slow_parts_of_drives,
)
from analysis.weighing.gain_by_direction import (
    DirectionGain,
    estimate_force_gain_by_driving_direction,
)
from analysis.weighing.growing_load import (
    LoadChangeInMotion,
    LoadGrowthAtEveryStart,
    find_creeping_load_changes,
    find_manoeuvres_with_growing_load,
    refit_with_load_growing_at_starts,
)
from analysis.weighing.joint_fit import (
    JointFitInputs,
    add_mass_responses_to_motion_errors,
    fit_jointly,
    refit_with_extra_terms,
    refit_with_gain_change_by_load,
    refit_with_hysteresis_if_significant,
    refit_without_unlikely_effects,
)
from analysis.weighing.joint_result import JointFit, find_term_index
from analysis.weighing.load_limits import LIMITS as LOAD_LIMITS
from analysis.weighing.load_search import (
    fit_with_searched_load_states,
    is_single_load_excluded,
    refit_short_log_with_ground,
)
from analysis.weighing.missing_terms import (
    ForceCurvature,
    MissingTerm,
    estimate_force_curvature,
    find_missing_terms,
    list_scaled_terms_absent_from_model,
)
from analysis.weighing.motion_samples import (
    Bools,
    ColumnNoiseModel,
    Floats,
    Ints,
    MotionSamples,
    collect_motion_samples,
)
from analysis.weighing.nuisances import (
    CURVATURE,
    FILLING,
    compute_friction_prior_std_of_motion_newtons,
)
from analysis.weighing.other_motion import (
    AlternativeMotion,
    compute_wheel_imu_disagreement_over_speed,
    refit_with_acceleration_of_other_sensor,
)
from analysis.weighing.record_places import align_paths_of_bench_records
from analysis.weighing.swinging_mass import SwingingMass, find_swinging_mass
from analysis.weighing.weighing_limits import LIMITS
from analysis.weighing.wheel_kinematics import TERMS
from estimators.threads import return_freed_memory_to_os

#: Why a log has no answer if no manoeuvre could be fitted.
NOTHING_FITTED: Final = "no manoeuvre of this log was informative enough"


@dataclass(frozen=True)
class Weighing:
    """The weighing of a log by its joint fit.

    Attributes:
        fit: joint fit of the answer.
        halved_kg: (masses,) masses with prior standard deviations halved.
        doubled_kg: (masses,) masses with prior standard deviations doubled.
        braking_kg: change of the mass if braking is fitted, or that of one load that contradicts
            driving; NaN if braking does not count as driving.
        braking_left_out: whether braking contradicts driving and is left out.
        braking_doubted: whether braking changes the mass by more than its uncertainty, but a fit of
            driving alone is too poor to contradict it.
        curvature: test of a term in a·|a|.
        filling: test for a load that grows equally at every start, from this log alone.
        growing_load_manoeuvres: manoeuvres whose load changes in motion; they are not fitted.
        missing_terms: significant terms that the model lacks, the largest effect first.
        by_direction: gain of the force by direction with which a single load explains the log; None
            if there is none, or if the log distinguishes its loads from such a gain.
        other_motion: change of the mass with the other acceleration, if wheels and accelerometer
            disagree by more than the settings allow.
        fit_without_learnt_priors_or_none: the fit without learnt priors; None if no prior was
            learnt, so that it is `fit`.
        fit_with_wide_learnt_priors: the fit with learnt priors widened by the uncertainty of their
            means; None if no prior was learnt.
        learnt: priors learnt by a calibration.
        swinging_mass: mass that swings relative to the machine, if the log shows one.
    """

    fit: JointFit
    halved_kg: Floats
    doubled_kg: Floats
    braking_kg: float
    braking_left_out: bool
    braking_doubted: bool
    curvature: ForceCurvature
    filling: LoadGrowthAtEveryStart
    growing_load_manoeuvres: tuple[LoadChangeInMotion, ...]
    missing_terms: tuple[MissingTerm, ...] = ()
    by_direction: DirectionGain | None = None
    other_motion: AlternativeMotion | None = None
    fit_without_learnt_priors_or_none: JointFit | None = None
    fit_with_wide_learnt_priors: JointFit | None = None
    learnt: Mapping[str, LearntTerm] = field(default_factory=dict[str, LearntTerm])
    swinging_mass: SwingingMass | None = None

    @property
    def has_corrected_learnt_means(self) -> bool:
        """Whether the answer's fit already corrects the errors of learnt means."""
        return self.fit_with_wide_learnt_priors is self.fit

    @cached_property
    def significant_empty_mass_drift(self) -> EmptyMassDrift | None:
        """Drift of the empty machine's mass; None if it is not significant."""
        found = estimate_empty_mass_drift(self.fit)
        return found if found is not None and found.is_significant else None

    @property
    def fit_without_learnt_priors(self) -> JointFit:
        """The fit of this log alone, without priors learnt by a calibration."""
        return self.fit_without_learnt_priors_or_none or self.fit

    @property
    def viscous_friction_t_value(self) -> float:
        """Viscous friction over its standard deviation; 0 if friction is only slightly negative."""
        value, std = self.fit.viscous_friction_and_std
        motion = self.fit.motion
        share = value * motion.speed_95_percentile_m_s / motion.force_95_percentile_newtons
        return value / std if share < -LIMITS.falling_friction_1 else max(value / std, 0.0)

    @property
    def relative_mass_change_by_braking(self) -> float:
        """Magnitude of the mass change if braking is fitted, as a fraction of the mass."""
        return abs(self.braking_kg) / abs(self.fit.mass_kg)

    @property
    def manoeuvre_scatter_over_noise(self) -> float:
        """Scatter of manoeuvres over that explained by their noise; NaN without load states."""
        return np.nan if self.fit.states is None else self.fit.states.birge_ratio


def find_term_farthest_from_prior(fit: JointFit, priors: PriorSettings) -> tuple[str, float]:
    """The term farthest from its prior mean, and its distance in prior standard deviations.

    If all driving is in one direction, rolling resistance is part of the constant force, and its
    prior is added to that of the force: soft ground resists with 5 % of the weight. A calibration
    has learnt both together.
    """
    widths = fit.prior_std.copy()
    if not fit.motion.drives_both_ways and "const" not in priors.learnt:
        constant = find_term_index("const", fit.terms)
        friction_N = compute_friction_prior_std_of_motion_newtons(fit.motion, priors)
        widths[constant] = np.hypot(widths[constant], friction_N)
    return fit.find_term_farthest_from_prior(widths)


def weigh(
    aligned: pl.DataFrame,
    excitation: pl.DataFrame,
    gated: pl.DataFrame,
    noise: pl.DataFrame,
    machine: Machine,
) -> Weighing | None:
    """Fit the manoeuvres that the gate found informative; None if there are too few samples.

    Args:
        aligned: grid before the moving mean, with `left_out` for excluded rows.
        excitation: frame with the phases of motion.
        gated: frame with the accepted windows.
        noise: noise of the columns.
        machine: machine file with wheels, settings and priors.
    """
    priors = machine.settings.priors
    if priors.learnt and priors.learnt_means == "told":
        # wrong means spoil a log of several loads, which determines them better itself
        found = _weigh_with_priors(
            aligned, excitation, gated, noise, machine, priors.copy_widened_by_learnt_mean_u(TERMS)
        )
        if found is not None and found.fit.mass_count > 1:
            return replace(found, fit_with_wide_learnt_priors=found.fit, learnt={**priors.learnt})
    return _weigh_with_priors(aligned, excitation, gated, noise, machine, priors)


@dataclass(frozen=True)
class _MotionSource:
    """Frames of a log, of which the motion that is fitted is selected.

    `stops` (n,) counts earlier stops; `slow` (n,) flags where a load may change on the move, if so.
    `swinging_mass` is a mass that swings relative to the machine, if the log shows one.
    """

    aligned: pl.DataFrame
    excitation: pl.DataFrame
    gated: pl.DataFrame
    machine: Machine
    noise: ColumnNoiseModel
    stops: Ints
    slow: Bools | None = None
    swinging_mass: SwingingMass | None = None

    def select_motion(self, *, includes_braking: bool) -> MotionSamples:
        """Motion with or without braking, where braking counts as driving."""
        data = self.aligned, self.excitation, self.gated, self.machine, self.noise
        stops = self.stops if self.slow is None else self.stops + count_runs_so_far(self.slow)
        found = collect_motion_samples(*data, stops, includes_braking=includes_braking)
        if self.swinging_mass is not None:
            found = self.swinging_mass.add_swing_to_motion(found)
        return align_paths_of_bench_records(
            found if self.slow is None else found.exclude_samples(self.slow)
        )


def _weigh_with_priors(
    aligned: pl.DataFrame,
    excitation: pl.DataFrame,
    gated: pl.DataFrame,
    noise: pl.DataFrame,
    machine: Machine,
    priors: PriorSettings,
) -> Weighing | None:
    """Weigh with the given priors instead of the machine's."""
    settings = machine.settings
    known = ColumnNoise.select_axis_noise(X, noise, settings.noise)
    if known is None or excitation.height < SIGNAL_LIMITS.window_min_readings:
        return None
    rate_hz, repeatability_kg = settings.align.rate_hz, machine.machine.repeatability_kg
    columns = DerivativeNoise(known, rate_hz) if machine.differentiates_speed else known
    source = _MotionSource(
        aligned, excitation, gated, machine, columns, count_standstills_so_far(excitation)
    )

    def fit_load_states(motion: MotionSamples, start: JointFit | None = None) -> JointFit:
        fitted = JointFitInputs.prepare_from_motion(motion, columns, priors, start)
        states = (
            None
            if start is None or start.states is None
            else start.states.reassign_to_manoeuvres_of_motion(motion)
        )
        return fit_with_searched_load_states(fit_jointly(fitted, states), fitted, repeatability_kg)

    started = _fit_and_choose_where_loads_change(source, fit_load_states)
    if started is None:
        return None
    source, whole, fit = started
    excluded = find_creeping_load_changes(fit).tolist()
    if excluded:
        whole = _exclude_manoeuvres(whole, excluded)
        fit = fit_load_states(whole, fit)
    grown = find_manoeuvres_with_growing_load(fit, columns)
    if grown:
        # a manoeuvre with a changing load has no single mass, and would bias the friction
        excluded += [each.manoeuvre_id for each in grown]
        fit = fit_load_states(_exclude_manoeuvres(whole, excluded), fit)
        # tested again with the friction and drifts estimated from the other manoeuvres
        again = find_manoeuvres_with_growing_load(fit, columns, whole)
        better = {each.manoeuvre_id: each for each in again}
        grown = tuple(better.get(each.manoeuvre_id, each) for each in grown)
    fit = refit_short_log_with_ground(fit, columns, priors, repeatability_kg)
    braking_kg, left_out = float("nan"), False
    # starts alone do not separate a swinging mass from the mass
    if not settings.gate.exclude_braking and source.swinging_mass is None:
        driving = _exclude_manoeuvres(source.select_motion(includes_braking=False), excluded)
        if _has_enough_samples(driving):
            fitted = JointFitInputs.prepare_from_motion(driving, columns, priors, fit)
            states = fit.states and fit.states.reassign_to_manoeuvres_of_motion(driving)
            alone = fit_jointly(fitted, states)
            # driving that its own model does not fit cannot contradict braking
            _, widths = find_term_farthest_from_prior(alone, priors)
            beyond = widths > settings.verdict.beyond_prior_max
            if not beyond and not estimate_force_curvature(alone, columns, priors).is_significant:
                braking_kg, left_out = compare_masses_with_and_without_braking(fit, alone)
                if left_out:
                    fit = fit_with_searched_load_states(alone, fitted, repeatability_kg)
                    fit = refit_short_log_with_ground(fit, columns, priors, repeatability_kg)
    doubted = not left_out and abs(braking_kg) > LIMITS.braking_doubted_u * fit.u_kg
    fit = refit_without_unlikely_effects(fit, columns, priors)
    candidates = list_scaled_terms_absent_from_model(fit)
    fit, rows = refit_with_hysteresis_if_significant(
        fit, columns, priors, (CURVATURE, FILLING, *candidates)
    )
    fit = refit_with_gain_change_by_load(fit, priors)
    fit = add_mass_responses_to_motion_errors(fit, columns, priors)
    return_freed_memory_to_os()  # the rows of its refits were as large as those below
    if fit.mass_kg == 0.0:  # the force is 0 wherever the machine accelerates
        return None
    alone = refit_without_learnt_priors(fit, columns, priors)
    own, own_priors = (fit, priors) if alone is None else (alone, priors.copy_without_learnt())
    halved_kg, doubled_kg = (
        refit_with_extra_terms(
            fit, columns, priors.copy_with_multiplied_stds(factor), fit_rows=rows
        ).masses_kg
        for factor in (0.5, 2.0)
    )
    return Weighing(
        fit,
        halved_kg,
        doubled_kg,
        braking_kg,
        left_out,
        doubted,
        estimate_force_curvature(fit, columns, priors, rows),
        replace(
            refit_with_load_growing_at_starts(
                own, columns, own_priors, rows if own is fit else None
            ),
            is_possible=machine.machine.digs,
        ),
        grown,
        find_missing_terms(fit, candidates, columns, priors, rows),
        estimate_force_gain_by_driving_direction(fit, columns, priors, machine.machine),
        refit_with_acceleration_of_other_sensor(fit, columns, priors)
        if compute_wheel_imu_disagreement_over_speed(fit) > settings.verdict.wheels_max
        else None,
        alone,
        None
        if alone is None
        else refit_with_extra_terms(
            fit,
            columns,
            priors.copy_widened_by_learnt_mean_u(TERMS),
            rounds=LIMITS.learnt_mean_rounds,
        ),
        {**priors.learnt},
        source.swinging_mass,
    )


def _fit_and_choose_where_loads_change(
    source: _MotionSource, fit_load_states: Callable[[MotionSamples], JointFit]
) -> tuple[_MotionSource, MotionSamples, JointFit] | None:
    """Fit the motion, with loads that change on the move if that excludes a single load."""
    whole = source.select_motion(includes_braking=True)
    if not _has_enough_samples(whole):
        return None
    if (swinging_mass := find_swinging_mass(whole)) is not None:
        source = replace(source, swinging_mass=swinging_mass)
        whole = swinging_mass.add_swing_to_motion(whole)
    fit = fit_load_states(whole)
    is_one = fit.mass_count == 1 and not whole.has_single_load
    if is_one and (slow := mark_slow_parts_of_drives(whole.speed, source.stops)).any():
        on_the_move = replace(source, slow=slow, swinging_mass=None)
        moving = on_the_move.select_motion(includes_braking=True)
        if _has_enough_samples(moving):
            tried = fit_load_states(moving)
            if is_single_load_excluded(tried, LOAD_LIMITS.on_the_move_max_single_probability):
                return on_the_move, moving, tried
    return source, whole, fit


def _has_enough_samples(motion: MotionSamples) -> bool:
    """Whether enough samples may be fitted."""
    fewest = count_rows_in_duration(
        LIMITS.shortest_log_s, motion.rate_hz, SIGNAL_LIMITS.window_min_readings
    )
    return int(motion.is_fittable.sum()) >= fewest and motion.has_enough_motion


def _exclude_manoeuvres(motion: MotionSamples, excluded_manoeuvres: Sequence[int]) -> MotionSamples:
    """Exclude the manoeuvres with these numbers from the fit."""
    return motion.exclude_samples(np.isin(motion.manoeuvre_of_sample, excluded_manoeuvres))


def refit_without_learnt_priors(
    fit: JointFit, noise: ColumnNoiseModel, priors: PriorSettings
) -> JointFit | None:
    """Refit without learnt priors; None if no prior was learnt."""
    if not priors.learnt:
        return None
    wheels = fit.kinematics
    own = (
        fit
        if wheels is None or wheels.estimates_of_this_log is None
        else replace(fit, kinematics=wheels.estimates_of_this_log)
    )
    return refit_with_extra_terms(own, noise, priors.copy_without_learnt())
