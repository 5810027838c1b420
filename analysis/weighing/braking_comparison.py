"""Comparison of masses with and without braking: does the measured force include the brakes?"""

import numpy as np

from analysis.weighing.joint_result import JointFit
from analysis.weighing.weighing_limits import LIMITS
from estimators.arrays import Bools, Floats, Ints


def compare_masses_with_and_without_braking(
    fit_with_braking: JointFit, fit_without_braking: JointFit
) -> tuple[float, bool]:
    """Change of the mass in kg if braking is fitted too, and whether it contradicts driving.

    The change is the mean over all loads. If that does not contradict driving, but the change of a
    single load does, it is the change of that load: brakes that the force measures only in part may
    raise one mass by as much as they lower others.

    Args:
        fit_with_braking: fit of driving and braking.
        fit_without_braking: fit of the same load states without braking.
    """
    mean_kg = compute_mean_mass_a_minus_b_kg(fit_with_braking, fit_without_braking)
    if _is_contradicted(
        mean_kg,
        float(np.hypot(fit_with_braking.u_kg, fit_without_braking.u_kg)),
        fit_without_braking.mass_kg,
    ):
        return mean_kg, True
    changes_kg, u_kg = compute_mass_and_u_of_each_load_a_minus_b_kg(
        fit_with_braking, fit_without_braking
    )
    is_contradicted = _is_contradicted(changes_kg, u_kg, fit_without_braking.mass_kg)
    if not is_contradicted.any():
        return mean_kg, False
    k = int(np.argmax(np.where(is_contradicted, np.abs(changes_kg) / u_kg, 0.0)))
    return float(changes_kg[k]), True


def _is_contradicted(change_kg: Floats | float, u_kg: Floats | float, mass_kg: float) -> Bools:
    """Whether each change is significant and large enough to matter."""
    least_kg = np.maximum(
        LIMITS.braking_left_out_u * np.asarray(u_kg), LIMITS.braking_min_fraction * abs(mass_kg)
    )
    return np.abs(change_kg) > least_kg


def compute_mean_mass_a_minus_b_kg(fit_a: JointFit, fit_b: JointFit) -> float:
    """Mean difference of two fits' masses over the same manoeuvres, in kg."""
    if not (loads := _pair_loads_of_same_manoeuvres(fit_a, fit_b)).size:
        return fit_a.mass_kg - fit_b.mass_kg
    return float(np.mean(fit_a.masses_kg[loads[0]] - fit_b.masses_kg[loads[1]]))


def compute_mass_and_u_of_each_load_a_minus_b_kg(
    fit_a: JointFit, fit_b: JointFit
) -> tuple[Floats, Floats]:
    """Difference of two fits' masses and its uncertainty, (loads,) each, in kg, load by load."""
    loads = np.unique(_pair_loads_of_same_manoeuvres(fit_a, fit_b), axis=1)
    u_kg = [
        [fit.compute_mass_sum_u_kg(fit.make_mass_coefficients_of_state(k)) for k in own.tolist()]
        for fit, own in zip((fit_a, fit_b), loads, strict=True)
    ]
    return fit_a.masses_kg[loads[0]] - fit_b.masses_kg[loads[1]], np.hypot(u_kg[0], u_kg[1])


def _pair_loads_of_same_manoeuvres(fit_a: JointFit, fit_b: JointFit) -> Ints:
    """(2, manoeuvres) load of each common manoeuvre in either fit; none without load states."""
    a, b = fit_a.states, fit_b.states
    if a is None or b is None:
        return np.empty((2, 0), np.int64)
    _, in_a, in_b = np.intersect1d(a.manoeuvre_ids, b.manoeuvre_ids, return_indices=True)
    return np.stack([a.state_of_manoeuvre[in_a], b.state_of_manoeuvre[in_b]])
