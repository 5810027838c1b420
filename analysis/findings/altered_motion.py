"""Altered copies of the motion: a channel shifted in time, or with another scale or offset."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from analysis.weighing.motion_samples import MotionSamples
from estimators.arrays import Floats


def correct_channel_delay(motion: MotionSamples, channel: str, delay_s: float) -> MotionSamples:
    """Undo the delay of `force`, `speed` or `imu`: shift the channel earlier by `delay_s`."""
    if channel == "force":
        return motion.advance_force(delay_s)
    if channel == "speed":
        return motion.advance_speed(delay_s)
    rows = np.arange(motion.force.size, dtype=np.float64)

    def advance_samples(x: Floats) -> Floats:
        return np.interp(rows + delay_s * motion.rate_hz, rows, x)

    return transform_accelerometer_signals(motion, advance_samples)


def transform_accelerometer_signals(
    motion: MotionSamples, correct_signal: Callable[[Floats], Floats]
) -> MotionSamples:
    """Apply a function to every accelerometer signal of the motion."""
    measured, level = motion.specific_force, motion.without_gravity
    return replace(
        motion,
        acceleration=correct_signal(motion.acceleration)
        if motion.by_accelerometer
        else motion.acceleration,
        specific_force=None if measured is None else correct_signal(measured),
        without_gravity=None if level is None else correct_signal(level),
    )
