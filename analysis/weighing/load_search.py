"""Search for load states: find states and fit a mass each in turn until nothing changes."""

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from analysis.stages.signals.grid_rate import rows_in_duration
from analysis.weighing.fit_columns import stride_between_means
from analysis.weighing.fit_task import FitTask
from analysis.weighing.haul_patterns import propose_hauling_partitions
from analysis.weighing.joint_fit import (
    JointFitInputs,
    applicable_terms,
    joint_fit,
    make_refit_rows,
    refit_with_changes,
)
from analysis.weighing.joint_result import JointFit
from analysis.weighing.load_limits import LIMITS as LOAD_LIMITS
from analysis.weighing.load_states import (
    LoadStates,
    find_load_states,
    load_change_kinds,
    single_unknown_state,
    states_of_partition,
    unit_of_each_stretch,
)
from analysis.weighing.motion_samples import Ints
from analysis.weighing.record_places import rows_for_load_search
from analysis.weighing.weighing_limits import LIMITS
from estimators.joint.group_effects import HINTED, GroupEffects
from estimators.numerics.autocorrelation import pooled_autocorrelation


def search_and_fit_load_states(
    found: JointFit, inputs: JointFitInputs, repeatability_kg: float | None
) -> JointFit:
    """Find load states and fit a mass for each, iterating until nothing changes.

    A border between two grounds is a term for several loads only, and scatters the masses of a
    one-load fit more than loads do; loads that follow the direction are as likely as a haul and its
    return. So a poor fit is searched again, starting from loads that change where something hints
    at it and from those that the driving pattern suggests. The best explanation of the force is
    returned.
    """
    kind = load_change_kinds(found.motion)
    settled = _settle_states(found, inputs, repeatability_kg, kind)
    misfits = settled.solution.misfit_ratio > LIMITS.max_misfit_ratio
    if not misfits or found.motion.manoeuvre_count < LOAD_LIMITS.ground_min_manoeuvres:
        return settled
    inputs = _add_uneven_ground(found, inputs)
    # over short means the residual is noise and transients, which no loads explain
    transient = rows_in_duration(LIMITS.transient_mean_s, found.motion.rate_hz)
    samples = max(found.mean_samples, settled.mean_samples, transient)
    alike = _PartitionComparison.from_fit(found, inputs, samples)
    fits = list[JointFit]()
    hints = np.append(0, np.cumsum(kind > 1))
    if hints[-1] and not _has_membership(settled, hints):
        held = _refit_fixed_states(alike.states(hints), inputs)
        fits.append(_settle_states(held, inputs, repeatability_kg, kind, settled))
    hauls = propose_hauling_partitions(found.motion)
    if hauls:
        haul = min(hauls, key=alike.information_criterion)
        kind = np.where(np.diff(haul) > 0, np.maximum(kind, HINTED), kind)
        held = _refit_fixed_states(alike.states(haul), inputs)
        hidden = _settle_states(held, inputs, repeatability_kg, kind, settled)
        fits += [hidden, _refit_with_own_scatter(held, inputs, repeatability_kg, kind)]
    likely = [settled, *(each for each in fits if _has_certain_loads(each))]
    if len(likely) == 1:
        return settled
    return min(
        likely, key=lambda each: alike.information_criterion(_load_states_of_fit(each).membership)
    )


def _has_certain_loads(found: JointFit) -> bool:
    """Whether the log practically excludes a single load."""
    least = LOAD_LIMITS.hidden_loads_max_single_probability
    return found.count > 1 and _load_states_of_fit(found).single_probability < least


@dataclass(frozen=True)
class _PartitionComparison:
    """Compare load assignments of one log by fits over means of the same length.

    Attributes:
        task: the fit without load states.
        units: mass estimate of each manoeuvre by itself.
        number: (units,) numbers of the manoeuvres.
        samples: length of the means.
        known: criterion of each membership that was compared, by its bytes.
    """

    task: FitTask
    units: GroupEffects
    number: Ints
    samples: int
    known: dict[bytes, float] = field(default_factory=dict[bytes, float])

    @classmethod
    def from_fit(cls, found: JointFit, inputs: JointFitInputs, samples: int) -> Self:
        """Prepare the comparison with the manoeuvres of an earlier fit, over means of `samples`."""
        motion, terms = found.motion, applicable_terms(found.motion, several=True)
        task = FitTask(
            motion, inputs.noise, inputs.priors, terms, inputs.wheels, None, inputs.uneven_1_s
        )
        number = np.unique(unit_of_each_stretch(motion))
        return cls(
            task,
            _manoeuvre_effects(found, inputs, load_change_kinds(motion)),
            number,
            samples,
        )

    def states(self, membership: Ints) -> LoadStates:
        """Load states of a partition, with (units,) membership."""
        return states_of_partition(self.units, self.number, membership)

    def information_criterion(self, membership: Ints) -> float:
        """Akaike information criterion (1974) of a partition; infinite if its fit fails."""
        key = np.ascontiguousarray(membership, np.int64).tobytes()
        if key not in self.known:
            self.known[key] = self._fit_criterion(membership)
        return self.known[key]

    def _fit_criterion(self, membership: Ints) -> float:
        fitted = replace(self.task, states=self.states(membership)).fit_means(self.samples, 2)
        if not np.isfinite(fitted.theta).all():
            return np.inf
        independent = LOAD_LIMITS.independent_residuals * self.number.size
        return independent * float(np.log(fitted.solution.residual_rms**2)) + 2.0 * fitted.count


def _refit_fixed_states(states: LoadStates, inputs: JointFitInputs) -> JointFit:
    """Refit with fixed states a few times, so that the ground terms by load settle."""
    found = joint_fit(inputs, states)
    for _ in range(1, LIMITS.held_rounds):
        if not np.isfinite(found.theta).all():
            break
        units = _manoeuvre_effects(found, inputs, load_change_kinds(found.motion))
        found = joint_fit(inputs, states_of_partition(units, states.unit, states.membership))
    return found


def _refit_with_own_scatter(
    fit: JointFit, inputs: JointFitInputs, repeatability_kg: float | None, kind: Ints
) -> JointFit:
    """Refit the same load states with their own scatter and single-load probability."""
    if not np.isfinite(fit.theta).all():
        return fit
    units, states = _manoeuvre_effects(fit, inputs, kind), _load_states_of_fit(fit)
    likeliest = find_load_states(units, states.unit, repeatability_kg)
    scattering = states_of_partition(units, states.unit, states.membership, usual_scatter=False)
    states = replace(scattering, single_probability=likeliest.single_probability)
    return refit_with_changes(replace(fit, states=states), inputs.noise, inputs.priors, rounds=2)


def _manoeuvre_effects(found: JointFit, inputs: JointFitInputs, kind: Ints) -> GroupEffects:
    """Mass estimates of each manoeuvre by a fit, with the kinds of change between them."""
    units = _task_of_fit(found, inputs).group_effects_of_fit(
        found, make_refit_rows(found, inputs.noise)
    )
    return replace(units, kind=kind)


def _task_of_fit(found: JointFit, inputs: JointFitInputs) -> FitTask:
    """The task that produced a fit."""
    return FitTask(
        found.motion, inputs.noise, inputs.priors, found.terms, found.kinematics, found.states
    )


def _settle_states(
    found: JointFit,
    inputs: JointFitInputs,
    repeatability_kg: float | None,
    kind: Ints,
    settled: JointFit | None = None,
) -> JointFit:
    """Alternate between state search and fit, from a first fit on.

    If the search does not converge, the states with the least scatter for their number are kept.

    Args:
        found: the fit to start from.
        inputs: samples of the log.
        repeatability_kg: how masses of one load scatter; None finds it.
        kind: kind of change between manoeuvres.
        settled: result of another search, returned as soon as this one comes to its states.
    """
    number = np.unique(unit_of_each_stretch(found.motion))
    if not np.isfinite(found.theta).all():
        return _withhold_masses(found)
    first, best, tried = found, None, list[Ints]()
    for _ in range(LIMITS.state_rounds):
        task, rows = _task_of_fit(found, inputs), make_refit_rows(found, inputs.noise)
        states = max(
            (
                find_load_states(
                    replace(task.group_effects_of_fit(found, each), kind=kind),
                    number,
                    repeatability_kg,
                )
                for each in rows_for_load_search(found, rows)
            ),
            key=lambda each: each.log_odds,
        )
        if settled is not None and _has_membership(settled, states.membership):
            return settled
        if states.count == 1 and found.count == 1:
            return refit_with_changes(
                replace(found, states=states), inputs.noise, inputs.priors, rows=rows
            )
        if _has_membership(found, states.membership):
            # the same loads, whose scatter is known better now
            found = replace(found, states=states)
            found = refit_with_changes(found, inputs.noise, inputs.priors, rows=rows)
            # a round at a time: of a shift the rows before it are hundreds of megabytes
            del rows, best
            known = np.isfinite(found.theta).all()
            return refit_with_changes(found, inputs.noise, inputs.priors) if known else found
        inputs = _add_uneven_ground(found, inputs)
        del rows  # of a shift they are hundreds of megabytes
        found = joint_fit(inputs, states)
        if not np.isfinite(found.theta).all():
            return _withhold_masses(first)
        if any(np.array_equal(states.membership, each) for each in tried):
            break
        tried.append(states.membership)
        # each fit of a shift holds hundreds of megabytes
        if best is None or states.bic < _load_states_of_fit(best).bic:
            best = found
    assert best is not None
    return best


def _withhold_masses(found: JointFit) -> JointFit:
    """The same fit with all masses set to unknown."""
    states = found.states
    if found.count == 1 or states is None:
        states = single_unknown_state(np.unique(unit_of_each_stretch(found.motion)))
    return replace(found, theta=np.full(found.theta.size, np.nan), states=states)


def _has_membership(found: JointFit, membership: Ints) -> bool:
    """Whether a fit has these load states, (units,)."""
    return found.states is not None and np.array_equal(found.states.membership, membership)


def _load_states_of_fit(found: JointFit) -> LoadStates:
    assert found.states is not None
    return found.states


def _add_uneven_ground(found: JointFit, inputs: JointFitInputs) -> JointFitInputs:
    """Fit inputs with the variance of ground forces between stretches, from a fit's residual."""
    if inputs.uneven_1_s or found.motion.manoeuvre_count < LOAD_LIMITS.ground_min_manoeuvres:
        return inputs
    # by the fit's own groups: rows of a refit are as many as the lag that the fit ended with allows
    fitted = found.solution
    correlation, white = pooled_autocorrelation(fitted.residual, fitted.group, None)
    a_second = found.motion.rate_hz / stride_between_means(found.mean_samples)
    noise = white * max(2.0 * float(correlation[: max(round(a_second), 1)].sum()) - 1.0, 1.0)
    if not noise > 0.0:  # a fit that leaves nothing has no unevenness to tell
        return inputs
    std_N = inputs.priors.ground_uneven_share * found.motion.weight
    return replace(inputs, uneven_1_s=std_N**2 * a_second / noise)
