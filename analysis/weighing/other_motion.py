"""The answer with the other motion: by the wheels where the accelerometer weighs, or the reverse.

Wheels and accelerometer that do not agree say different motions of one machine. Which of them is
wrong no log tells, but whether it matters: the fit once more with the other one.
"""

from dataclasses import dataclass, replace

import numpy as np

from analysis.model.prior_settings import PriorSettings
from analysis.weighing.joint_fit import JointFitInputs, joint_fit
from analysis.weighing.joint_result import JointFit
from analysis.weighing.motion_samples import ColumnNoiseModel, Floats, MotionSamples
from analysis.weighing.weighing_limits import LIMITS


@dataclass(frozen=True, slots=True)
class AlternativeMotion:
    """The change of the answer by the other motion.

    Attributes:
        kg: mass by the other motion less the mass.
        u_kg: standard uncertainty of that: what both have of the priors is in it twice.
    """

    kg: float
    u_kg: float

    @property
    def mass_shift_u(self) -> float:
        """How far the mass moves, in standard uncertainties; infinite where nothing is left."""
        return abs(self.kg) / self.u_kg if np.isfinite(self.kg) else float("inf")


def wheel_imu_disagreement(fit: JointFit) -> float:
    """What wheels and accelerometer do not agree about, as a share of the speed; NaN: no telling.

    What the noise of the speed explains is no disagreement, so that its size does not matter.
    """
    wheels = fit.kinematics
    if wheels is None or not fit.motion.largest_speed:
        return float("nan")
    return wheels.disagreement_m_s / fit.motion.largest_speed


def refit_with_wheel_or_imu_motion(
    fit: JointFit, noise: ColumnNoiseModel, priors: PriorSettings
) -> AlternativeMotion | None:
    """Fit once more with the other motion; None where there is none.

    Args:
        fit: the answer.
        noise: of acceleration, speed and force.
        priors: of the nuisances.
    """
    motion = fit.motion
    if motion.specific_force is None:
        return None
    by_wheels = motion.by_accelerometer
    acceleration = _wheel_motion(motion) if by_wheels else motion.specific_force
    other = replace(
        motion,
        acceleration=acceleration,
        specific_force=None,
        without_gravity=None,
        wheel_acceleration=None,
        by_accelerometer=not by_wheels,
    )
    of_other = _OtherMotionNoise(noise, motion.rate_hz, by_wheels=by_wheels)
    found = joint_fit(JointFitInputs.prepare(other, of_other, priors), fit.states)
    return AlternativeMotion(found.mass_kg - fit.mass_kg, float(np.hypot(found.u_kg, fit.u_kg)))


def _wheel_motion(motion: MotionSamples) -> Floats:
    """The change of the wheels' speed, with gravity by the pitch where there is one, (n,)."""
    rate_m_s2 = np.gradient(motion.speed) * motion.rate_hz
    if motion.specific_force is None or motion.without_gravity is None:
        return rate_m_s2
    return rate_m_s2 + (motion.specific_force - motion.without_gravity)


@dataclass(frozen=True)
class _OtherMotionNoise:
    """The noise with the other acceleration: of a difference of speeds, or nearly none.

    What an accelerometer's noise takes off the mass is less than what is looked for here.
    """

    columns: ColumnNoiseModel
    rate_hz: float
    by_wheels: bool

    def covariance(self, samples: int) -> Floats:
        """(3, 3) of the trailing mean of so many samples."""
        found = self.columns.covariance(samples).copy()
        found[0, :] = found[:, 0] = 0.0
        if self.by_wheels:
            speed = self.columns.covariance(1)[1, 1]
            times = (
                LIMITS.mean_difference_variance / samples**2
                if samples > 1
                else LIMITS.central_difference_variance
            )
            found[0, 0] = times * speed * self.rate_hz**2
        return found
