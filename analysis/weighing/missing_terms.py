"""Terms that the model of the force lacks, each added to the fit on its own.

A sensor may saturate softly, the efficiency of a gear or a converter may differ at low speed, a
wheel's radius may grow with the speed, a filter may follow a rising force faster than a falling
one, a belt may flex between the mass and the encoder of its motion. The fit attributes such a force
to mass, friction and drag, which are then wrong by more than their uncertainty, with residuals that
look like noise. A significant term that would change the mass is added to its uncertainty: the log
does not show which of the terms is the true one.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from analysis.model.prior_settings import PriorSettings
from analysis.weighing.column_inputs import ColumnInputs
from analysis.weighing.fit_columns import FitRows
from analysis.weighing.force_by_position import BY_PLACE
from analysis.weighing.joint_fit import refit_with_extra_terms
from analysis.weighing.joint_result import JointFit
from analysis.weighing.motion_samples import ColumnNoiseModel, Floats
from analysis.weighing.nuisances import (
    CURVATURE,
    Nuisance,
)
from analysis.weighing.weighing_limits import LIMITS
from estimators.numerics.group_sums import fit_slope_of_each_group

_LINEAR: Final = "a force sensor that is linear over its range; its calibration curve"
_AT_ALL_SPEEDS: Final = (
    "a force measured at the wheels, after gears and converters; starts that end at different "
    "speeds"
)


#: A mass m pulled by a spring of stiffness c lags by F / c: F = m a - (m / c) d²F/dt², with the
#: measured acceleration a (Den Hartog, Mechanical Vibrations, chapter 2).
ELASTICITY: Final = Nuisance(
    "elasticity",
    "s²",
    lambda m: -m.force_bend,
    lambda _, __: LIMITS.elasticity_prior_std_s2,
    "a belt, rope, coupling or frame that flexes between the mass and the motion sensor",
    "a motion sensor on the mass itself; starts without jerks",
    by_force_bend=lambda m: -np.ones(m.speed.size),
    source="elasticity",
)


#: Friction of cold tyres, bearings and oil falls most at first. Only the change is in this term: a
#: constant part is Coulomb friction, and what is proportional to the speed is in the model.
WARMING: Final = Nuisance(
    "coulomb_warming",
    "N",
    lambda m: m.direction * np.exp(-(m.progress + 0.5) / LIMITS.warming_fraction),
    lambda motion, _: LIMITS.missing_term_prior_std * motion.force_95_percentile_newtons,
    "Coulomb friction or rolling resistance that falls as the machine warms",
    "a machine that is warm",
    source="warming",
)


#: Name of the term in the square of the force.
SATURATION: Final = "force_saturation"


@dataclass(frozen=True, slots=True)
class ForceCurvature:
    """Estimate of an additional term in a·|a|.

    Attributes:
        t: estimate over its standard deviation.
        mass_change_kg: change of the mass with the term.
        mass_kg: mass without the term.
    """

    t: float
    mass_change_kg: float
    mass_kg: float

    @property
    def is_significant(self) -> bool:
        """Whether the force is significantly nonlinear in the acceleration and the mass changes."""
        return abs(self.t) > LIMITS.curvature_min_std and abs(
            self.mass_change_kg
        ) > LIMITS.curvature_min_fraction * abs(self.mass_kg)


@dataclass(frozen=True)
class MissingTerm:
    """A term that the model lacks, with its estimate and effect.

    Attributes:
        term: the term.
        value: its estimate, in the term's unit.
        t: estimate over its standard deviation.
        effect_kg: (masses,) change of each mass with the term.
        residual_rms_N: r.m.s. residual of the fit with the term, in N.
        instrumented_ratio: estimate by the fitted force over that by the measured one; 1 for a term
            that is no function of the force.
    """

    term: Nuisance
    value: float
    t: float
    effect_kg: Floats
    residual_rms_N: float = 0.0
    instrumented_ratio: float = 1.0

    @property
    def is_confirmed(self) -> bool:
        """Whether the fitted force shows the term too, if it is a function of the force."""
        return self.instrumented_ratio > LIMITS.min_instrumented_ratio

    def is_nameable(self, found: Sequence["MissingTerm"]) -> bool:
        """Whether the term, of all significant ones `found`, is a cause rather than a symptom."""
        if self.term is ELASTICITY:
            # a force that nothing describes bends as well
            return self.residual_rms_N <= min(each.residual_rms_N for each in found)
        if self.term.name == SATURATION and abs(self.value) > LIMITS.max_saturation_1:
            return False
        return self.instrumented_ratio > LIMITS.nameable_instrumented_ratio

    def is_significant(self, fit: JointFit) -> bool:
        """Whether the term is significant, and the log determines its effect on the mass."""
        # the standard deviation of the effect is effect / t, and t may be 0
        is_certain = abs(self.t) > LIMITS.certain_term_min_std
        largest_std_kg = LIMITS.missing_term_max_effect_std[int(is_certain)] * np.abs(fit.masses_kg)
        determined = bool((np.abs(self.effect_kg) <= largest_std_kg * abs(self.t)).all())
        if self.term is ELASTICITY:
            # no stiffness is negative
            return determined and self.t > LIMITS.elasticity_min_std
        return determined and abs(self.t) > LIMITS.missing_term_min_std


def list_scaled_terms_absent_from_model(fit: JointFit) -> tuple[Nuisance, ...]:
    """Terms that the model lacks, scaled by the 95th percentiles of the log's force and speed.

    The elasticity is included only without an accelerometer. In a fit with a position-dependent
    force (strokes over one short path) it is the only term, as a spring looks like a gain there.
    """
    # an accelerometer sits on the mass itself, and its filter would have the same column
    is_modelled = fit.motion.by_accelerometer or fit.motion.swing_m_s2 is not None
    elastic = () if is_modelled else (ELASTICITY,)
    if any(term.source == BY_PLACE for term in fit.terms):
        # strokes over one path have the same speed at each place, so a spring looks like a gain
        return elastic
    force_N, speed_m_s = fit.motion.force_95_percentile_newtons, fit.motion.speed_95_percentile_m_s
    return (
        *elastic,
        WARMING,
        Nuisance(
            SATURATION,
            "1",
            lambda m: m.force * np.abs(m.force) / force_N,
            lambda _, __: LIMITS.missing_term_prior_std,
            "a force sensor that saturates or is not linear",
            _LINEAR,
            by_force=lambda m: 2.0 * np.abs(m.force) / force_N,
        ),
        _make_speed_dependent_gain_term(
            "gain_at_high_speed",
            lambda speed: (speed / speed_m_s) ** 2,
            lambda speed: 2.0 * speed / speed_m_s**2,
            "a gain of the force, or a scale of the speed, that changes at high speed",
        ),
        *(
            _make_speed_dependent_gain_term(
                f"gain_below_{share:.0%}",
                _make_gaussian_of_speed(share * speed_m_s),
                _make_gaussian_derivative_of_speed(share * speed_m_s),
                "a gain of the force, or a scale of the speed, that changes at low speed",
            )
            for share in LIMITS.low_speed_fractions
        ),
        *(
            _make_speed_dependent_gain_term(
                f"gain_step_at_{share:.0%}",
                _make_low_speed_indicator_function(share * speed_m_s),
                np.zeros_like,
                "a gain of the force, or a scale of the speed, that steps at a change of gear",
            )
            for share in LIMITS.gain_step_fractions
        ),
        Nuisance(
            "unlike_filter",
            "s",
            lambda m: -np.abs(m.force_rate) * np.sign(m.force),
            lambda _, priors: priors.lag_s,
            "a filter that follows a rising force faster or slower than a falling one",
            "the force without its filter",
        ),
    )


def _make_speed_dependent_gain_term(
    term_name: str,
    gain_of_speed: Callable[[Floats], Floats],
    gain_derivative: Callable[[Floats], Floats],
    meaning: str,
) -> Nuisance:
    """Make the term of a force gain that depends on the speed, from the gain and its derivative."""

    def compute_speed_derivative(m: ColumnInputs) -> Floats:
        return m.force * gain_derivative(m.speed)

    return Nuisance(
        term_name,
        "1",
        lambda m: m.force * gain_of_speed(m.speed),
        lambda _, __: LIMITS.missing_term_prior_std,
        meaning,
        _AT_ALL_SPEEDS,
        by_speed=compute_speed_derivative,
        by_force=lambda m: gain_of_speed(m.speed),
    )


def _make_gaussian_of_speed(width_m_s: float) -> Callable[[Floats], Floats]:
    return lambda speed: np.exp(-((speed / width_m_s) ** 2))


def _make_gaussian_derivative_of_speed(width_m_s: float) -> Callable[[Floats], Floats]:
    return lambda speed: -2.0 * speed / width_m_s**2 * np.exp(-((speed / width_m_s) ** 2))


def _make_low_speed_indicator_function(limit_m_s: float) -> Callable[[Floats], Floats]:
    return lambda speed: (np.abs(speed) < limit_m_s).astype(float)


def estimate_force_curvature(
    fit: JointFit, noise: ColumnNoiseModel, priors: PriorSettings, fit_rows: FitRows | None = None
) -> ForceCurvature:
    """Refit with a term in a·|a|; `t` and the mass change are 0 if the log does not determine it.

    Args:
        fit: the fit without the term.
        noise: noise of acceleration, speed and force.
        priors: priors of the nuisances.
        fit_rows: rows of the fit and of `CURVATURE`, if already computed.
    """
    curved = refit_with_extra_terms(
        fit, noise, priors, (CURVATURE,), fit_rows=fit_rows
    ).posterior_fit
    moved = float(curved.theta[fit.most_frequent_state] - fit.theta[fit.most_frequent_state])
    if abs(moved) > LIMITS.curvature_max_fraction * abs(fit.mass_kg):
        # if all accelerations have the same size, the term is collinear with the mass
        return ForceCurvature(0.0, 0.0, fit.mass_kg)
    return ForceCurvature(float(curved.theta[-1] / curved.parameter_stds[-1]), moved, fit.mass_kg)


def find_missing_terms(
    fit: JointFit,
    terms: tuple[Nuisance, ...],
    noise: ColumnNoiseModel,
    priors: PriorSettings,
    fit_rows: FitRows,
) -> tuple[MissingTerm, ...]:
    """Find the significant terms that the model lacks, the one with the largest effect first.

    Args:
        fit: the fit without these terms.
        terms: terms to test, by `list_scaled_terms_absent_from_model`.
        noise: noise of acceleration, speed and force.
        priors: priors of the nuisances.
        fit_rows: rows of the fit and these terms, by `make_refit_rows`.
    """
    found: list[MissingTerm] = []
    other = None
    for term in terms:
        del other  # for a shift its rows are hundreds of megabytes
        other = refit_with_extra_terms(fit, noise, priors, (term,), fit_rows=fit_rows)
        effect_kg = other.theta[: fit.mass_count] - fit.theta[: fit.mass_count]
        # checked first, since computing the standard deviation takes longer
        if (
            not _find_largest_mass_change_over_uncertainty(effect_kg, fit)
            > LIMITS.missing_term_min_relative_effect
        ):
            continue
        # a term that is mostly noise is collinear with the others after correction for noise
        if other.solution.noise_share > LIMITS.max_noise_fraction:
            continue
        other.solution.compute_uncertainty_and_release_samples()
        value = float(other.theta[-1])
        lacking = MissingTerm(
            term,
            value,
            value / float(other.posterior_fit.parameter_stds[-1]),
            effect_kg,
            other.solution.residual_rms,
        )
        if lacking.is_significant(fit):
            found.append(lacking)
    del other
    if any(_is_function_of_force(each.term) for each in found):
        base = refit_with_extra_terms(fit, noise, priors, fit_rows=fit_rows)
        found = [
            replace(each, instrumented_ratio=_compute_instrumented_ratio(each, base, fit_rows))
            for each in found
        ]
    return tuple(
        sorted(
            found, key=lambda each: -_find_largest_mass_change_over_uncertainty(each.effect_kg, fit)
        )
    )


def _is_function_of_force(term: Nuisance) -> bool:
    """Whether a term lacking in the model is a function of the measured force."""
    return term not in (ELASTICITY, WARMING)


def _compute_instrumented_ratio(missing_term: MissingTerm, base: JointFit, rows: FitRows) -> float:
    """Estimate of a gain of the force with the fitted force as instrument, over the term's value.

    A force that the model lacks is in the measured force and in the residual, so that a function of
    the measured force explains it whatever it is. The fitted force is without it (instrumental
    variables; Ramsey 1969 tests a specification by powers of the fitted values).

    Args:
        missing_term: the term.
        base: fit of the same rows without the term.
        rows: rows of the fit and the term.
    """
    if not _is_function_of_force(missing_term.term) or not missing_term.value:
        return 1.0
    used = base.solution.group >= 0
    residual, measured = base.solution.residual[used], rows.f[used]
    acceleration = rows.A[used, 0]
    friction = [n for n, each in enumerate(rows.terms) if each.name in ("const", "direction")]
    column = rows.A[used, 2 + rows.terms.index(missing_term.term)]
    ratio = np.divide(measured - residual, measured, np.zeros_like(measured), where=measured != 0.0)
    power = 2 if missing_term.term.name == SATURATION else 1
    instrument = column * ratio.clip(0.0, LIMITS.max_fitted_over_measured_force) ** power
    level = np.zeros(measured.size, np.int64)
    if base.states is not None and base.mass_count > 1:
        intercepts = base.states.assign_random_intercepts_to_stretches(base.motion)
        level = intercepts.membership[base.solution.group[used]]

    def subtract_mass(x: Floats) -> Floats:
        # level by level, since a shift has hundreds of loads (Frisch, Waugh and Lovell)
        return x - acceleration * fit_slope_of_each_group(acceleration, level, x)[level]

    known = np.column_stack(
        [subtract_mass(x) for x in rows.A[:, [1, *(2 + n for n in friction)]][used].T]
    )
    known /= np.maximum(np.linalg.norm(known, axis=0), 1e-300)
    instrument, column = (
        x - known @ np.linalg.lstsq(known, x, rcond=None)[0]
        for x in map(subtract_mass, (instrument, column))
    )
    determined = float(instrument @ column)
    if not determined:
        return 1.0
    return float(instrument @ residual) / determined / missing_term.value


def _find_largest_mass_change_over_uncertainty(mass_changes_kg: Floats, fit: JointFit) -> float:
    """Largest ratio of the change of a mass to the standard deviation of that mass."""
    return float(
        np.max(np.abs(mass_changes_kg) / fit.posterior_fit.parameter_stds[: fit.mass_count])
    )
