"""Change of the mass if a cause is corrected, by refitting a corrected motion.

One refit costs a fraction of a replay. The other effects of a replay (different accepted windows, a
different mean) are included in the uncertainty.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from analysis.findings.cause import MassChange
from analysis.findings.finding_inputs import FindingInputs
from analysis.findings.finding_limits import LIMITS
from analysis.model.prior_settings import PriorSettings
from analysis.weighing.fitted_stretches import mark_stretch_starts
from analysis.weighing.joint_fit import refit_with_extra_terms
from analysis.weighing.joint_result import JointFit
from analysis.weighing.motion_samples import ColumnNoiseModel, MotionSamples
from analysis.weighing.wheel_comparison import compare_wheels_with_accelerometer
from analysis.weighing.wheel_kinematics import WheelKinematics
from estimators.arrays import Bools, Floats

MotionCorrection = Callable[[MotionSamples], MotionSamples]


def compute_mass_change_by_refit_without_samples(
    inputs: FindingInputs, excluded_rows: Bools
) -> MassChange | None:
    """Change of the mass without some samples; its u allows for a replay with other starts.

    Args:
        inputs: the log.
        excluded_rows: (n,) True for grid samples to exclude.
    """
    return compute_mass_change_by_refit_with_answer_u(
        inputs, lambda motion: motion.exclude_samples(excluded_rows), LIMITS.cut_start_u
    )


def compute_mass_change_by_refit_with_answer_u(
    inputs: FindingInputs, correct_motion: MotionCorrection, relative_u: float = 0.0
) -> MassChange | None:
    """Change of the mass by a refit of the corrected motion, with the answer's u added to its u.

    The addition allows for a replay that accepts other starts than this refit.

    Args:
        inputs: the log.
        correct_motion: returns the corrected motion.
        relative_u: see `compute_mass_change_by_refit`.
    """
    change = compute_mass_change_by_refit(inputs, correct_motion, relative_u)
    if change is None or inputs.fit_without_learnt_priors is None:
        return None
    return MassChange(
        change.kg, float(np.hypot(change.u_kg, inputs.fit_without_learnt_priors.u_kg))
    )


def compute_mass_change_by_refit(
    inputs: FindingInputs, correct_motion: MotionCorrection, relative_u: float = 0.0
) -> MassChange | None:
    """Change of the mass by a refit of the corrected motion, starting from the joint fit.

    Args:
        inputs: the log.
        correct_motion: returns the corrected motion.
        relative_u: relative standard uncertainty of the correction.
    """
    fit = inputs.fit_without_learnt_priors
    if fit is None:
        return None
    before, after = (
        get_uncorrected_mass_kg(inputs, fit),
        _refit_mass_kg(inputs, correct_motion(fit.motion)),
    )
    if before is None or after is None:
        return None
    kg = after - before
    of_noise = fit.compute_u_by_cause_kg(
        fit.make_mass_coefficients_of_state(fit.most_frequent_state)
    )["noise"]
    return MassChange(
        kg,
        float(
            np.hypot(max(relative_u, LIMITS.change_u) * kg, LIMITS.replay_std_fraction * of_noise)
        ),
    )


def get_uncorrected_mass_kg(inputs: FindingInputs, fit: JointFit) -> float | None:
    """Mass before the correction: of the whole fit, or of the refitted part of a long log."""
    if "refitted" not in inputs.cache:
        whole = (
            np.unique(fit.motion.stretch_of_sample[fit.motion.is_fittable]).size
            <= LIMITS.refit_max_stretches
        )
        if whole and fit.states is not None:
            inputs.cache["states"] = fit.states.state_count
        if whole:
            inputs.cache["wheels"] = fit.kinematics
        inputs.cache["refitted"] = fit.mass_kg if whole else _refit_mass_kg(inputs, fit.motion)
    return inputs.cache["refitted"]  # type: ignore[return-value]


def _refit_mass_kg(inputs: FindingInputs, motion: MotionSamples) -> float | None:
    """Mass of a corrected motion by a refit, over the first stretches only of a long log."""
    fit, noise = inputs.fit_without_learnt_priors, inputs.column_noise
    if fit is None or noise is None:
        return None
    priors = inputs.machine.settings.priors
    known = do_wheels_and_imu_still_agree(fit.motion, motion)
    # in a long log a part is enough to show the effect of a cause
    motion = exclude_and_renumber_short_stretches(
        motion.cut_to_first_stretches(LIMITS.refit_max_stretches)
    )
    if motion.is_fittable.sum() < LIMITS.refit_min_samples or not motion.has_enough_motion:
        return None
    motion = motion.drop_samples_far_from_fitted(LIMITS.refit_reach_s)
    states = None if fit.states is None else fit.states.reassign_to_manoeuvres_of_motion(motion)
    if states is not None and states.state_count != inputs.cache.setdefault(
        "states", states.state_count
    ):
        return None
    earlier = inputs.cache.get("wheels")
    wheels = earlier if isinstance(earlier, WheelKinematics) else fit.kinematics
    if not known or earlier is None:
        wheels = compare_wheels_with_accelerometer(motion, noise, priors, wheels)
    if known:
        inputs.cache["wheels"] = wheels
    begun = replace(fit, motion=motion, kinematics=wheels, states=states)
    found = refit_from_earlier_fit(begun, noise, priors, is_lag_known=known).mass_kg
    return found if np.isfinite(found) else None


def do_wheels_and_imu_still_agree(
    motion_before: MotionSamples, motion_after: MotionSamples
) -> bool:
    """Whether a correction leaves the agreement of wheels and accelerometer unchanged.

    A constant change of the accelerometer is ignored, since the comparison removes it.
    """
    if not (
        motion_after.speed is motion_before.speed
        and motion_after.force is motion_before.force
        and motion_after.stretch_of_sample is motion_before.stretch_of_sample
    ):
        return False
    pairs = (
        (motion_before.acceleration, motion_after.acceleration),
        (motion_before.specific_force, motion_after.specific_force),
        (motion_before.without_gravity, motion_after.without_gravity),
    )
    return all(
        old is new
        or (old is not None and new is not None and _do_signals_differ_by_constant(old, new))
        for old, new in pairs
    )


def _do_signals_differ_by_constant(signal_a: Floats, signal_b: Floats) -> bool:
    """Whether two signals differ by a constant only."""
    return float(np.ptp(signal_b - signal_a)) < LIMITS.zero_shift_m_s2


def refit_from_earlier_fit(
    earlier_fit: JointFit, noise: ColumnNoiseModel, priors: PriorSettings, *, is_lag_known: bool
) -> JointFit:
    """Refit from the parameters of an earlier fit; in a long log the lag is that of its start.

    Args:
        earlier_fit: the earlier fit.
        noise: noise of the columns.
        priors: priors of the nuisances.
        is_lag_known: whether force and speed are unchanged, so that the lag is known.
    """
    part = earlier_fit.motion.cut_to_first_stretches(LIMITS.refit_pilot_stretches)
    if part is earlier_fit.motion or not part.has_enough_motion:
        return refit_with_extra_terms(
            earlier_fit, noise, priors, rounds=LIMITS.refit_rounds - is_lag_known
        )
    if is_lag_known:
        return refit_with_extra_terms(earlier_fit, noise, priors)
    states = (
        None
        if earlier_fit.states is None
        else earlier_fit.states.reassign_to_manoeuvres_of_motion(part)
    )
    pilot = refit_with_extra_terms(replace(earlier_fit, motion=part, states=states), noise, priors)
    if (
        abs(pilot.previous_estimates.force_delay_s - earlier_fit.previous_estimates.force_delay_s)
        > LIMITS.refit_lag_moves_s
    ):
        pilot = refit_with_extra_terms(pilot, noise, priors)
    theta = earlier_fit.theta.copy()
    theta[earlier_fit.mass_count] = pilot.viscous_friction
    return refit_with_extra_terms(
        replace(earlier_fit, previous_estimates=pilot.previous_estimates, theta=theta),
        noise,
        priors,
    )


def exclude_and_renumber_short_stretches(motion: MotionSamples) -> MotionSamples:
    """Renumber the stretches after samples were excluded, and exclude those now too short."""
    parts = np.where(
        motion.is_fittable, np.cumsum(mark_stretch_starts(motion.stretch_of_sample)) - 1, -1
    )
    size = np.bincount(parts[parts >= 0], minlength=1)
    short = (parts >= 0) & (size[np.maximum(parts, 0)] < LIMITS.refit_min_stretch_samples)
    return replace(motion, stretch_of_sample=parts.astype(np.int64)).exclude_samples(short)
