"""Motions as they would be: a channel moved in time, or with another scale or zero."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from analysis.weighing.motion_samples import MotionSamples
from estimators.arrays import Floats


def correct_channel_delay(motion: MotionSamples, channel: str, late_s: float) -> MotionSamples:
    """The motion with `force`, `speed` or `imu` moved back by how late it is."""
    if channel == "force":
        return motion.shift_force(late_s)
    if channel == "speed":
        return motion.shift_speed(late_s)
    rows = np.arange(motion.force.size, dtype=np.float64)

    def back(x: Floats) -> Floats:
        return np.interp(rows + late_s * motion.rate_hz, rows, x)

    return change_accelerometer(motion, back)


def change_accelerometer(
    motion: MotionSamples, change: Callable[[Floats], Floats]
) -> MotionSamples:
    """The motion with its accelerometer changed."""
    measured, level = motion.specific_force, motion.without_gravity
    return replace(
        motion,
        acceleration=change(motion.acceleration)
        if motion.by_accelerometer
        else motion.acceleration,
        specific_force=None if measured is None else change(measured),
        without_gravity=None if level is None else change(level),
    )
