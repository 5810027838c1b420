"""Causes found by terms of the joint fit other than mass and friction."""

from dataclasses import replace

import numpy as np
import polars as pl

from analysis.findings.cause import MassChange, Symptom
from analysis.findings.changing_loads import compare_force_change_with_load_changes
from analysis.findings.constant_forces import explain_constant_force, has_pitch_channel
from analysis.findings.finding_inputs import FindingInputs
from analysis.findings.finding_limits import LIMITS
from analysis.findings.likelihood_search import (
    FittedCause,
    explains_nonlinear_force,
    list_indistinguishable_causes,
    rank_causes_by_likelihood,
)
from analysis.findings.mass_drifts import find_drift_among_loads
from analysis.findings.refit import compute_mass_change_by_refit
from analysis.model.physical_units import find_gain_and_offset_to_si
from analysis.model.schema import CHANNEL_COLUMNS
from analysis.stages.stage_limits import LIMITS as STAGE_LIMITS
from analysis.weighing.joint_result import find_term_index
from analysis.weighing.motion_samples import MotionSamples
from estimators.errors import format_count


def find_wrong_wheel_radius(inputs: FindingInputs) -> list[Symptom]:
    """Find a wrong wheel radius: the wheels then disagree with the accelerometer.

    The radius scales the force as well.
    """
    fitted = rank_causes_by_likelihood(inputs).get("wheel_radius")
    if fitted is None or fitted.value <= -1.0:  # no radius corrects such wheels
        return []
    gain, std = fitted.value, fitted.std
    body = inputs.machine.machine
    torques = bool(inputs.select_measured_channels("torque_left_N_m", "torque_right_N_m"))
    setting, value = [], []
    if body.wheel_radius_m is not None and torques:
        setting, value = ["machine.wheel_radius_m"], [f"{body.wheel_radius_m / (1.0 + gain):.5g}"]
    # a body that pitches adds gravity to the accelerometer's reading
    may_squat = gain < 0.0 and "pitch_rad" not in inputs.unfiltered_readings
    squat = ", or the body pitches as it accelerates (channels.pitch_rad)" if may_squat else ""
    keys, scales = inputs.propose_scale_settings(inputs.speed_channels, 1.0 / (1.0 + gain))

    def correct_wheel_radius_of_motion(motion: MotionSamples) -> MotionSamples:
        force = motion.force * (1.0 + gain) if torques else motion.force
        return replace(motion, force=force, speed=motion.speed / (1.0 + gain))

    return [
        Symptom(
            min(
                float(np.sqrt(fitted.gain)) / LIMITS.wheel_radius_min_std,
                abs(gain) / LIMITS.trusted_gain_1,
            ),
            f"the wheels' speed changes by {gain:+.2%} ± {std:.2%} more than the accelerometer "
            f"measures: the wheel radius or the accelerometer's scale is wrong{squat}",
            channel=next(iter(inputs.speed_channels), None),
            setting=", ".join([*setting, *([keys] if keys else [])]) or None,
            value=", ".join([*value, *([scales] if keys else [])]) or None,
            change=lambda: compute_mass_change_by_refit(
                inputs, correct_wheel_radius_of_motion, min(std / abs(gain), 1.0)
            ),
            # an accelerometer that reads too much may rock on its mount
            alternatives=(
                *list_indistinguishable_causes(fitted),
                *(("imu_loose",) if gain < -LIMITS.rocking_imu_fraction else ()),
            ),
        )
    ]


def find_force_sensor_offset(inputs: FindingInputs) -> list[Symptom]:
    """Find a force at standstill that is also present in motion."""
    seen = explain_constant_force(inputs)
    fit, (rest, std) = inputs.fit_without_learnt_priors, seen.rest_N
    if not np.isfinite(rest):
        return _find_constant_force(inputs)
    if seen.offset is False or fit is None:
        return []
    strength = abs(rest) / max(
        LIMITS.standing_reading_std * std,
        LIMITS.standing_reading_fraction * fit.motion.force_95_percentile_newtons,
    )
    names = inputs.select_measured_channels("force_x_N") or inputs.select_measured_channels(
        "torque_left_N_m", "torque_right_N_m"
    )
    average_at_rest = inputs.compute_mean_and_std_of_column_at_rest
    return [
        Symptom(
            float(strength),
            f"at standstill the force reads {rest:+.0f} ± {std:.0f} N, and driving has the same "
            "offset",
            channel=inputs.force_channel,
            setting=", ".join(f"channels.{name}.offset" for name in names) or None,
            value=", ".join(
                _format_offset_setting(inputs, name, average_at_rest(name)[0]) for name in names
            )
            or None,
            change=lambda: compute_mass_change_by_refit(
                inputs,
                lambda motion: replace(motion, force=motion.force - rest),
                min(std / abs(rest), 1.0),
            ),
            alternatives=() if seen.offset else ("coulomb",),
        )
    ]


def _format_offset_setting(inputs: FindingInputs, name: str, reading_at_rest: float) -> str:
    """Offset of the channel that makes its reading at rest zero, as TOML."""
    channel = inputs.machine.channels[name]
    if channel.unit is None:
        return f"{channel.offset - reading_at_rest:.6g}"
    unit = next(column.unit for column in CHANNEL_COLUMNS if column.name == name)
    gain, _ = find_gain_and_offset_to_si(channel.unit, unit)
    return f"{channel.offset - reading_at_rest / gain:.6g}"


def _find_constant_force(inputs: FindingInputs) -> list[Symptom]:
    """Report a constant force whose cause is open because the machine never stands."""
    fit = inputs.fit_without_learnt_priors
    if fit is None:
        return []
    const, std = (float(each[find_term_index("const", fit.terms)]) for each in fit.term_posteriors)
    imu = ("imu_misaligned", "imu_bias") if fit.motion.by_accelerometer else ()
    return [
        Symptom(
            abs(const) / (LIMITS.term_min_std * std),
            f"driving shows a constant force of {format_force_and_std(const, std, sign='+')}",
            channel=inputs.force_channel,
            alternatives=(*imu, "slope", "coulomb"),
        )
    ]


def find_coulomb_friction(inputs: FindingInputs) -> list[Symptom]:
    """Find a constant force against the direction of motion."""
    fit, found = inputs.fit_without_learnt_priors, rank_causes_by_likelihood(inputs)
    if fit is None or inputs.machine.settings.forces.coulomb:  # already in the model
        return []
    motion = fit.motion
    name = "direction" if motion.drives_both_ways else "const"
    way = 1.0 if motion.drives_both_ways else float(np.median(motion.direction[motion.is_fittable]))
    fitted = found.get(name) or read_fitted_cause_from_joint_fit(inputs, name)
    if fitted is None or fitted.value * way <= 0.0:
        return []
    force = fitted.value * way
    prior = "direction_share" if motion.drives_both_ways else "const_share"
    share = max(
        getattr(inputs.machine.settings.priors, prior), force / motion.force_95_percentile_newtons
    )
    others = list_indistinguishable_causes(fitted)
    seen = explain_constant_force(inputs)
    unknown = () if np.isfinite(seen.rest_N[0]) else ("offset",)
    return [
        Symptom(
            min(
                float(np.sqrt(fitted.gain)) / LIMITS.term_min_std,
                force / (LIMITS.trusted_coulomb_fraction * motion.force_95_percentile_newtons),
            ),
            f"{format_force_and_std(force, fitted.std)} of friction oppose the motion at any speed",
            setting=f"settings.forces.coulomb, settings.priors.{prior}",
            value=f"true, {share:.3f}",
            change=lambda: estimate_mass_change_without_coulomb(inputs, force, fitted.std, others),
            alternatives=tuple(dict.fromkeys((*others, *unknown))),
        )
    ]


def format_force_and_std(force_N: float, std_N: float, sign: str = "-") -> str:
    """Force and its standard deviation as text, to 1 N or to the first digit of the deviation."""
    places = max(0, -int(np.floor(np.log10(std_N)))) if 0.0 < std_N < 1.0 else 0
    return f"{force_N:{sign}.{places}f} ± {std_N:.{places}f} N"


def read_fitted_cause_from_joint_fit(inputs: FindingInputs, term_name: str) -> FittedCause | None:
    """Term of the joint fit as a fitted cause, minus the part that standstill explains.

    If all starts use one throttle, only the priors of the fit separate it from mass and friction.
    """
    fit, seen = inputs.fit_without_learnt_priors, explain_constant_force(inputs)
    names = [] if fit is None else [term.name for term in fit.terms]
    if fit is None or term_name not in names or not np.isfinite(seen.rest_N[0]):
        return None
    value, std = (float(each[names.index(term_name)]) for each in fit.term_posteriors)
    if term_name == "const":
        value -= 0.0 if seen.acts_only_at_rest else seen.rest_N[0]
        value += fit.mass_kg * float(np.nan_to_num(seen.error_m_s2[0]))
    return FittedCause(term_name, value, std, (value / std) ** 2, ())


def estimate_mass_change_without_coulomb(
    inputs: FindingInputs, force: float, std: float, rival_terms: tuple[str, ...]
) -> MassChange | None:
    """Change of the mass if Coulomb friction is removed; u includes braking as another cause."""
    change = compute_mass_change_by_refit(
        inputs,
        lambda motion: replace(motion, force=motion.force - force * motion.direction),
        min(std / force, 1.0),
    )
    weighing = inputs.check_inputs.weighing
    if change is None or weighing is None or "braking_inside" not in rival_terms:
        return change
    return MassChange(change.kg, float(np.hypot(change.u_kg, weighing.braking_kg)))


def _bound_mass_change_by_wheel_slip(inputs: FindingInputs) -> MassChange | None:
    fit = inputs.fit_without_learnt_priors
    return None if fit is None else MassChange(0.0, 0.5 * fit.u_kg)


def find_wheel_slip(inputs: FindingInputs) -> list[Symptom]:
    """Find wheels that turn faster than the ground speed while they pull."""
    fitted, fit = rank_causes_by_likelihood(inputs).get("slip"), inputs.fit_without_learnt_priors
    if fitted is None or fit is None or fitted.value <= 0.0:
        return []
    at = fitted.value * fit.motion.force_95_percentile_newtons
    if at > LIMITS.max_slip_1:
        return []
    return [
        Symptom(
            min(float(np.sqrt(fitted.gain)) / LIMITS.term_min_std, at / 0.005),
            f"the wheels slip by {at:.2%} ± {at * fitted.std / fitted.value:.2%} of their speed at "
            "full force",
            channel=next(iter(inputs.speed_channels), None),
            change=lambda: _bound_mass_change_by_wheel_slip(inputs),
            alternatives=list_indistinguishable_causes(fitted),
        )
    ]


def find_driveline_nonlinearity(inputs: FindingInputs) -> list[Symptom]:
    """Find a force that is nonlinear in the acceleration, by load transfer or drive losses."""
    found = find_gain_drift_if_loads_follow_direction(inputs)
    fitted = rank_causes_by_likelihood(inputs).get("driveline")
    if fitted is not None and explains_nonlinear_force(fitted):
        found.append(
            Symptom(
                min(
                    float(np.sqrt(fitted.gain)) / LIMITS.term_min_std,
                    abs(fitted.value) / LIMITS.trusted_share_change_s2_m,
                ),
                _format_gain_change(fitted.value, fitted.std),
                channel=inputs.force_channel,
                change=lambda: compute_mass_change_by_refit(
                    inputs,
                    lambda motion: replace(
                        motion, force=motion.force * (1.0 - fitted.value * motion.acceleration)
                    ),
                    1.0,
                ),
                alternatives=list_indistinguishable_causes(fitted),
            )
        )
    return [max(found, key=lambda sign: sign.strength)] if found else []


def find_force_gain_drift(inputs: FindingInputs) -> list[Symptom]:
    """Find a force gain that changes over the log, or a load that changes steadily."""
    fit = inputs.fit_without_learnt_priors
    if fit is None or fit.mass_count > 1:
        return find_drift_among_loads(inputs)
    fitted = rank_causes_by_likelihood(inputs).get("gain_drift")
    if fitted is None:
        return []
    return [
        Symptom(
            min(
                float(np.sqrt(fitted.gain)) / LIMITS.term_min_std,
                abs(fitted.value) / LIMITS.trusted_gain_drift_1,
            ),
            f"force over acceleration changes by {fitted.value:+.1%} ± {fitted.std:.1%} from the "
            "beginning of the log to its end: the force's gain drifts, or the load changes",
            channel=inputs.force_channel,
            # the masses contain its mean over the log
            change=lambda: MassChange(0.0, abs(fitted.value) / 2.0 * abs(fit.mass_kg)),
            alternatives=list_indistinguishable_causes(fitted),
        )
    ]


def _format_gain_change(gain_change: float, std: float) -> str:
    return f"the measured share of the force changes by {gain_change:+.2%} ± {std:.2%} per m/s²"


def find_gain_drift_if_loads_follow_direction(inputs: FindingInputs) -> list[Symptom]:
    """Find a gain drift in logs whose loads alternate with the driving direction."""
    found = compare_force_change_with_load_changes(inputs)
    if found is None or found.log_likelihood_gain_of_several_loads > LIMITS.indistinguishable_gain:
        return []
    return [
        Symptom(
            min(
                float(np.sqrt(found.log_likelihood_gain)) / LIMITS.term_min_std,
                abs(found.value) / LIMITS.trusted_share_change_s2_m,
            ),
            f"{_format_gain_change(found.value, found.std)}, and there is one load, or there are "
            f"{found.load_count} that depend on the direction: this log cannot distinguish the two",
            channel=inputs.force_channel,
        )
    ]


def compute_relative_mass_u_of_answer(inputs: FindingInputs) -> float:
    """Relative standard uncertainty of the answer; infinite without an answer."""
    weighing = inputs.check_inputs.weighing
    if weighing is None:
        return float("inf")
    fit = weighing.fit
    parts = fit.compute_u_by_cause_kg(fit.make_mass_coefficients_of_state(fit.most_frequent_state))
    # without the gain, which is another cause and does not improve with more starts
    u_kg = float(np.linalg.norm([part for name, part in parts.items() if name != "gain"]))
    return u_kg / abs(fit.mass_kg)


def find_lack_of_excitation(inputs: FindingInputs) -> list[Symptom]:
    """Find too little excitation: no accepted stretch, or a very uncertain answer."""
    if inputs.check_inputs.weighing is None:
        stretches = inputs.value_by_check.get("accepted_stretches", 0.0)
        return [Symptom(2.0, f"{stretches:.0f} stretches were accepted: there is nothing to fit")]
    share = compute_relative_mass_u_of_answer(inputs)
    return [
        Symptom(
            share / LIMITS.poor_answer_u,
            f"the standard uncertainty of the mass is {share:.1%} of it",
        )
    ]


def find_terms_inseparable_from_mass(inputs: FindingInputs) -> list[Symptom]:
    """Find terms that the motion cannot separate from the mass."""
    fit = inputs.fit_without_learnt_priors
    if fit is None:
        return []
    parts = fit.compute_u_by_cause_kg(fit.make_mass_coefficients_of_state(fit.most_frequent_state))
    by_term = {term.name: parts[term.name] for term in fit.terms}
    worst = max(by_term, key=lambda name: by_term[name])
    share = float(np.linalg.norm(list(by_term.values()))) / abs(fit.mass_kg)
    return [
        Symptom(
            share / LIMITS.open_mass_fraction,
            f"{share:.1%} of the mass is determined by priors rather than by the motion, mostly by "
            f"that of {worst}",
        )
    ]


def find_braking_fitted_as_driving(inputs: FindingInputs) -> list[Symptom]:
    """Find braking that is fitted as driving and changes the mass."""
    weighing = inputs.check_inputs.weighing
    if weighing is None or not np.isfinite(weighing.braking_kg):
        return []
    left = 0.0 if weighing.braking_left_out else -weighing.braking_kg
    fitted = None if weighing.braking_left_out else rank_causes_by_likelihood(inputs).get("braking")
    slope = "" if has_pitch_channel(inputs) else ", or the machine brakes on a slope"
    if fitted is None:  # only the comparison with driving is available
        strength = float(abs(weighing.braking_kg) / (LIMITS.braking_change_u * weighing.fit.u_kg))
        share = ""
    else:
        strength = min(
            float(np.sqrt(fitted.gain)) / LIMITS.term_min_std,
            fitted.value / LIMITS.seen_braking_fraction,
        )
        share = f" ({fitted.value:.2%} ± {fitted.std:.2%} is not measured)"
    return [
        Symptom(
            strength,
            f"including braking changes a mass by {weighing.braking_kg:+.0f} kg: the force sensor "
            f"does not measure all of the braking{share}{slope}",
            setting="settings.gate.exclude_braking",
            value="true",
            change=lambda: MassChange(left, LIMITS.braking_u_ratio * weighing.fit.u_kg),
            alternatives=() if fitted is None else list_indistinguishable_causes(fitted),
        )
    ]


def find_external_force(inputs: FindingInputs) -> list[Symptom]:
    """Find starts against an external force, such as a pile."""
    body = inputs.machine.machine
    least_N = LIMITS.pile_weight_fraction * body.gravity_m_s2 * (body.empty_mass_kg or 0.0)
    digging = inputs.digging_stretches.filter(pl.col("growth_N") > least_N)
    if digging.is_empty():
        return []
    growth, std = (digging[name].to_numpy() for name in ("growth_N", "growth_std_N"))
    excess = growth / std
    worst = int(np.argmax(excess))
    start, end = (int(digging[name][worst]) for name in ("start_t_ns", "end_t_ns"))
    return [
        Symptom(
            float(excess[worst]) / STAGE_LIMITS.pile_min_growth_std * np.sqrt(digging.height),
            f"in {format_count(digging.height, 'start')} a resistance grows, by up to "
            f"{growth[worst]:.0f} ± {std[worst]:.0f} N; these starts are excluded",
            channel=inputs.force_channel,
            span_ns=(start, end),
        )
    ]
