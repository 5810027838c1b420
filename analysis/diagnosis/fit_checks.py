"""Checks of the joint fit: the size of its terms, and disagreements between estimates."""

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np

from analysis.diagnosis.check_inputs import AxisMotion, CheckInputs
from analysis.diagnosis.check_row import CheckRow
from analysis.diagnosis.diagnosis_limits import LIMITS
from analysis.model.schema import get_column_values
from analysis.weighing.mass_budget import compute_relative_load_mass_u
from analysis.weighing.nuisances import NUISANCES
from analysis.weighing.other_motion import compute_wheel_imu_disagreement_over_speed
from analysis.weighing.weigh import NOTHING_FITTED, Weighing, find_term_farthest_from_prior
from analysis.weighing.weighing_limits import LIMITS as WEIGHING_LIMITS
from analysis.weighing.wheel_kinematics import WheelKinematics

_SIGN_REMEDY: Final = (
    "channels.speed_x_m_s.scale, channels.force_x_N.scale: a sign or a unit is wrong"
)
_OF_GROUND: Final = ("const", "direction", "weight_const", "weight_direction")
_UNSEEN_BRAKES: Final = (
    "settings.gate.exclude_braking = true, where brakes act that the force does not see; else "
)


class Disagreement(NamedTuple):
    """Distance of a method's mass from the answer in standard deviations, and its verdict."""

    method: str
    deviations: float
    contradicted: bool


def compare_methods_with_joint_fit(inputs: CheckInputs) -> list[Disagreement]:
    """Compare every method that has a mass with the joint fit.

    A method without nuisance terms assumes that they are 0, except for a configured Coulomb term.
    If the log shows a term that is not 0, or if its starts disagree, the method's own standard
    deviation is too small, and its interval must at least contain that of the answer. With several
    loads no method agrees, since each estimates a single mass.
    """
    weighing, totals = inputs.weighing, inputs.totals
    if weighing is None or totals is None:
        return []
    fit = weighing.fit
    modelled = list_nuisances_shared_with_methods(inputs)
    shows = any(
        t > LIMITS.term_min_std for term, t in fit.abs_t_by_term.items() if term not in modelled
    )
    shows = shows or bool(fit.posterior_fit.misfit.any())
    shows = shows or (fit.states is not None and fit.states.has_excess_scatter)
    out: list[Disagreement] = []
    columns = (
        totals["method"].to_list(),
        get_column_values(totals, "mass_kg"),
        get_column_values(totals, "mass_std_kg"),
    )
    for method, mass_kg, std_kg in zip(*columns, strict=True):
        if not np.isfinite(mass_kg):
            continue
        difference_kg = mass_kg - fit.mass_kg
        if fit.mass_count > 1 or not np.isfinite(std_kg):
            out.append(Disagreement(method, np.inf, contradicted=True))
            continue
        deviations = difference_kg / float(np.hypot(std_kg, fit.u_kg))
        far = abs(difference_kg) > LIMITS.contradicting_fraction * abs(fit.mass_kg)
        far = far and abs(deviations) > LIMITS.contradicting_std
        misses = shows and abs(difference_kg) + fit.u_kg > 1.96 * std_kg
        out.append(Disagreement(method, float(deviations), contradicted=far or misses))
    return out


def list_nuisances_shared_with_methods(inputs: CheckInputs) -> set[str]:
    """Nuisances that the methods also model: the Coulomb term, or in one direction a constant."""
    if inputs.weighing is None or not inputs.machine.settings.forces.coulomb:
        return set()
    return {"direction" if inputs.weighing.fit.motion.drives_both_ways else "const"}


def _make_joint_fit_quantity_function(
    quantity: Callable[[Weighing], float],
) -> Callable[[CheckInputs, AxisMotion], float]:
    """Make a function that computes a check's number from the joint fit; NaN without one."""

    def compute_value(inputs: CheckInputs, _: AxisMotion) -> float:
        return np.nan if inputs.weighing is None else quantity(inputs.weighing)

    return compute_value


def _make_wheel_quantity_function(
    quantity: Callable[[WheelKinematics], float],
) -> Callable[[CheckInputs, AxisMotion], float]:
    """Make a function that computes a check's number from the comparison with the wheels."""

    def compute_value(inputs: CheckInputs, _: AxisMotion) -> float:
        wheels = None if inputs.weighing is None else inputs.weighing.fit.kinematics
        return np.nan if wheels is None else quantity(wheels)

    return compute_value


def _has_joint_fit(inputs: CheckInputs, _motion: AxisMotion) -> bool:
    return inputs.weighing is not None


def _has_wheel_kinematics(inputs: CheckInputs, _motion: AxisMotion) -> bool:
    return inputs.weighing is not None and inputs.weighing.fit.kinematics is not None


def _describe_remedy_for_early_force(inputs: CheckInputs, _motion: AxisMotion) -> str:
    """Remedy if the force is ahead of the acceleration, which is then probably delayed."""
    limit_s = inputs.machine.settings.verdict.lag_max_s
    if inputs.weighing is None or inputs.weighing.fit.force_delay_s >= -limit_s:
        return ""
    late = "specific_force_x_m_s2"
    if inputs.machine.settings.forces.acceleration == "kinematic":
        late = "speed_x_m_s" if inputs.machine.differentiates_speed else "acc_x_m_s2"
    return (
        f"channels.{late}.delay_s: the acceleration is late against the force, or "
        "channels.force_x_N.delay_s (or of both torques): the force is early"
    )


def compute_relative_mass_u_of_main_load(inputs: CheckInputs, _motion: AxisMotion) -> float:
    """Relative standard uncertainty of the load with the most manoeuvres."""
    weighing = inputs.weighing
    if weighing is None:
        return np.nan
    return compute_relative_load_mass_u(weighing, inputs.machine, weighing.fit.most_frequent_state)


def _find_term_farthest_from_prior(inputs: CheckInputs) -> tuple[str, float]:
    if inputs.weighing is None:
        return "", np.nan
    priors = inputs.machine.settings.priors.model_copy(update={"learnt": {}})
    return find_term_farthest_from_prior(inputs.weighing.fit_without_learnt_priors, priors)


def _describe_remedy_of_term_beyond_prior(inputs: CheckInputs, _motion: AxisMotion) -> str:
    name, widths = _find_term_farthest_from_prior(inputs)
    keys = next((each.prior_keys for each in NUISANCES if each.name == name), ())
    if not keys or widths <= inputs.machine.settings.verdict.beyond_prior_max:
        return ""
    wider = " or ".join(f"settings.priors.{key}" for key in keys)
    lacks_pitch = name in _OF_GROUND and "pitch_rad" not in inputs.machine.channels
    ground = "on uneven ground, give a pitch; " if lacks_pitch else ""
    return f"correct the cause that findings name; {ground}if it really is so large, widen {wider}"


def _describe_remedy_without_pitch(inputs: CheckInputs, _motion: AxisMotion) -> str:
    """Remedy if no pitch is measured: changing grades appear in the accelerometer alone."""
    if inputs.weighing is None or inputs.weighing.fit.motion.without_gravity is not None:
        return ""
    return (
        "on uneven ground, channels.pitch_rad; else channels.speed_x_m_s and "
        "channels.specific_force_x_m_s2: one machine, one time"
    )


def _read_mass_change_by_other_motion_sensor_over_u(
    inputs: CheckInputs, _motion: AxisMotion
) -> float | None:
    """Change of the mass with the other acceleration, in u; None without a comparison."""
    weighing = inputs.weighing
    other = None if weighing is None else weighing.other_motion
    return None if other is None else other.mass_shift_over_uncertainty


def _describe_fit_by_other_motion_sensor(inputs: CheckInputs, _motion: AxisMotion) -> str:
    weighing = inputs.weighing
    if weighing is None or weighing.other_motion is None:
        return ""
    one = "wheels" if weighing.fit.motion.by_accelerometer else "accelerometer"
    return f"with the {one} alone {weighing.other_motion.effect_text}"


def _count_methods_contradicted_by_joint_fit(inputs: CheckInputs, _motion: AxisMotion) -> float:
    return float(sum(each.contradicted for each in compare_methods_with_joint_fit(inputs)))


def compute_gating_bias_in_stds(inputs: CheckInputs, motion: AxisMotion) -> float:
    """Gated minus ungated pooled mass, in standard deviations; NaN if a spring biases both."""
    if inputs.totals is None or inputs.position_dependent_force_newtons is not None:
        return np.nan
    pooled = inputs.totals.filter(inputs.totals["method"] == "pooled")
    mass_kg, std_kg = (get_column_values(pooled, name) for name in ("mass_kg", "mass_std_kg"))
    if not mass_kg.size:
        return np.nan
    mean_difference_kg = abs(mass_kg[0] - motion.ungated_fit.value)
    u_kg = float(np.hypot(std_kg[0], motion.ungated_fit.std))
    return float(mean_difference_kg / u_kg) if u_kg > 0.0 else np.nan


def make_term_presence_check(name: str, term: str, meaning: str) -> CheckRow:
    """Check that reports whether the fit contains a term.

    Args:
        name: name of the check.
        term: name of the term in the fit.
        meaning: meaning of its number.
    """
    return CheckRow(
        name,
        "mass",
        _make_joint_fit_quantity_function(
            lambda weighing: weighing.fit_without_learnt_priors.abs_t_by_term.get(term, np.nan)
        ),
        meaning,
        maximum="term_t_max",
        applies=lambda inputs, _: (
            inputs.weighing is not None
            and term in inputs.weighing.fit_without_learnt_priors.abs_t_by_term
        ),
        consequence="tell",
        remedy="the fit has the term; mending its cause would narrow the answer",
    )


FIT_CHECKS: Final = (
    CheckRow(
        "relative_u",
        "mass",
        compute_relative_mass_u_of_main_load,
        "standard uncertainty of the mass over the mass",
        maximum="relative_std_max",
        applies=lambda inputs, _: inputs.totals is not None,  # frames alone have no answer
        subject_text=lambda inputs, _: NOTHING_FITTED if inputs.weighing is None else "",
        remedy="more starts at different throttles and both ways, or narrower settings.priors",
    ),
    CheckRow(
        "term_beyond_prior",
        "mass",
        lambda inputs, _: _find_term_farthest_from_prior(inputs)[1],
        "term farthest from its prior, in prior standard deviations; above the limit it "
        "absorbs a model error",
        maximum="beyond_prior_max",
        applies=_has_joint_fit,
        subject_text=lambda inputs, _: _find_term_farthest_from_prior(inputs)[0],
        remedy="the cause that findings name, or settings.priors: what the machine may have",
        own_remedy=_describe_remedy_of_term_beyond_prior,
    ),
    CheckRow(
        "filling",
        "mass",
        _make_joint_fit_quantity_function(lambda weighing: weighing.filling.load_growth_over_std),
        "evidence for a load that grows during every start, in standard deviations; 0 where it "
        "moves neither a mass nor the mean payload by its uncertainty",
        maximum="filling_max",
        optional=True,
        remedy="starts without digging or filling; else the force is late, or brakes release",
    ),
    CheckRow(
        "friction_sign",
        "mass",
        _make_joint_fit_quantity_function(lambda weighing: weighing.viscous_friction_t_value),
        "viscous friction over its standard deviation; negative friction is unphysical. Friction "
        f"that falls with the speed by at most {WEIGHING_LIMITS.falling_friction_1:.0%} of the "
        "largest force counts as 0",
        minimum="friction_t_min",
        applies=_has_joint_fit,
        remedy=_SIGN_REMEDY,
        own_remedy=lambda inputs, _: (
            "" if inputs.machine.settings.gate.exclude_braking else _UNSEEN_BRAKES + _SIGN_REMEDY
        ),
    ),
    CheckRow(
        "channel_noise",
        "mass",
        _make_joint_fit_quantity_function(lambda weighing: weighing.fit.posterior_fit.noise_share),
        "largest noise fraction among the fitted channels",
        maximum="channel_noise_max",
        applies=_has_joint_fit,
        remedy="an accelerometer, a lower settings.filter.cutoff_hz, or stronger starts",
    ),
    CheckRow(
        "force_delay_s",
        "mass",
        _make_joint_fit_quantity_function(lambda weighing: abs(weighing.fit.force_delay_s)),
        "magnitude of the estimated delay of the force, in s",
        maximum="lag_max_s",
        applies=_has_joint_fit,
        remedy="channels.force_x_N.delay_s (or of both torques)",
        own_remedy=_describe_remedy_for_early_force,
    ),
    CheckRow(
        "speed_delay_s",
        "mass",
        _make_wheel_quantity_function(lambda wheels: abs(wheels.delay_s[0])),
        "magnitude of the estimated delay of the speed behind the accelerometer, in s",
        maximum="lag_max_s",
        applies=_has_wheel_kinematics,
        remedy="channels.speed_x_m_s.delay_s",
    ),
    CheckRow(
        "wheel_imu_gain_error",
        "mass",
        _make_wheel_quantity_function(
            lambda wheels: abs(wheels.gain[0]) if wheels.is_gain_significant else 0.0
        ),
        "gain difference of wheel speed and accelerometer; either may be wrong",
        maximum="gain_max",
        applies=_has_wheel_kinematics,
        consequence="widen",
        remedy="machine.wheel_radius_m, machine.imu, or channels.specific_force_x_m_s2.scale",
    ),
    CheckRow(
        "wheel_imu_residual",
        "mass",
        _make_joint_fit_quantity_function(
            lambda weighing: compute_wheel_imu_disagreement_over_speed(weighing.fit)
        ),
        "residual of wheel speed against accelerometer beyond noise, as a fraction of the speed",
        maximum="wheels_max",
        applies=_has_wheel_kinematics,
        subject_text=_describe_fit_by_other_motion_sensor,
        compute_mass_change_over_u=_read_mass_change_by_other_motion_sensor_over_u,
        remedy="channels.speed_x_m_s and channels.specific_force_x_m_s2: one machine, one time",
        own_remedy=_describe_remedy_without_pitch,
    ),
    CheckRow(
        "manoeuvre_scatter",
        "mass",
        _make_joint_fit_quantity_function(lambda weighing: weighing.manoeuvre_scatter_over_noise),
        "scatter of manoeuvres about their load, over the scatter that their noise explains",
        maximum="scatter_max",
        applies=lambda inputs, _: (
            inputs.weighing is not None
            and np.isfinite(inputs.weighing.manoeuvre_scatter_over_noise)
        ),
        consequence="widen",
        remedy="machine.repeatability_kg, where it is known; starts that are alike",
    ),
    CheckRow(
        "common_misfit",
        "mass",
        _make_joint_fit_quantity_function(lambda weighing: weighing.fit.posterior_fit.misfit_ratio),
        "mean square of the residual common to all starts, over that of the noise",
        maximum="misfit_max",
        applies=lambda inputs, _: (
            inputs.weighing is not None and inputs.weighing.fit.posterior_fit.groups > 2
        ),
        consequence="widen",
        remedy="filters, brakes or tyres that the equation does not have",
    ),
    CheckRow(
        "force_nonlinearity",
        "mass",
        _make_joint_fit_quantity_function(lambda weighing: abs(weighing.curvature.t)),
        "t-value of a force proportional to a·|a|: the force is not linear in the acceleration",
        maximum="curvature_t_max",
        applies=_has_joint_fit,
        consequence="widen",
        remedy="force measured on all wheels, machine.force_share",
    ),
    CheckRow(
        "braking_bias",
        "mass",
        _make_joint_fit_quantity_function(
            lambda weighing: weighing.relative_mass_change_by_braking
        ),
        "relative change of the mass if braking is included; the sensor may miss some brakes",
        maximum="braking_max",
        optional=True,
        consequence="widen",
        remedy="settings.gate.exclude_braking = true",
    ),
    CheckRow(
        "disagreeing_methods",
        "mass",
        _count_methods_contradicted_by_joint_fit,
        "methods that disagree with the joint fit, or whose standard deviation is too small here",
        maximum="methods_max",
        applies=lambda inputs, _: (
            inputs.totals is not None
            and inputs.weighing is not None
            and inputs.weighing.fit.mass_count == 1
        ),
        consequence="method",
        remedy="none: those methods have no nuisance terms, and are not shown",
    ),
    CheckRow(
        "gating_bias",
        "mass",
        compute_gating_bias_in_stds,
        "pooled mass with and without gating: difference in standard deviations",
        maximum="gated_max",
        optional=True,
        consequence="tell",
        remedy="the model holds in a part of the motion only: see the gate's reasons",
    ),
    make_term_presence_check(
        "constant_force", "const", "t-value of a constant force: offset, tilt, slope or friction"
    ),
    make_term_presence_check("quadratic_drag", "quadratic", "t-value of a resistance in v·|v|"),
    make_term_presence_check("coulomb_friction", "direction", "t-value of Coulomb friction"),
)
