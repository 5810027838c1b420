"""Constant forces: attribute them to an offset, an accelerometer tilt or Coulomb friction.

Standstill shows the force at rest, and the accelerometer's reading beyond gravity if the pitch is
known; driving shows their sum C = F₀ - m e + F_c. Brakes may hold a force at rest that is absent
while driving, and the ground may slope in a log without pitch, so the constants at standstill may
differ from those while driving.
"""

from dataclasses import dataclass, replace
from itertools import product
from typing import Final

import numpy as np

from analysis.findings.altered_motion import transform_accelerometer_signals
from analysis.findings.finding_inputs import ACC, FindingInputs
from analysis.findings.finding_limits import LIMITS
from analysis.findings.whitened_rows import ProjectedEquation, build_whitened_force_rows
from analysis.model.schema import get_column_values
from analysis.stages.motion.forces import compute_longitudinal_force
from analysis.weighing.low_gears import subtract_gear_inertia
from analysis.weighing.motion_samples import MotionSamples

#: Channel by which an accelerometer error at rest is certain, whether motion shows it or not.
_PITCH: Final = "pitch_rad"


@dataclass(frozen=True)
class ConstantForces:
    """Constant forces at rest and in motion.

    Attributes:
        rest_N: mean force at rest and its standard deviation; NaN if the machine never stands.
        error_m_s2: mean error of the accelerometer at rest and its standard deviation; NaN if the
            machine never stands.
        offset: whether the force at rest also acts in motion; None if the log does not determine
            it.
        tilt: whether the accelerometer's error also acts in motion; None if undetermined.
        motion: the motion with the constant errors that act in motion removed.
        is_rest_significant: whether the force at rest exceeds noise and resolution.
    """

    rest_N: tuple[float, float]
    error_m_s2: tuple[float, float]
    offset: bool | None
    tilt: bool | None
    motion: MotionSamples | None
    is_rest_significant: bool = False

    @property
    def acts_only_at_rest(self) -> bool:
        """Whether the force at rest is absent in motion, like a drive force held by brakes."""
        return self.is_rest_significant and self.offset is False


def has_pitch_channel(inputs: FindingInputs) -> bool:
    """Whether the log measures the pitch."""
    return _PITCH in inputs.aligned.columns


def compute_gravity_by_pitch_m_s2(inputs: FindingInputs) -> np.typing.NDArray[np.float64]:
    """Gravity along x from the pitch, (n,) in m/s²; 0 without a pitch channel."""
    if not has_pitch_channel(inputs):
        return np.zeros(inputs.aligned.height)
    if "gravity" not in inputs.cache:
        pitch = get_column_values(inputs.aligned, _PITCH)
        inputs.cache["gravity"] = inputs.machine.machine.gravity_m_s2 * np.sin(pitch)
    return inputs.cache["gravity"]  # type: ignore[return-value]


def explain_constant_force(inputs: FindingInputs) -> ConstantForces:
    """Explain the constant force in motion by as few causes as possible."""
    if "constants" not in inputs.cache:
        inputs.cache["constants"] = _estimate_and_explain_constant_forces(inputs)
    found = inputs.cache["constants"]
    assert isinstance(found, ConstantForces)
    return found


def _estimate_and_explain_constant_forces(inputs: FindingInputs) -> ConstantForces:
    """Estimate the constant forces at rest, and find the causes of the one in motion."""
    rest = inputs.compute_mean_and_std_of_signal_at_rest(
        compute_longitudinal_force(inputs.aligned, inputs.machine.machine)
    )
    error = np.nan, np.nan
    if ACC in inputs.aligned.columns:
        error = inputs.compute_mean_and_std_of_signal_at_rest(
            get_column_values(inputs.aligned, ACC) - compute_gravity_by_pitch_m_s2(inputs)
        )
    fit, noise = inputs.fit_without_learnt_priors, inputs.column_noise
    if fit is None or noise is None or not np.isfinite(fit.theta).all():
        return ConstantForces(rest, error, None, None, None)
    motion = subtract_gear_inertia(fit.motion, fit.terms, fit.theta[fit.mass_count + 1 :])
    offset = abs(rest[0]) > max(
        LIMITS.standing_reading_std * rest[1],
        LIMITS.standing_reading_fraction * motion.force_95_percentile_newtons,
    )
    tilt = (
        abs(error[0]) > max(LIMITS.standing_reading_std * error[1], LIMITS.standing_reading_m_s2)
        and motion.by_accelerometer
    )
    # with a measured pitch an error of the accelerometer is certain, and acts in motion
    tilts = (False, True) if tilt and not has_pitch_channel(inputs) else (bool(tilt),)
    offsets = (False, True) if offset else (False,)
    friction = "direction" if motion.drives_both_ways else "const"
    way = 1.0 if motion.drives_both_ways else float(np.median(motion.direction[motion.is_fittable]))
    mass_kg, viscous = inputs.look_up_mass_of_samples_kg(motion), max(fit.viscous_friction, 0.0)
    holds = offset and _does_standing_force_hold_slope(inputs, rest[0], fit.mass_kg)
    left: dict[tuple[bool, bool, bool], float] = {}
    variances: list[float] = []
    for acts, tilted in product(offsets, tilts):
        system = build_whitened_force_rows(
            _subtract_force_and_accelerometer_offsets(motion, rest[0] * acts, error[0] * tilted),
            noise,
            mass_kg,
            viscous,
        )
        if system.y.size < LIMITS.constant_min_rows:
            return ConstantForces(rest, error, None, None, None)
        own = ProjectedEquation.project_out(system, ())
        variances.append(own.variance)
        left[acts, tilted, False] = own.square_left * own.variance
        square = own.get_information_left_about_cause(friction)
        # a force that holds the machine on a slope is not an offset that friction cancels
        if acts and holds:
            continue
        if square > 0.0 and own.get_likelihood_score_left_of_cause(friction) * way > 0.0:
            gain = own.get_likelihood_score_left_of_cause(friction) ** 2 / square
            left[acts, tilted, True] = (own.square_left - gain) * own.variance
    cost = {of: each / min(variances) + LIMITS.cause_cost * sum(of) for of, each in left.items()}
    best = min(cost, key=lambda each: cost[each])
    of_rest, of_error = (rest[0] if best[0] else 0.0), (error[0] if best[1] else 0.0)
    return ConstantForces(
        rest,
        error,
        is_cause_in_best_explanation(cost, best, 0),
        is_cause_in_best_explanation(cost, best, 1),
        _subtract_force_and_accelerometer_offsets(motion, of_rest, of_error),
        offset,
    )


def _does_standing_force_hold_slope(
    inputs: FindingInputs, force_at_rest_N: float, mass_kg: float
) -> bool:
    """Whether the force at rest may balance gravity on a slope, in part or in full."""
    if has_pitch_channel(inputs):
        gravity = compute_gravity_by_pitch_m_s2(inputs)
    elif ACC in inputs.aligned.columns:
        gravity = get_column_values(inputs.aligned, ACC)
    else:
        return False
    pull_N = mass_kg * inputs.compute_mean_and_std_of_signal_at_rest(gravity)[0]
    return 0.0 < force_at_rest_N * pull_N <= pull_N**2


def _subtract_force_and_accelerometer_offsets(
    motion: MotionSamples, rest_N: float, error_m_s2: float
) -> MotionSamples:
    """Subtract a force offset and an accelerometer error."""
    if rest_N:
        motion = replace(motion, force=motion.force - rest_N)
    return (
        transform_accelerometer_signals(motion, lambda x: x - error_m_s2) if error_m_s2 else motion
    )


def is_cause_in_best_explanation(
    cost_by_explanation: dict[tuple[bool, bool, bool], float],
    best_explanation: tuple[bool, bool, bool],
    cause_index: int,
) -> bool | None:
    """Whether the best explanation contains a cause.

    Returns:
        None if an explanation without the cause is nearly as good.
    """
    others = [
        each
        for of, each in cost_by_explanation.items()
        if of[cause_index] != best_explanation[cause_index]
    ]
    if others and min(others) - cost_by_explanation[best_explanation] < LIMITS.cause_cost / 2.0:
        return None
    return best_explanation[cause_index]
