"""Load states in which the machine is empty; payloads are differences to their masses."""

import numpy as np

from analysis.model.machine import Machine
from analysis.model.uncertainty_sources import combine_u, list_scale_sources_without_u
from analysis.weighing.empty_mass_drift import mark_local_mass_minima
from analysis.weighing.joint_result import JointFit
from analysis.weighing.load_changes import find_manoeuvre_of_fitted_samples
from analysis.weighing.load_limits import LIMITS
from analysis.weighing.mass_budget import make_mass_budget
from analysis.weighing.motion_samples import Floats, Ints
from analysis.weighing.weigh import Weighing


def find_empty_states(
    weighing: Weighing, state_spans_ns: list[tuple[int, int]], machine: Machine
) -> list[int]:
    """Indices of the load states in which the machine is empty; none if the log cannot tell.

    If `settings.loads` names a time when the machine is empty, these are the states mostly within
    it, or else the one that overlaps it most. Otherwise they are the lightest of several states and
    those equally light, if the lightest equals the stated empty mass within its uncertainty and the
    heaviest clearly does not; the lightest alone would be the one with the largest error. If the
    lightest does not equal the stated mass, they are the states to which the machine returns after
    each load, if there are any.
    """
    fit, body, settings = weighing.fit, machine.machine, machine.settings.loads
    if fit.mass_count < 2:
        return []
    if settings.empty_from_s is not None and settings.empty_to_s is not None:
        first, last = settings.empty_from_s * 1e9, settings.empty_to_s * 1e9
        shared = [min(last, end) - max(first, start) for start, end in state_spans_ns]
        inside = [
            state
            for state, (start, end) in enumerate(state_spans_ns)
            if 2 * shared[state] > end - start
        ]
        most = int(np.argmax(shared))
        return inside or ([most] if shared[most] > 0 else [])
    if body.empty_inertia_kg is None:
        return []
    lightest = int(np.argmin(fit.masses_kg))
    difference_kg = abs(float(fit.masses_kg[lightest]) - body.empty_inertia_kg)
    u_kg = combine_u(
        make_mass_budget(weighing, machine, fit.make_mass_coefficients_of_state(lightest))
    )
    u_kg = float(np.hypot(u_kg, body.empty_mass_u_kg or 0.0))
    carried_kg = float(np.ptp(fit.masses_kg))
    if carried_kg < LIMITS.heaviest_state_u * u_kg:
        return []
    if difference_kg > LIMITS.empty_state_u * u_kg:
        return _find_return_states_of_any_direction(fit)
    drift = weighing.significant_empty_mass_drift
    if drift is not None:
        return list(drift.empty_states)
    return _find_equally_light_states(weighing, lightest, machine)


def find_return_states(masses_kg: Floats, state_of_manoeuvre: Ints) -> list[int]:
    """States to which a machine returns after each load, whatever its mass is; none if it does not.

    There are several of them, each lighter than the states before and after it, and their range is
    less than half their distance to the lightest other state. A log that is loaded throughout has
    no such states.

    Args:
        masses_kg: (states,) mass of each state.
        state_of_manoeuvre: (manoeuvres,) load state of each manoeuvre, in order of time.
    """
    starts = np.flatnonzero(np.append(True, np.diff(state_of_manoeuvre) != 0))
    visited = state_of_manoeuvre[starts]
    light = mark_local_mass_minima(masses_kg[visited])
    returns_kg, others_kg = masses_kg[visited[light]], masses_kg[visited[~light]]
    if returns_kg.size < LIMITS.returns_min or not others_kg.size:
        return []
    heaviest_kg = float(returns_kg.max())
    if float(others_kg.min()) - heaviest_kg <= 2.0 * (heaviest_kg - float(returns_kg.min())):
        return []
    return np.unique(visited[light]).tolist()


def _find_return_states_of_any_direction(fit: JointFit) -> list[int]:
    """States of a fit by `find_return_states`; none if masses may follow the driving direction."""
    if fit.states is None:
        return []
    state_of_manoeuvre, motion = fit.states.state_of_manoeuvre, fit.motion
    found = find_return_states(fit.masses_kg, state_of_manoeuvre)
    manoeuvre = find_manoeuvre_of_fitted_samples(motion)
    forward = motion.direction[motion.is_fittable] > 0.0
    light = np.isin(state_of_manoeuvre, found)[np.searchsorted(fit.states.manoeuvre_ids, manoeuvre)]
    if not found or abs(forward[light].mean() - forward[~light].mean()) > LIMITS.returns_one_way:
        return []
    return found


def _find_equally_light_states(
    weighing: Weighing, lightest_state: int, machine: Machine
) -> list[int]:
    """States as light as the lightest within the random uncertainty, and as the stated mass."""
    fit = weighing.fit
    found = [lightest_state]
    for state in np.argsort(fit.masses_kg, kind="stable").tolist():
        if state == lightest_state:
            continue
        weights = make_mass_coefficients_of_payload(weighing, state, found)
        random_kg = combine_u(make_mass_budget(weighing, machine, weights), "random")
        if float(weights @ fit.masses_kg) > LIMITS.equally_light_std * random_kg:
            break
        # with much scatter every state would count as equally light
        if _is_heavier_than_stated_empty_mass(weighing, machine, state, found):
            break
        found.append(state)
    return sorted(found)


def _is_heavier_than_stated_empty_mass(
    weighing: Weighing, machine: Machine, state: int, empty: list[int]
) -> bool:
    """Whether a state exceeds the stated mass by more than the empty states' common error."""
    fit, body = weighing.fit, machine.machine
    stated_kg = body.empty_inertia_kg
    assert stated_kg is not None
    weights = (
        fit.make_mass_coefficients_of_state(state),
        compute_weights_of_mean_mass_over_states(fit, empty),
    )
    own = make_mass_budget(weighing, machine, weights[0])
    if list_scale_sources_without_u(own):
        return False
    others = make_mass_budget(weighing, machine, weights[1])
    excess_kg, of_others_kg = (float(each @ fit.masses_kg) - stated_kg for each in weights)
    common_kg = float(np.hypot(combine_u(own, "common", "scale"), body.empty_mass_u_kg or 0.0))
    return excess_kg > compute_largest_excess_of_empty_state_kg(
        of_others_kg, combine_u(others, "random"), combine_u(own, "random"), common_kg
    )


def compute_largest_excess_of_empty_state_kg(
    excess_of_others_kg: float, random_of_others_kg: float, random_kg: float, common_kg: float
) -> float:
    """Largest mass of an empty state beyond the stated one, in kg.

    The error common to all states is estimated from the empty ones (normal prior and measurement),
    so that a wrong scale does not separate states of equal mass.

    Args:
        excess_of_others_kg: mean mass of the known empty states minus the stated mass.
        random_of_others_kg: random standard uncertainty of that mean.
        random_kg: random standard uncertainty of the state in question.
        common_kg: standard uncertainty of the error common to all states.
    """
    square_kg2 = common_kg**2 + random_of_others_kg**2
    share = common_kg**2 / square_kg2 if square_kg2 else 1.0
    left_kg = float(np.hypot(random_kg, np.sqrt(share) * random_of_others_kg))
    return share * excess_of_others_kg + LIMITS.equally_light_std * left_kg


def estimate_std_of_empty_masses_kg(
    weighing: Weighing, empty: list[int], machine: Machine
) -> float:
    """Standard deviation of the empty states' masses beyond chance (DerSimonian & Kacker 2007).

    It is 0 with a single empty state, and if the empty mass drifts, since payloads follow a drift.
    """
    if len(empty) < 2 or weighing.significant_empty_mass_drift is not None:
        return 0.0
    mean = compute_weights_of_mean_mass_over_states(weighing.fit, empty)
    found, expected = 0.0, 0.0
    for state in empty:
        weights = weighing.fit.make_mass_coefficients_of_state(state) - mean
        random_kg = combine_u(make_mass_budget(weighing, machine, weights), "random")
        found += mean[state] * float(weights @ weighing.fit.masses_kg) ** 2
        expected += mean[state] * random_kg**2
    return float(np.sqrt(max(found - expected, 0.0) / (1.0 - float(mean @ mean))))


def make_mass_coefficients_of_payload(weighing: Weighing, state: int, empty: list[int]) -> Floats:
    """(masses,) weights of a mass minus the mean of the empty states.

    If the empty mass drifts, the mean is over the empty states just before and after the state.
    """
    weights = weighing.fit.make_mass_coefficients_of_state(state)
    if weighing.significant_empty_mass_drift is not None:
        empty = _find_nearest_empty_states(state, empty)
    return (
        weights - compute_weights_of_mean_mass_over_states(weighing.fit, empty)
        if empty
        else weights
    )


def _find_nearest_empty_states(state: int, empty: list[int]) -> list[int]:
    before, after = ([e for e in empty if e < state], [e for e in empty if e > state])
    return before[-1:] + after[:1]


def compute_weights_of_mean_mass_over_states(fit: JointFit, states: list[int]) -> Floats:
    """(masses,) weights of the mean mass of `states`, in proportion to their manoeuvres."""
    assert fit.states is not None
    count = np.bincount(fit.states.state_of_manoeuvre).astype(np.float64)
    weights = np.zeros(fit.mass_count)
    weights[states] = count[states] / count[states].sum()
    return weights
