"""An arc at constant speed and yaw rate: prescribed motion, with its drive and brakes.

The ramps from and to standstill are the polynomial of fifth degree from 0 to 1 whose first and
second derivatives are 0 at both ends. On each axis, force along the motion comes from the drive and
force against it from the brakes.
"""

import numpy as np

from analysis.simulation.motion.body import LongitudinalYawPair, RigidBody, Values
from analysis.simulation.motion.solved_motion import ManoeuvreTimes, MotionPhase, MotionState
from analysis.simulation.scenario.manoeuvres import Arc
from estimators.arrays import Floats


def make_arc_phases_and_times(
    body: RigidBody, manoeuvre: Arc, start_s: float, heading_rad: float
) -> tuple[list[MotionPhase], ManoeuvreTimes]:
    """Phases of an arc: ramp up, constant, ramp down."""
    steady_s = start_s + manoeuvre.ramp_s
    down_s = steady_s + manoeuvre.duration_s
    end_s = down_s + manoeuvre.ramp_s

    def arc_state(time_s: Floats) -> MotionState:
        up = np.clip((time_s - start_s) / manoeuvre.ramp_s, 0.0, None)
        down = np.clip((time_s - down_s) / manoeuvre.ramp_s, 0.0, None)
        level = _evaluate_smooth_step(up) - _evaluate_smooth_step(down)
        slope = (
            _differentiate_smooth_step(up) - _differentiate_smooth_step(down)
        ) / manoeuvre.ramp_s
        turned = (
            manoeuvre.yaw_rate_rad_s
            * manoeuvre.ramp_s
            * (integrate_smooth_step(up) - integrate_smooth_step(down))
        )
        rate = LongitudinalYawPair(manoeuvre.speed_m_s * level, manoeuvre.yaw_rate_rad_s * level)
        acceleration = LongitudinalYawPair(
            manoeuvre.speed_m_s * slope, manoeuvre.yaw_rate_rad_s * slope
        )
        heading = heading_rad + turned
        sign = LongitudinalYawPair(np.sign(rate.x), np.sign(rate.z))
        total = body.compute_required_force_and_torque(rate, acceleration, heading, sign)
        drive = LongitudinalYawPair(
            _zero_force_against_motion(total.x, rate.x), _zero_force_against_motion(total.z, rate.z)
        )
        values: list[Values] = [
            rate.x,
            acceleration.x,
            drive.x,
            drive.x - total.x,
            rate.z,
            acceleration.z,
            drive.z,
            drive.z - total.z,
            heading,
        ]
        return MotionState(*(np.asarray(value) for value in values))

    held = "arc" if manoeuvre.yaw_rate_rad_s and manoeuvre.speed_m_s else None
    phases = [
        MotionPhase(None, start_s, steady_s, arc_state),
        MotionPhase(held, steady_s, down_s, arc_state),
        MotionPhase(None, down_s, end_s, arc_state),
    ]
    return phases, ManoeuvreTimes("arc", start_s, start_s, steady_s, down_s, end_s)


def _zero_force_against_motion(force_or_torque: Values, rate: Values) -> Values:
    """Force or torque where it acts along the motion; 0 where it acts against it."""
    return np.where(force_or_torque * rate >= 0.0, force_or_torque, 0.0)


def _evaluate_smooth_step(fraction: Floats) -> Floats:
    fraction = np.minimum(fraction, 1.0)
    return fraction**3 * (10.0 + fraction * (6.0 * fraction - 15.0))


def _differentiate_smooth_step(fraction: Floats) -> Floats:
    fraction = np.minimum(fraction, 1.0)
    return 30.0 * fraction**2 * (1.0 - fraction) ** 2


def integrate_smooth_step(fraction: Floats) -> Floats:
    """Integral of `_step`."""
    ramp = np.minimum(fraction, 1.0)
    return ramp**4 * (2.5 + ramp * (ramp - 3.0)) + (fraction - ramp)
