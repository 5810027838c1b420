"""Loads that change in motion: of single manoeuvres, and of all manoeuvres alike.

`find_manoeuvres_with_growing_load` compares the residual of a manoeuvre with that of a mass that
grows evenly over it, and with the other manoeuvres. A change common to all manoeuvres is hidden in
their shared terms, so `refit_with_load_growing_at_starts` adds a term for it. With that term, the
resistances must not be negative: otherwise they absorb a part of the growth.

A load that changes during a manoeuvre that creeps for a second or two leaves no residual:
`find_creeping_load_changes` finds such manoeuvres by their speed and by the different loads before
and after them.
"""

from dataclasses import dataclass
from itertools import chain, compress
from typing import Final

import numpy as np
from scipy.optimize import nnls
from scipy.special import ndtri

from analysis.model.settings import PriorSettings
from analysis.model.uncertainty_sources import STD_OF_MAD
from analysis.weighing.fit_columns import (
    FitRows,
    average_and_weight_fit_columns,
    compute_samples_between_fitted_means,
)
from analysis.weighing.joint_fit import refit_with_extra_terms
from analysis.weighing.joint_result import JointFit, find_term_index
from analysis.weighing.load_changes import (
    find_manoeuvre_of_fitted_samples,
    find_manoeuvre_of_stretches,
)
from analysis.weighing.load_limits import LIMITS
from analysis.weighing.load_states import LoadStates
from analysis.weighing.motion_samples import ColumnNoiseModel, Floats, Ints, MotionSamples
from analysis.weighing.nuisances import FILLING
from estimators.numerics.autocorrelation import compute_student_to_normal_ratio
from estimators.numerics.fit_loss import list_group_numbers, list_rows_by_group

#: Number of parameters that may differ between starts: mass, friction and constant.
_OWN: Final = 3
#: Terms that can only resist the motion.
_RESISTANCES: Final = ("direction", "quadratic")


@dataclass(frozen=True, slots=True)
class LoadChangeInMotion:
    """Growth or fall of the load during one manoeuvre.

    Attributes:
        manoeuvre_id: number of the manoeuvre in the samples.
        first: its first fitted sample.
        last: its last fitted sample.
        mean_mass_kg: mass in the middle of the manoeuvre, with its own friction and constant.
        load_change_kg: change of the load from the first to the last fitted sample, in excess of
            that common to all manoeuvres.
        std_kg: standard deviation of the change.
        is_possible: whether the machine could carry so much; otherwise the manoeuvre does not
            follow the model.
    """

    manoeuvre_id: int
    first: int
    last: int
    mean_mass_kg: float
    load_change_kg: float
    std_kg: float
    is_possible: bool = True


@dataclass(frozen=True, slots=True)
class LoadGrowthAtEveryStart:
    """A load that grows at the same rate, in kg/s, during every start.

    Attributes:
        kg_s: growth rate, at least 0.
        deviations: z-score of the growth, including the residual common to all starts; NaN if
            undetermined.
        largest_mass_change_over_u: largest change of a mass or of the mean payload, in its standard
            uncertainties.
        effect_kg: (masses,) change of each mass.
        is_possible: whether the machine may be filled while it drives. If not, something else
            changes evenly over every start, such as a delayed force or an efficiency that depends
            on the torque, and the effect is added to the uncertainty of the masses.
    """

    kg_s: float
    deviations: float
    largest_mass_change_over_u: float = 0.0
    effect_kg: Floats | float = 0.0
    is_possible: bool = True

    @property
    def load_growth_over_std(self) -> float:
        """`deviations`; 0 if the growth changes no mass or payload by more than its uncertainty.

        In a long log a misfit is significant even if it changes no mass. Also 0 if the machine
        cannot be filled while it drives.
        """
        if not self.is_possible:
            return 0.0
        if np.isnan(self.largest_mass_change_over_u):
            return float("nan")
        return self.deviations * float(self.largest_mass_change_over_u > 1.0)

    @property
    def significant_mass_changes_kg(self) -> Floats | float:
        """Uncertainty added to each mass, (masses,) in kg; 0 if the growth is not significant."""
        shown = not self.is_possible and self.deviations > LIMITS.impossible_filling_std
        return self.effect_kg if shown else 0.0


def refit_with_load_growing_at_starts(
    fit: JointFit, noise: ColumnNoiseModel, priors: PriorSettings, fit_rows: FitRows | None = None
) -> LoadGrowthAtEveryStart:
    """Refit with a load that grows equally at every start, and with nonnegative resistances.

    The z-score is from the likelihood ratio of no growth and a growth of at least 0, each with the
    nonnegative resistances that explain the log best.

    Args:
        fit: the fit without growth.
        noise: noise of acceleration, speed and force.
        priors: priors of the nuisances.
        fit_rows: rows of the fit and of `FILLING`, if already computed.
    """
    grown = refit_with_extra_terms(fit, noise, priors, (FILLING,), fit_rows=fit_rows)
    names = [term.name for term in fit.terms]
    resistances = [find_term_index(name, fit.terms) for name in _RESISTANCES if name in names]
    at = [grown.theta.size - 1, *(fit.mass_count + 1 + place for place in resistances)]
    found, covariance = grown.theta[at], grown.posterior_fit.covariance[np.ix_(at, at)]
    std = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(std, std)
    if not (
        np.isfinite(correlation).all()
        and np.linalg.eigvalsh(correlation)[0] > LIMITS.min_own_variance_fraction
    ):
        return LoadGrowthAtEveryStart(0.0, float("nan"))
    whitened = np.linalg.inv(np.linalg.cholesky(correlation))
    best, missed = nnls(whitened, whitened @ (found / std))
    missed_by_none = nnls(whitened[:, 1:], whitened @ (found / std))[1]
    better = max(missed_by_none**2 - missed**2, 0.0) / max(grown.posterior_fit.misfit_ratio, 1.0)
    # masses given that growth and those resistances
    follows = np.linalg.lstsq(covariance, grown.posterior_fit.covariance[at, : fit.mass_count])[0]
    moved = (
        grown.theta[: fit.mass_count] + (best * std - found) @ follows - fit.theta[: fit.mass_count]
    )
    of_sums = chain(
        map(fit.make_mass_coefficients_of_state, range(fit.mass_count)),
        list_coefficients_of_mean_payloads(fit),
    )
    moves_u = [
        abs(float(each @ moved)) / max(fit.compute_mass_sum_u_kg(each), 1e-9) for each in of_sums
    ]
    return LoadGrowthAtEveryStart(
        float(best[0] * std[0]), float(np.sqrt(better)), float(np.max(np.array(moves_u))), moved
    )


def list_coefficients_of_mean_payloads(fit: JointFit) -> list[Floats]:
    """(masses,) weights of the mean payload, heavy minus light manoeuvres; empty with one load."""
    loads, states = fit.previous_estimates.relative_loads, fit.states
    if loads is None or states is None:
        return []
    loaded = loads.mark_loaded_manoeuvres_by_number(states.manoeuvre_ids)
    if loaded.all() or not loaded.any():
        return []
    each = np.where(loaded, 1.0 / loaded.sum(), -1.0 / (~loaded).sum())
    return [np.bincount(states.state_of_manoeuvre, each, fit.mass_count).astype(np.float64)]


def find_manoeuvres_with_growing_load(
    fit: JointFit, noise: ColumnNoiseModel, motion: MotionSamples | None = None
) -> tuple[LoadChangeInMotion, ...]:
    """Find the manoeuvres whose load changes by more than chance explains.

    Args:
        fit: joint fit, for friction and nuisances.
        noise: noise of acceleration, speed and force.
        motion: the manoeuvres to test, if not those of the fit.
    """
    if fit.states is None or not np.isfinite(fit.solution.residual_rms):
        return ()
    # or its columns would stand in memory beside the rows below
    fit.solution.compute_uncertainty_and_release_samples()
    motion = fit.motion if motion is None else motion
    rows = average_and_weight_fit_columns(
        motion, noise, fit.terms, fit.samples_per_mean, fit.previous_estimates
    )
    manoeuvre_of_row = np.where(
        rows.group >= 0, find_manoeuvre_of_stretches(motion)[np.maximum(rows.group, 0)], -1
    )
    by_manoeuvre = dict(
        zip(
            list_group_numbers(manoeuvre_of_row).tolist(),
            list_rows_by_group(manoeuvre_of_row),
            strict=True,
        )
    )
    none = np.empty(0, np.int64)
    numbers = np.unique(find_manoeuvre_of_stretches(motion))
    parts = [by_manoeuvre.get(each, none) for each in numbers.tolist()]
    told = [part.size >= LIMITS.growth_min_rows for part in parts]
    if sum(told) < LIMITS.growth_min_manoeuvres:
        return ()
    left = compute_residual_force_newtons(fit, rows, manoeuvre_of_row)
    usual = np.median(np.abs(left[manoeuvre_of_row >= 0]))
    for part in parts:
        # the jerk of a stop is no load, nor is a change that lasts for half of a manoeuvre
        most = (
            LIMITS.row_clip_std
            * STD_OF_MAD
            * max(usual, np.median(np.abs(left[part])) if part.size else 0.0)
        )
        left[part] = left[part].clip(-most, most)
    variance = _compute_row_noise_variance_newtons2(fit, noise)
    friction = float(
        np.hypot(fit.viscous_friction, fit.posterior_fit.parameter_stds[fit.mass_count])
    )
    own = (
        LIMITS.own_friction_fraction * friction,
        LIMITS.own_constant_fraction * fit.motion.force_95_percentile_newtons,
    )
    tied = np.sqrt(variance) / np.maximum([np.inf, *own], 1e-9)
    if not (np.isfinite(tied).all() and np.isfinite(left[manoeuvre_of_row >= 0]).all()):
        return ()  # the fit determines nothing
    slopes = np.array(
        [
            fit_mass_offset_and_growth_to_residual(rows.A[part], left[part], tied)
            for part in compress(parts, told)
        ]
    )
    number, slopes = numbers[told][slopes[:, 2] > 0.0], slopes[slopes[:, 2] > 0.0]
    if number.size < LIMITS.growth_min_manoeuvres:
        return ()
    offset_kg, kg, square = slopes.T
    state_mass_kg = fit.masses_kg[look_up_load_states(fit.states, number)]
    kg = kg - estimate_load_growth_common_to_mass_kg(state_mass_kg, kg)
    apart = STD_OF_MAD * float(np.median(np.abs(kg)))
    std_kg = np.sqrt(variance / square + apart**2)
    limit = -float(
        ndtri(LIMITS.growth_false_alarm_probability / 2.0 / kg.size)
    ) * compute_student_to_normal_ratio(kg.size - 1)
    # more than a machine can carry is no load, however significant the misfit is
    carried = np.abs(kg) < LIMITS.max_growth_fraction * abs(fit.mass_kg)
    most_kg = compute_max_plausible_load_change_kg(fit)
    carried &= kg > -most_kg
    used, of_sample = np.flatnonzero(motion.is_fittable), find_manoeuvre_of_fitted_samples(motion)
    return tuple(
        LoadChangeInMotion(
            int(number[k]),
            int(used[of_sample == number[k]][0]),
            int(used[of_sample == number[k]][-1]),
            float(state_mass_kg[k] + offset_kg[k]),
            float(kg[k]),
            float(std_kg[k]),
            bool(-compute_max_load_loss_of_manoeuvre_kg(fit, int(number[k])) < kg[k] < most_kg),
        )
        for k in np.flatnonzero((np.abs(kg) > limit * std_kg) & carried)
    )


def look_up_load_states(states: LoadStates, manoeuvre_numbers: Ints) -> Ints:
    """Index of the load state of each manoeuvre number, (n,).

    A number that the states lack gets the state of the next manoeuvre, or of the last one.
    """
    return states.state_of_manoeuvre[
        np.searchsorted(states.manoeuvre_ids, manoeuvre_numbers).clip(
            0, states.manoeuvre_ids.size - 1
        )
    ]


def estimate_load_growth_common_to_mass_kg(mass_kg: Floats, growth_kg: Floats) -> Floats:
    """Apparent growth common to manoeuvres of the same mass, (n,) in kg, by errors of the model.

    Forces that the model lacks (a dead band, rolling resistance) grow with the load, so that the
    heaviest starts would seem to lose a part of it. The growth is a line over the mass by least
    absolute deviations, or the median if few manoeuvres are heavy or few are light.

    Args:
        mass_kg: (n,) masses of the manoeuvres.
        growth_kg: (n,) growth of each manoeuvre's load.
    """
    common_kg = np.full(growth_kg.size, float(np.median(growth_kg)))
    heavy = mass_kg > (mass_kg.min() + mass_kg.max()) / 2.0
    if min(heavy.sum(), (~heavy).sum()) < LIMITS.growth_min_manoeuvres:
        return common_kg
    columns = np.column_stack([np.ones_like(mass_kg), mass_kg / np.abs(mass_kg).max()])
    for _ in range(LIMITS.least_absolute_rounds):
        apart_kg = np.abs(growth_kg - common_kg)
        weight = np.maximum(apart_kg, max(1e-3 * float(np.median(apart_kg)), 1e-9)) ** -0.5
        common_kg = columns @ np.linalg.lstsq(columns * weight[:, None], growth_kg * weight)[0]
    return common_kg


def compute_max_plausible_load_change_kg(fit: JointFit) -> float:
    """Largest plausible change of load in kg, by the range of masses; infinite with one load."""
    if fit.mass_count == 1:
        return float("inf")
    return LIMITS.max_load_change_ratio * float(np.ptp(fit.masses_kg))


def compute_max_load_loss_of_manoeuvre_kg(fit: JointFit, manoeuvre_number: int) -> float:
    """Largest load that a manoeuvre can lose, in kg: its payload and that payload's uncertainty.

    The payload is relative to the lightest state. An excluded manoeuvre has the heavier load of the
    manoeuvres before and after it. Infinite with one load, since the log does not separate it from
    the machine.

    Args:
        fit: the joint fit, with its load states.
        manoeuvre_number: number of the manoeuvre in the samples.
    """
    states = fit.states
    if states is None or fit.mass_count == 1:
        return float("inf")
    first, end = (
        int(np.searchsorted(states.manoeuvre_ids, manoeuvre_number, side))
        for side in ("left", "right")
    )
    places = np.array([first] if end > first else [first - 1, first]).clip(
        0, states.manoeuvre_ids.size - 1
    )
    lightest = fit.make_mass_coefficients_of_state(int(np.argmin(fit.masses_kg)))
    loads = [
        fit.make_mass_coefficients_of_state(int(k)) - lightest
        for k in states.state_of_manoeuvre[places]
    ]
    return max(float(each @ fit.masses_kg) + fit.compute_mass_sum_u_kg(each) for each in loads)


def find_creeping_load_changes(fit: JointFit) -> Ints:
    """Find slow manoeuvres between two different loads, in a log whose loads recur.

    Args:
        fit: the joint fit of the log, with its load states.

    Returns:
        (k,) numbers of the manoeuvres, as in `fit.states.manoeuvre_ids`; empty if no load recurs.
    """
    states, none = fit.states, np.empty(0, np.int64)
    if states is None or not states.load_returns:
        return none
    place = np.searchsorted(states.manoeuvre_ids, find_manoeuvre_of_fitted_samples(fit.motion))
    top_m_s = np.zeros(states.manoeuvre_ids.size)
    np.maximum.at(top_m_s, place, np.abs(fit.motion.speed[fit.motion.is_fittable]))
    creeps = top_m_s < LIMITS.creep_speed_ratio * np.median(top_m_s)
    drives = np.flatnonzero(~creeps)
    after = np.searchsorted(drives, np.arange(creeps.size))
    between = creeps & (after > 0) & (after < drives.size)
    loads = states.state_of_manoeuvre[drives]
    changes = loads[(after - 1).clip(0)] != loads[after.clip(0, drives.size - 1)]
    return states.manoeuvre_ids[between & changes]


def compute_residual_force_newtons(
    fit: JointFit, fit_rows: FitRows, manoeuvre_of_row: Ints
) -> Floats:
    """Residual force of the rows, (n,) in N.

    Rows outside manoeuvres get the mass of some other load state: ignore them.
    """
    assert fit.states is not None
    masses = fit.theta[: fit.mass_count][look_up_load_states(fit.states, manoeuvre_of_row)]
    return (
        fit_rows.f - fit_rows.A[:, 0] * masses - fit_rows.A[:, 1:] @ fit.friction_and_term_estimates
    )


def fit_mass_offset_and_growth_to_residual(
    A: Floats, residual: Floats, std_ratios: Floats
) -> tuple[float, float, float]:
    """Regress a residual on a mass that grows linearly: its offset, growth and information.

    The manoeuvre's deviations in mass, friction and constant are projected out as far as their
    priors allow: `std_ratios` (3,) is a row's standard deviation over that of each. The offset is
    that of the mass in the middle of the manoeuvre. All are 0 if the manoeuvre hardly accelerates.
    """
    own = np.vstack([A[:, :_OWN], np.diag(std_ratios)])
    whole = A[:, 0] * np.linspace(-0.5, 0.5, residual.size)
    own_part = np.linalg.lstsq(own, np.append(whole, np.zeros(_OWN)))[0]
    grows = whole - A[:, :_OWN] @ own_part
    square = float(grows @ whole)
    if not square > LIMITS.column_rounding_fraction * float(whole @ whole):
        return 0.0, 0.0, 0.0
    growth_kg = float(grows @ residual) / square
    rest = np.append(residual - growth_kg * whole, np.zeros(_OWN))
    return float(np.linalg.lstsq(own, rest)[0][0]), growth_kg, square


def _compute_row_noise_variance_newtons2(fit: JointFit, noise: ColumnNoiseModel) -> float:
    """Variance of a row due to sensor noise, in N², including that of overlapping rows."""
    samples = fit.samples_per_mean
    gradient = np.array([fit.mass_kg, fit.viscous_friction, -1.0])
    overlap = samples / compute_samples_between_fitted_means(samples)
    return overlap * float(gradient @ noise.compute_covariance_of_means(samples) @ gradient)
