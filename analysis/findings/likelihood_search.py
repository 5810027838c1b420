"""Stepwise search for causes that raise the likelihood of the two equations.

At each step every cause is tried as one additional parameter besides mass, friction and the causes
selected before; the cause that raises the likelihood most is selected. Causes that would raise it
nearly as much are its rivals: this log cannot distinguish them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from analysis.findings.altered_motion import correct_channel_delay
from analysis.findings.constant_forces import explain_constant_force
from analysis.findings.finding_inputs import FindingInputs
from analysis.findings.finding_limits import LIMITS
from analysis.findings.refit import exclude_and_renumber_short_stretches
from analysis.findings.spikes import mark_samples_near_spikes
from analysis.findings.whitened_rows import (
    EquationRows,
    ProjectedEquation,
    build_whitened_force_rows,
    build_whitened_wheel_rows,
)
from analysis.weighing.friction_warming import WARMING
from analysis.weighing.motion_samples import MotionSamples
from analysis.weighing.swinging_mass import subtract_swing_force

#: Rows of the force equation, and of the wheel equation or None.
Equations = tuple[EquationRows, EquationRows | None]
#: Smallest parameter that counts, by cause.
_LEAST: Final = {
    **{f"delay:{channel}": LIMITS.min_delay_s for channel in ("force", "speed", "imu")},
    "wheel_radius": LIMITS.trusted_gain_1,
    "driveline": 0.01,
    "braking": 0.002,
    "gain_drift": 0.03,
}
#: Terms that Coulomb friction may appear as.
_FRICTION: Final = ("const", "direction")
#: Delays that have the same effect on the wheel equation, each with the other.
_BESIDE: Final = {"delay:speed": "delay:imu", "delay:imu": "delay:speed"}


@dataclass(frozen=True)
class FittedCause:
    """A candidate cause with its fitted parameter.

    Attributes:
        name: name of its column.
        value: fitted value of the parameter.
        std: standard deviation of the value.
        gain: increase of twice the log likelihood.
        rivals: names of causes with nearly the same gain.
        explained_1: fraction of the force's residual beyond the noise that it explains.
    """

    name: str
    value: float
    std: float
    gain: float
    rivals: tuple[str, ...]
    explained_1: float = 1.0


def rank_causes_by_likelihood(inputs: FindingInputs) -> Mapping[str, FittedCause]:
    """Causes by name, the selected ones first, then by their gain in likelihood."""
    if "selected_causes" not in inputs.cache:
        inputs.cache["selected_causes"] = _select_causes_stepwise(inputs)
    return inputs.cache["selected_causes"]  # type: ignore[return-value]


def _select_causes_stepwise(inputs: FindingInputs) -> dict[str, FittedCause]:
    fit, noise = inputs.fit_without_learnt_priors, inputs.column_noise
    if fit is None or noise is None or explain_constant_force(inputs).motion is None:
        return {}
    motion = subtract_swing_force(explain_constant_force(inputs).motion or fit.motion, fit)
    near = mark_samples_near_spikes(inputs)
    if near.any():  # a spike is no motion, whatever it looks like
        motion = exclude_and_renumber_short_stretches(motion.exclude_samples(near))
        if not motion.is_fittable.any():  # there are spikes all along
            return {}
    taken: list[str] = []
    out: dict[str, FittedCause] = {}
    uncorrected = motion
    late = _test_delay_beyond_linearisation(inputs, motion)
    if late is not None:
        motion, found = correct_delay_iteratively(inputs, motion, taken, late)
        out[late.name] = replace(found, gain=late.gain)
        taken.append(late.name)
    equations = build_whitened_equations(inputs, motion)
    for _ in range(LIMITS.max_picked_causes):
        tried = score_remaining_causes(equations, taken)
        if not tried:
            break
        best = _choose_most_likely_cause(tried)
        if best.gain < LIMITS.picked_gain:
            out.update(
                {name: fitted_cause for name, fitted_cause in tried.items() if name not in out}
            )
            break
        found = best
        rivals = {
            name
            for name, fitted_cause in tried.items()
            if best.gain - fitted_cause.gain < choose_indistinguishable_likelihood_gain(best, name)
            and is_physical(fitted_cause)
        }
        if best.name.startswith("delay"):
            begun = motion
            motion, found = correct_delay_iteratively(inputs, begun, taken, best)
            if best.name in _BESIDE and _BESIDE[best.name] in tried:
                motion, found, other = decide_if_wheels_or_imu_are_delayed(
                    inputs, begun, taken, (motion, found)
                )
                rivals = rivals - {*_BESIDE} | {*other}
            equations = build_whitened_equations(inputs, motion)
        rivals -= {found.name, *out}
        out[found.name] = replace(
            found, gain=best.gain, rivals=tuple(n for n in tried if n in rivals)
        )
        taken.append(found.name)
    else:
        out.update(
            {n: p for n, p in score_remaining_causes(equations, taken).items() if n not in out}
        )
    return out | _refit_selected_delays_and_friction(
        inputs, uncorrected, {name: out[name] for name in taken}
    )


def _refit_selected_delays_and_friction(
    inputs: FindingInputs, uncorrected: MotionSamples, selected_causes: Mapping[str, FittedCause]
) -> dict[str, FittedCause]:
    """Refit the selected delays and Coulomb friction, each jointly with all others.

    The one selected first was fitted without the other, and both change stepwise where the motion
    reverses.
    """
    delays = [name for name in selected_causes if name.startswith("delay")]
    frictions = [name for name in selected_causes if name in _FRICTION]
    if not delays or not frictions:
        return {}
    refitted: dict[str, FittedCause] = {}
    motion = uncorrected
    for name in delays:
        others = [other for other in selected_causes if other != name]
        motion, delay = correct_delay_iteratively(inputs, motion, others, selected_causes[name])
        refitted[name] = delay
    equations = build_whitened_equations(inputs, motion)
    for name in frictions:
        again = score_remaining_causes(
            equations, [other for other in selected_causes if other != name]
        )
        if name in again:
            refitted[name] = replace(
                selected_causes[name], value=again[name].value, std=again[name].std
            )
    return refitted


def choose_indistinguishable_likelihood_gain(best_cause: FittedCause, cause_name: str) -> float:
    """Difference of gains below which two causes cannot be distinguished."""
    # at constant throttle, brakes also look like a constant force, or like one that is nonlinear
    # in the acceleration
    pair = {best_cause.name, cause_name}
    alike = "braking" in pair and pair & {"const", "direction", "driveline"}
    return (
        max(
            LIMITS.indistinguishable_gain, LIMITS.indistinguishable_brake_fraction * best_cause.gain
        )
        if alike
        else LIMITS.indistinguishable_gain
    )


def _choose_most_likely_cause(candidates: Mapping[str, FittedCause]) -> FittedCause:
    """Candidate with the largest gain; among equals, one that is physical and matters."""
    best = max(candidates.values(), key=lambda fitted_cause: fitted_cause.gain)
    if is_physical(best) and abs(best.value) >= _LEAST.get(best.name, 0.0):
        return best
    others = [
        fitted_cause
        for fitted_cause in candidates.values()
        if best.gain - fitted_cause.gain
        < choose_indistinguishable_likelihood_gain(best, fitted_cause.name)
        and is_physical(fitted_cause)
        and abs(fitted_cause.value) >= _LEAST.get(fitted_cause.name, 0.0)
        and fitted_cause.gain >= LIMITS.picked_gain
    ]
    return max(others, key=lambda fitted_cause: fitted_cause.gain, default=best)


def is_physical(fitted_cause: FittedCause) -> bool:
    """Whether the value is possible, such as wheels that slip forwards while they drive."""
    if fitted_cause.name == "driveline":
        return abs(fitted_cause.value) <= LIMITS.max_share_change_s2_m
    return fitted_cause.name != "slip" or fitted_cause.value > 0.0


def explains_nonlinear_force(fitted_cause: FittedCause) -> bool:
    """Whether a share that changes with the acceleration is possible, and explains the misfit."""
    return (
        is_physical(fitted_cause)
        and fitted_cause.explained_1 >= LIMITS.min_share_change_explained_1
    )


def _test_delay_beyond_linearisation(
    inputs: FindingInputs, motion: MotionSamples
) -> FittedCause | None:
    """Test a delay that is too long to be linearised, with the lag of the joint fit."""
    fit = inputs.fit_without_learnt_priors
    if fit is None or abs(fit.force_delay_s) < LIMITS.long_delay_s:
        return None
    late = correct_channel_delay(motion, "force", fit.force_delay_s)
    before, without = project_out_selected_causes(build_whitened_equations(inputs, motion))
    after, _ = project_out_selected_causes(build_whitened_equations(inputs, late))
    if (
        before.square_left * before.variance
        < (1.0 + LIMITS.long_delay_residual_ratio) * after.square_left * after.variance
    ):
        return None
    # the wheels show whether the accelerometer is early or late instead
    turned = correct_channel_delay(motion, "imu", -fit.force_delay_s)
    _, with_it = project_out_selected_causes(build_whitened_equations(inputs, turned))
    by_imu = (
        without is not None
        and with_it is not None
        and with_it.square_left * with_it.variance < without.square_left * without.variance
    )
    gain = before.square_left * before.variance / after.variance - after.square_left
    if by_imu:
        return FittedCause("delay:imu", -fit.force_delay_s, 1e-3, gain, ())
    return FittedCause("delay:force", fit.force_delay_s, 1e-3, gain, ())


def correct_delay_iteratively(
    inputs: FindingInputs,
    motion: MotionSamples,
    selected_causes: list[str],
    delay_cause: FittedCause,
) -> tuple[MotionSamples, FittedCause]:
    """Correct a channel's delay until it converges; return the motion and the total delay."""
    channel, total, std = delay_cause.name.partition(":")[2], 0.0, delay_cause.std
    begun, step = motion, delay_cause.value
    for _ in range(LIMITS.delay_rounds):
        total = float(
            np.clip(
                total + step, -LIMITS.longest_likelihood_delay_s, LIMITS.longest_likelihood_delay_s
            )
        )
        motion = correct_channel_delay(begun, channel, total)
        again = score_remaining_causes(
            build_whitened_equations(inputs, motion), selected_causes
        ).get(delay_cause.name)
        if again is None:
            break
        step, std = again.value, again.std
        if abs(step) < LIMITS.delay_tolerance_s:
            break
    return motion, replace(delay_cause, value=total, std=std)


def decide_if_wheels_or_imu_are_delayed(
    inputs: FindingInputs,
    uncorrected: MotionSamples,
    selected_causes: list[str],
    corrected_motion_and_delay: tuple[MotionSamples, FittedCause],
) -> tuple[MotionSamples, FittedCause, tuple[str, ...]]:
    """Decide whether the wheels are early or the accelerometer is late.

    Both have the same effect on the wheel equation; the force distinguishes them.

    Args:
        inputs: the log.
        uncorrected: motion before any correction.
        selected_causes: causes found before.
        corrected_motion_and_delay: corrected motion and the delay that was found.

    Returns:
        The motion and delay with the smaller force residual, and the name of the other delay if it
        is nearly as good.
    """
    motion, own = corrected_motion_and_delay
    turned = replace(own, name=_BESIDE[own.name], value=-own.value)
    other = correct_channel_delay(uncorrected, turned.name.partition(":")[2], turned.value)
    # the full delays are compared: noise of the force's derivative makes a fitted delay too small
    left, left_other = (
        project_out_selected_causes(build_whitened_equations(inputs, each), selected_causes)[0]
        for each in (motion, other)
    )
    apart = left.square_left * left.variance - left_other.square_left * left_other.variance
    apart /= min(left.variance, left_other.variance)
    near = abs(apart) < LIMITS.indistinguishable_gain
    if apart > 0.0:
        return other, turned, (own.name,) if near else ()
    return motion, own, (turned.name,) if near else ()


def score_remaining_causes(
    equations: Equations, selected_causes: list[str]
) -> dict[str, FittedCause]:
    """Score every remaining cause in addition to those already selected."""
    force, wheels = project_out_selected_causes(equations, selected_causes)
    # wheels that disagree with the accelerometer, as on hills without a pitch, are not used
    together = wheels is not None and wheels.variance < LIMITS.wheel_noise_ratio
    parts = [force, wheels] if wheels is not None and together else [force]
    names = list(dict.fromkeys(name for part in parts for name in part.information))
    out: dict[str, FittedCause] = {}
    for name in names:
        if name in selected_causes:
            continue
        square = sum(part.get_information_left_about_cause(name) for part in parts)
        if not square > 0.0:
            continue
        value = sum(part.get_likelihood_score_left_of_cause(name) for part in parts) / square
        explained = value**2 * force.get_information_left_about_cause(name) * force.variance
        left = force.square_left * force.variance
        # noise is known to some ten per cent
        misfits = left > LIMITS.min_misfit_ratio * force.row_count
        explained_1 = explained / (left - force.row_count) if misfits else 1.0
        out[name] = FittedCause(name, value, square**-0.5, value**2 * square, (), explained_1)
    return out


def build_whitened_equations(inputs: FindingInputs, motion: MotionSamples) -> Equations:
    """Whitened rows of the force equation and of the wheel equation.

    The wheel equation is None without an accelerometer.
    """
    fit, noise = inputs.fit_without_learnt_priors, inputs.column_noise
    assert fit is not None
    assert noise is not None
    force = build_whitened_force_rows(
        motion,
        noise,
        inputs.look_up_mass_of_samples_kg(motion),
        max(fit.viscous_friction, 0.0),
        includes_braking=not inputs.machine.settings.gate.exclude_braking,
    )
    if not inputs.has_accelerometer:
        # an acceleration derived from the speed has the delay of the speed
        del force.columns["delay:imu"]
    return force, build_whitened_wheel_rows(motion, noise)


def project_out_selected_causes(
    equations: Equations, selected_causes: Sequence[str] = ()
) -> tuple[ProjectedEquation, ProjectedEquation | None]:
    """Force and wheel equations with the selected causes projected out."""
    force, wheels = equations
    project_out = ProjectedEquation.project_out
    return (
        project_out(force, selected_causes),
        None if wheels is None else project_out(wheels, selected_causes),
    )


def list_indistinguishable_causes(fitted_cause: FittedCause) -> tuple[str, ...]:
    """Keys of the causes that this log cannot distinguish from a given one."""
    keys = {"const": "coulomb", "direction": "coulomb", "braking": "braking_inside"}
    own = keys.get(fitted_cause.name, fitted_cause.name.partition(":")[0])
    named = (keys.get(name, name.partition(":")[0]) for name in fitted_cause.rivals)
    return tuple(key for key in dict.fromkeys(named) if key not in (own, *WARMING))
