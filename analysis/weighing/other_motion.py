"""The answer with the other acceleration: wheels instead of accelerometer, or vice versa.

Wheels and accelerometer that disagree describe two motions of one machine. A refit with the other
acceleration shows whether it matters. If it leaves far more of the force unexplained, the force
tells which is wrong: on hills it sees gravity, as the accelerometer does and the wheels do not.
"""

from dataclasses import dataclass, replace

import numpy as np

from analysis.model.prior_settings import PriorSettings
from analysis.weighing.growing_load import look_up_load_states
from analysis.weighing.joint_fit import JointFitInputs, fit_jointly
from analysis.weighing.joint_result import JointFit
from analysis.weighing.motion_samples import ColumnNoiseModel, Floats
from analysis.weighing.stretch_means import list_indices_of_samples_in_whole_blocks
from analysis.weighing.weighing_limits import LIMITS
from analysis.weighing.wheel_kinematics import differentiate_wheel_speed


@dataclass(frozen=True, slots=True)
class AlternativeMotion:
    """Change of the mass if wheels replace the accelerometer in the fit, or vice versa.

    Attributes:
        kg: mass by the acceleration of the other sensor minus the mass of the answer.
        u_kg: standard uncertainty of the change; too large, as it counts the shared priors twice.
        residual_ratio: r.m.s. of the residual force with the other sensor over that of the answer
            and the noise of the other sensor together.
    """

    kg: float
    u_kg: float
    residual_ratio: float = 1.0

    @property
    def is_refuted_by_force(self) -> bool:
        """Whether the force agrees with the sensor of the answer, and not with the other one."""
        return np.isfinite(self.kg) and self.residual_ratio > LIMITS.refuted_residual_ratio

    @property
    def mass_shift_over_uncertainty(self) -> float:
        """Change of the mass in standard uncertainties; infinite if the refit has no mass.

        0 if the force refutes the other sensor, whose mass then does not bear on the answer.
        """
        if self.is_refuted_by_force:
            return 0.0
        return abs(self.kg) / self.u_kg if np.isfinite(self.kg) else float("inf")

    @property
    def effect_text(self) -> str:
        """What the other sensor alone does to the answer, in words that follow its name."""
        if self.is_refuted_by_force:
            return f"the residual force is {self.residual_ratio:.1f} times as large"
        return (
            f"the mass changes by {self.kg:+.0f} kg "
            f"({self.mass_shift_over_uncertainty:.1f} standard uncertainties)"
        )


def compute_wheel_imu_disagreement_over_speed(fit: JointFit) -> float:
    """Disagreement of wheels and accelerometer relative to the speed; NaN if unknown.

    The part explained by the noise of the speed is excluded.
    """
    wheels = fit.kinematics
    if wheels is None or not fit.motion.speed_95_percentile_m_s:
        return float("nan")
    return wheels.disagreement_m_s / fit.motion.speed_95_percentile_m_s


def refit_with_acceleration_of_other_sensor(
    fit: JointFit, noise: ColumnNoiseModel, priors: PriorSettings
) -> AlternativeMotion | None:
    """Refit with the other sensor's acceleration, wheels or accelerometer; None if absent.

    Args:
        fit: joint fit of the answer.
        noise: noise of acceleration, speed and force.
        priors: priors of the nuisances.
    """
    motion = fit.motion
    if motion.specific_force is None:
        return None
    by_wheels = motion.by_accelerometer
    acceleration = differentiate_wheel_speed(motion) if by_wheels else motion.specific_force
    other = replace(
        motion,
        acceleration=acceleration,
        specific_force=None,
        without_gravity=None,
        wheel_acceleration=None,
        by_accelerometer=not by_wheels,
        swing_m_s2=None,  # it is that of the other acceleration
    )
    of_other = _OtherMotionNoise(noise, motion.rate_hz, by_wheels=by_wheels)
    found = fit_jointly(JointFitInputs.prepare_from_motion(other, of_other, priors), fit.states)
    return AlternativeMotion(
        found.mass_kg - fit.mass_kg,
        float(np.hypot(found.u_kg, fit.u_kg)),
        compare_residual_forces(fit, noise, acceleration),
    )


def compare_residual_forces(
    fit: JointFit, noise: ColumnNoiseModel, other_acceleration: Floats
) -> float:
    """Ratio of the residual force with another acceleration to that of the answer; 1 if unknown.

    Both are computed from means of the same length, each with its own gain, since a gain is not a
    residual. The noise that the wheel speed adds to such means is added to the answer's residual.

    Args:
        fit: joint fit of the answer.
        noise: noise of acceleration, speed and force.
        other_acceleration: (n,) acceleration of the other sensor in m/s².
    """
    motion = fit.motion
    size = max(round(LIMITS.compared_mean_s * motion.rate_hz), 1)
    used = list_indices_of_samples_in_whole_blocks(motion.stretch_of_sample, size)
    blocks = used.reshape(-1, size)
    if fit.states is None or len(blocks) < LIMITS.compared_min_means:
        return 1.0
    mass_kg = fit.masses_kg[
        look_up_load_states(fit.states, motion.manoeuvre_of_sample[blocks[:, 0]])
    ]
    force, speed, own, other = (
        x[blocks].mean(axis=1)
        for x in (motion.force, motion.speed, motion.acceleration, other_acceleration)
    )
    left: list[float] = []
    for acceleration in (own, other):
        A = np.column_stack([mass_kg * acceleration, speed, np.sign(speed), np.ones_like(speed)])
        left.append(float(np.mean((force - A @ np.linalg.lstsq(A, force)[0]) ** 2)))
    if motion.by_accelerometer:
        speed_variance = noise.compute_covariance_of_means(1)[1, 1]
        change_std_m_s2 = np.sqrt(2.0 * speed_variance) * motion.rate_hz / size
        left[0] += float(np.mean((mass_kg * change_std_m_s2) ** 2))
    return float(np.sqrt(left[1] / left[0])) if left[0] > 0.0 else 1.0


@dataclass(frozen=True)
class _OtherMotionNoise:
    """Noise with the other acceleration: that of a difference of speeds, or nearly none.

    The accelerometer's noise affects the mass less than the differences sought here.
    """

    columns: ColumnNoiseModel
    rate_hz: float
    by_wheels: bool

    def compute_covariance_of_means(self, samples_per_mean: int) -> Floats:
        """(3, 3) noise covariance of a trailing mean of `samples_per_mean` samples."""
        found = self.columns.compute_covariance_of_means(samples_per_mean).copy()
        found[0, :] = found[:, 0] = 0.0
        if self.by_wheels:
            speed = self.columns.compute_covariance_of_means(1)[1, 1]
            times = (
                LIMITS.mean_difference_variance / samples_per_mean**2
                if samples_per_mean > 1
                else LIMITS.central_difference_variance
            )
            found[0, 0] = times * speed * self.rate_hz**2
        return found
