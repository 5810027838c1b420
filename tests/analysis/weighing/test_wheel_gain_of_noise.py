"""Noise of the accelerometer that adds up is no gain of wheels against accelerometer."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.model.settings import Settings
from analysis.weighing.motion_samples import Floats, MotionSamples
from analysis.weighing.wheel_comparison import compare_wheels_with_accelerometer
from analysis.weighing.wheel_kinematics import WheelKinematics
from tests.analysis.weighing.test_pitch_squat import starts

SPEED_NOISE_M_S = 0.01


class WhiteNoise:
    """White noise of acceleration, speed and force."""

    def __init__(self, acceleration_m_s2: float) -> None:
        self.variances = np.diag([acceleration_m_s2**2, SPEED_NOISE_M_S**2, 60.0**2])

    def compute_covariance_of_means(self, samples: int) -> Floats:
        return self.variances / samples


def cruising(seed: int, noise_m_s2: float, *, gain: float) -> MotionSamples:
    """A vehicle at 10 Hz whose speed hardly changes, and an accelerometer with noise and a gain."""
    dice = np.random.default_rng(seed)
    _, motion = starts(0.0, 0.0, seed=seed, count=12)
    rate_hz = 10.0
    t = np.arange(motion.speed.size // 12) / rate_hz
    waves = [dice.uniform(0.02, 0.05) * np.sin(0.4 * t + dice.uniform(0.0, 6.0)) for _ in range(12)]
    v = 8.0 + np.concatenate(waves)
    a = np.concatenate([np.gradient(wave, t) for wave in waves])
    measured = (1.0 + gain) * a + dice.normal(0.0, noise_m_s2, a.size)
    speed = v + dice.normal(0.0, SPEED_NOISE_M_S, v.size)
    return replace(
        motion,
        acceleration=measured,
        specific_force=measured,
        without_gravity=None,
        speed=speed,
        force=4000.0 * a + dice.normal(0.0, 60.0, a.size),
        rate_hz=rate_hz,
    )


def compared(seed: int, noise_m_s2: float, *, gain: float) -> WheelKinematics:
    """Wheels of such a vehicle against its accelerometer."""
    motion = cruising(seed, noise_m_s2, gain=gain)
    priors = Settings.model_validate({}).priors
    found = compare_wheels_with_accelerometer(motion, WhiteNoise(noise_m_s2), priors)
    assert found is not None
    return found


@pytest.mark.parametrize("seed", range(4))
def test_noise_that_adds_up_is_no_gain(seed: int) -> None:
    found = compared(seed, 0.04, gain=0.0)
    # it shrinks what the accelerometer tells by a third and more
    assert found.gain[0] < -0.2
    assert not found.is_gain_significant


@pytest.mark.parametrize("seed", range(4))
def test_a_gain_beyond_what_noise_mimics_counts(seed: int) -> None:
    assert compared(seed, 0.0005, gain=0.15).is_gain_significant
