"""Search for load states: find the states and fit their masses in turn until both are stable."""

from dataclasses import dataclass, field, replace
from typing import NamedTuple, Self

import numpy as np

from analysis.model.prior_settings import PriorSettings
from analysis.stages.signals.grid_rate import count_rows_in_duration
from analysis.weighing.fit_columns import FitRows, compute_samples_between_fitted_means
from analysis.weighing.fit_task import FitTask
from analysis.weighing.haul_route import number_recurrent_stops, propose_hauling_partitions
from analysis.weighing.joint_fit import (
    JointFitInputs,
    fit_jointly,
    make_refit_rows,
    refit_with_extra_terms,
    select_terms_of_motion,
)
from analysis.weighing.joint_result import JointFit
from analysis.weighing.load_changes import (
    classify_load_change_evidence,
    find_manoeuvre_of_stretches,
)
from analysis.weighing.load_limits import LIMITS as LOAD_LIMITS
from analysis.weighing.load_states import (
    AlternativePartition,
    LoadStates,
    find_load_states,
    make_single_unknown_state,
    make_states_of_partition,
)
from analysis.weighing.motion_samples import ColumnNoiseModel, Ints
from analysis.weighing.record_places import make_load_search_rows
from analysis.weighing.uneven_ground import does_load_search_include_ground
from analysis.weighing.weighing_limits import LIMITS
from estimators.joint.unit_levels import HINTED, UnitLevels
from estimators.numerics.autocorrelation import estimate_pooled_autocorrelation
from estimators.threads import return_freed_memory_to_os


def fit_with_searched_load_states(
    first_fit: JointFit, inputs: JointFitInputs, repeatability_kg: float | None
) -> JointFit:
    """Find load states and fit a mass for each, iterating until the states are stable.

    The search models ground that changes along the route for several loads only; in a fit of one
    load, such ground scatters the masses more than loads do. Besides, loads that follow the driving
    direction look like a haul and its return. Therefore a poor fit is searched again, starting from
    loads that change where there is evidence of it, and from those that the driving pattern
    suggests. The fit with the smallest Akaike criterion is returned; the compared fit of a single
    load also models the ground along the route.
    """
    kind = classify_load_change_evidence(first_fit.motion)
    if few := not does_load_search_include_ground(first_fit.motion):
        inputs = replace(inputs, ground_variance_ratio_1_s=0.0)
    settled = search_states_and_refit_until_stable(first_fit, inputs, repeatability_kg, kind)
    misfits = settled.solution.misfit_ratio > LIMITS.max_misfit_ratio
    if first_fit.motion.has_single_load or not misfits or few:
        return settled
    inputs = add_ground_force_variance(first_fit, inputs)
    # with short means the residual is noise and transients, which loads do not explain
    transient = count_rows_in_duration(LIMITS.transient_mean_s, first_fit.motion.rate_hz)
    samples = max(first_fit.samples_per_mean, settled.samples_per_mean, transient)
    alike = _PartitionComparison.from_fit(first_fit, inputs, samples)
    fits = list[JointFit]()
    hints = np.append(0, np.cumsum(kind > 1))
    if hints[-1] and not _is_partition_of_fit(settled, hints):
        held = _refit_with_fixed_load_states(alike.make_load_states(hints), inputs)
        fits.append(
            search_states_and_refit_until_stable(held, inputs, repeatability_kg, kind, settled)
        )
    hauls = propose_hauling_partitions(first_fit.motion)
    if hauls:
        haul = min(hauls, key=alike.compute_akaike_criterion)
        kind = np.where(np.diff(haul) > 0, np.maximum(kind, HINTED), kind)
        held = _refit_with_fixed_load_states(alike.make_load_states(haul), inputs)
        hidden = search_states_and_refit_until_stable(held, inputs, repeatability_kg, kind, settled)
        fits += [
            hidden,
            _refit_with_scatter_estimated_from_states(held, inputs, repeatability_kg, kind),
        ]
    likely = [settled, *(each for each in fits if is_single_load_excluded(each))]
    if settled.mass_count == 1 and len(likely) == 1:
        return settled
    best = min(
        likely,
        key=lambda each: alike.compute_akaike_criterion(
            _require_load_states(each).state_of_manoeuvre
        ),
    )
    if best.mass_count == 1:
        return best
    return alike.fit_single_load_if_likeliest() or best


def is_single_load_excluded(
    fit: JointFit, max_probability: float = LOAD_LIMITS.hidden_loads_max_single_probability
) -> bool:
    """Whether a single load has a probability below the given one in this log."""
    return fit.mass_count > 1 and _require_load_states(fit).single_probability < max_probability


class _AkaikeCriteria(NamedTuple):
    """Akaike criteria of a partition, and of a single load with the same uneven ground."""

    partition: float
    single_load: float


@dataclass(frozen=True)
class _PartitionComparison:
    """Comparison of partitions of one log into loads, by fits over means of the same length.

    Attributes:
        task: the fit without load states.
        manoeuvre_masses: mass estimate of each manoeuvre by itself.
        number: (manoeuvres,) numbers of the manoeuvres.
        samples: length of the means.
        known: criteria of each partition already fitted, by the bytes of its array.
    """

    task: FitTask
    manoeuvre_masses: UnitLevels
    number: Ints
    samples: int
    known: dict[bytes, _AkaikeCriteria] = field(default_factory=dict[bytes, _AkaikeCriteria])

    @classmethod
    def from_fit(cls, earlier_fit: JointFit, inputs: JointFitInputs, samples_per_mean: int) -> Self:
        """Comparison of an earlier fit's manoeuvres, over means of `samples_per_mean`."""
        motion, ratio_1_s = earlier_fit.motion, inputs.ground_variance_ratio_1_s
        terms = select_terms_of_motion(motion, has_several_loads=True, has_ground=True)
        task = FitTask(
            motion, inputs.noise, inputs.priors, terms, inputs.kinematics, None, ratio_1_s
        )
        number = np.unique(find_manoeuvre_of_stretches(motion))
        return cls(
            task,
            _estimate_manoeuvre_mass_levels(
                earlier_fit, inputs, classify_load_change_evidence(motion)
            ),
            number,
            samples_per_mean,
        )

    def make_load_states(self, state_of_manoeuvre: Ints) -> LoadStates:
        """Load states of a partition, given the state of each manoeuvre, (manoeuvres,)."""
        return make_states_of_partition(self.manoeuvre_masses, self.number, state_of_manoeuvre)

    def compute_akaike_criterion(self, state_of_manoeuvre: Ints) -> float:
        """Akaike information criterion (1974) of a partition; infinite if its fit fails."""
        key = np.ascontiguousarray(state_of_manoeuvre, np.int64).tobytes()
        if key not in self.known:
            self.known[key] = self._fit_and_score_by_akaike(state_of_manoeuvre)
        return self.known[key].partition

    def fit_single_load_if_likeliest(self) -> JointFit | None:
        """Fit of a single load on uneven ground, if it is as likely as the likeliest loads.

        Since neither fit explains the residual, those loads remain as probable.
        """
        single = min(self.known, key=lambda each: self.known[each].single_load)
        several = min(self.known, key=lambda each: self.known[each].partition)
        advantage = self.known[single].single_load - self.known[several].partition
        # if no fit succeeded, the difference is not a number
        if not advantage <= LOAD_LIMITS.min_criterion_gain_of_loads * self.number.size:
            return None
        state_of_manoeuvre = np.frombuffer(several, np.int64)
        loads_kg = self._fit_partition(state_of_manoeuvre).masses_kg[state_of_manoeuvre]
        fit = self._fit_single_load(self._fit_partition(np.frombuffer(single, np.int64)))
        states = make_states_of_partition(
            self.manoeuvre_masses, self.number, np.zeros_like(self.number), usual_scatter=False
        )
        probability = LOAD_LIMITS.single_or_several_probability
        doubted = AlternativePartition(
            state_of_manoeuvre, loads_kg - fit.masses_kg, 0.0, 1.0 - probability
        )
        states = replace(states, single_probability=probability, alternative_partition=doubted)
        return refit_with_extra_terms(
            replace(fit, states=states), self.task.noise, self.task.priors
        )

    def _fit_and_score_by_akaike(self, state_of_manoeuvre: Ints) -> _AkaikeCriteria:
        fitted = self._fit_partition(state_of_manoeuvre)
        if not np.isfinite(fitted.theta).all():
            return _AkaikeCriteria(np.inf, np.inf)
        return _AkaikeCriteria(
            self._score_by_akaike(fitted), self._score_by_akaike(self._fit_single_load(fitted))
        )

    def _fit_partition(self, state_of_manoeuvre: Ints) -> JointFit:
        states = self.make_load_states(state_of_manoeuvre)
        return replace(self.task, states=states).fit_over_sample_means(self.samples, 2)

    def _fit_single_load(self, fit: JointFit) -> JointFit:
        """Fit a single load with the ground columns of another fit."""
        return self.task.fit_over_sample_means(self.samples, 1, initial_fit=fit)

    def _score_by_akaike(self, fit: JointFit) -> float:
        independent = LOAD_LIMITS.independent_residuals * self.number.size
        return independent * float(np.log(fit.solution.residual_rms**2)) + 2.0 * fit.mass_count


def _refit_with_fixed_load_states(states: LoadStates, inputs: JointFitInputs) -> JointFit:
    """Refit with fixed states a few times, so that the ground terms by load converge."""
    found = fit_jointly(inputs, states)
    for _ in range(1, LIMITS.held_rounds):
        if not np.isfinite(found.theta).all():
            break
        manoeuvre_masses = _estimate_manoeuvre_mass_levels(
            found, inputs, classify_load_change_evidence(found.motion)
        )
        found = fit_jointly(
            inputs,
            make_states_of_partition(
                manoeuvre_masses, states.manoeuvre_ids, states.state_of_manoeuvre
            ),
        )
    return found


def _refit_with_scatter_estimated_from_states(
    fit: JointFit,
    inputs: JointFitInputs,
    repeatability_kg: float | None,
    change_kinds: Ints,
    searched_states: LoadStates | None = None,
) -> JointFit:
    """Refit the same states with the scatter about them, unless it is stated.

    The probability of a single load is estimated from them too, unless `searched_states` has it.
    """
    if not np.isfinite(fit.theta).all():
        return fit
    masses = _estimate_manoeuvre_mass_levels(fit, inputs, change_kinds)
    states = _require_load_states(fit)
    numbers, partition = states.manoeuvre_ids, states.state_of_manoeuvre
    found = make_states_of_partition(masses, numbers, partition, usual_scatter=False)
    if repeatability_kg is not None:
        found = found.copy_with_stated_scatter(repeatability_kg)
    if searched_states is None:
        likeliest = find_load_states(masses, numbers, repeatability_kg)
        states = replace(found, single_probability=likeliest.single_probability)
    else:
        # masses of manoeuvres stay those of the search: with the ground's prior none would drift
        states = replace(
            searched_states,
            scatter_kg=found.scatter_kg,
            degrees_of_freedom=found.degrees_of_freedom,
            assumes_scatter=found.assumes_scatter,
        )
    fit = replace(fit, states=states)
    return refit_with_extra_terms(fit, inputs.noise, inputs.priors, rounds=2)


def refit_short_log_with_ground(
    fit: JointFit, noise: ColumnNoiseModel, priors: PriorSettings, repeatability_kg: float | None
) -> JointFit:
    """Refit a log of several loads with the ground, if they were searched without it.

    The partition and its alternative stay, with the differences computed without the ground. A fit
    that fails with the ground stays as it is.
    """
    ratio_1_s = fit.previous_estimates.ground_variance_ratio_1_s
    has_ground = ratio_1_s > 0.0 or does_load_search_include_ground(fit.motion)
    if fit.mass_count == 1 or has_ground or not np.isfinite(fit.theta).all():
        return fit
    kind, states = classify_load_change_evidence(fit.motion), _require_load_states(fit)
    inputs = JointFitInputs.prepare_from_motion(fit.motion, noise, priors, fit)
    inputs = add_ground_force_variance(fit, inputs)
    held = _refit_with_fixed_load_states(states, inputs)
    found = _refit_with_scatter_estimated_from_states(held, inputs, repeatability_kg, kind, states)
    return found if np.isfinite(found.theta).all() else fit


def _estimate_manoeuvre_mass_levels(
    fit: JointFit, inputs: JointFitInputs, change_kinds: Ints, fit_rows: FitRows | None = None
) -> UnitLevels:
    """Mass estimates of each manoeuvre by a fit, with the kinds and places of the stops between."""
    rows = make_refit_rows(fit, inputs.noise) if fit_rows is None else fit_rows
    manoeuvre_masses = _rebuild_task_of_fit(fit, inputs).estimate_manoeuvre_masses(fit, rows)
    return replace(manoeuvre_masses, kind=change_kinds, place=number_recurrent_stops(fit.motion))


def _rebuild_task_of_fit(fit: JointFit, inputs: JointFitInputs) -> FitTask:
    """The task that produced a fit."""
    return FitTask(fit.motion, inputs.noise, inputs.priors, fit.terms, fit.kinematics, fit.states)


def search_states_and_refit_until_stable(
    first_fit: JointFit,
    inputs: JointFitInputs,
    repeatability_kg: float | None,
    change_kinds: Ints,
    fit_with_final_columns: JointFit | None = None,
) -> JointFit:
    """Alternate between searching the load states and fitting their masses.

    If the search does not converge, the states with the smallest Bayesian information criterion are
    kept.

    Args:
        first_fit: the fit to start from.
        inputs: samples of the log.
        repeatability_kg: scatter of the masses of one load; None estimates it.
        change_kinds: (manoeuvres - 1,) evidence for a load change between manoeuvres.
        fit_with_final_columns: result of another search, returned as soon as this one finds the
            same states.
    """
    number = np.unique(find_manoeuvre_of_stretches(first_fit.motion))
    if not np.isfinite(first_fit.theta).all():
        return _set_masses_to_unknown(first_fit)
    first, best, tried = first_fit, None, list[Ints]()
    for _ in range(LIMITS.state_rounds):
        return_freed_memory_to_os()  # no block of the size of the rows is free
        rows = make_refit_rows(first_fit, inputs.noise)
        states = max(
            (
                find_load_states(
                    _estimate_manoeuvre_mass_levels(first_fit, inputs, change_kinds, each),
                    number,
                    repeatability_kg,
                )
                for each in make_load_search_rows(first_fit, rows)
            ),
            key=lambda each: each.log_odds,
        )
        if fit_with_final_columns is not None and _is_partition_of_fit(
            fit_with_final_columns, states.state_of_manoeuvre
        ):
            return fit_with_final_columns
        if states.state_count == 1 and first_fit.mass_count == 1:
            return refit_with_extra_terms(
                replace(first_fit, states=states), inputs.noise, inputs.priors, fit_rows=rows
            )
        if _is_partition_of_fit(first_fit, states.state_of_manoeuvre):
            # the same loads, with a better estimate of their scatter
            first_fit = replace(first_fit, states=states)
            first_fit = refit_with_extra_terms(
                first_fit, inputs.noise, inputs.priors, fit_rows=rows
            )
            # release the rows before the next round: for a shift they are hundreds of megabytes
            del rows, best
            if not np.isfinite(first_fit.theta).all():
                return first_fit
            return refit_with_extra_terms(first_fit, inputs.noise, inputs.priors)
        if does_load_search_include_ground(first_fit.motion):
            inputs = add_ground_force_variance(first_fit, inputs)
        del rows  # for a shift they are hundreds of megabytes
        first_fit = fit_jointly(inputs, states)
        if not np.isfinite(first_fit.theta).all():
            return _set_masses_to_unknown(first)
        if any(np.array_equal(states.state_of_manoeuvre, each) for each in tried):
            break
        tried.append(states.state_of_manoeuvre)
        # each fit of a shift holds hundreds of megabytes
        if (
            best is None
            or states.bayesian_information_criterion
            < _require_load_states(best).bayesian_information_criterion
        ):
            best = first_fit
    assert best is not None
    return best


def _set_masses_to_unknown(fit: JointFit) -> JointFit:
    """The same fit with all masses set to unknown."""
    states = fit.states
    if fit.mass_count == 1 or states is None:
        states = make_single_unknown_state(np.unique(find_manoeuvre_of_stretches(fit.motion)))
    return replace(fit, theta=np.full(fit.theta.size, np.nan), states=states)


def _is_partition_of_fit(fit: JointFit, state_of_manoeuvre: Ints) -> bool:
    """Whether a fit has these load states, (manoeuvres,)."""
    return fit.states is not None and np.array_equal(
        fit.states.state_of_manoeuvre, state_of_manoeuvre
    )


def _require_load_states(fit: JointFit) -> LoadStates:
    assert fit.states is not None
    return fit.states


def add_ground_force_variance(fit: JointFit, inputs: JointFitInputs) -> JointFitInputs:
    """Add the variance of ground forces between stretches, by a fit's residual, to the inputs."""
    if inputs.ground_variance_ratio_1_s:
        return inputs
    # with the fit's own rows: the number of rows of a refit depends on the final lag
    fitted = fit.solution
    correlation, white = estimate_pooled_autocorrelation(fitted.residual, fitted.group, None)
    a_second = fit.motion.rate_hz / compute_samples_between_fitted_means(fit.samples_per_mean)
    noise = white * max(2.0 * float(correlation[: max(round(a_second), 1)].sum()) - 1.0, 1.0)
    if not noise > 0.0:  # without residuals there is no ground force to estimate
        return inputs
    std_N = inputs.priors.ground_uneven_share * fit.motion.empty_weight_N
    return replace(inputs, ground_variance_ratio_1_s=std_N**2 * a_second / noise)
