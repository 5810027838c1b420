"""A noisy speed makes neither a standing machine drive nor hills a squat."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from analysis.model.settings import Settings
from analysis.weighing.motion_samples import Floats
from analysis.weighing.wheel_comparison import compare_wheels_with_accelerometer
from tests.analysis.weighing.test_pitch_squat import starts
from tests.analysis.weighing.weighed import RICH, merged, weighed

#: Of a speed whose phases flicker while the machine stands, at 50 Hz, in m/s.
NOISE_M_S = 0.012
SLOW: dict[str, Any] = {"sensors": {"rate_hz": 50.0, "speed_noise_m_s": NOISE_M_S}}


class WhiteNoise:
    """White noise of acceleration, speed and force."""

    def __init__(self, speed_m_s: float) -> None:
        self.variances = np.diag([0.01**2, speed_m_s**2, 60.0**2])

    def compute_covariance_of_means(self, samples: int) -> Floats:
        return self.variances / samples


@pytest.mark.heavy
def test_every_stretch_that_is_fitted_moves() -> None:
    log = weighed(merged(RICH, SLOW))
    motion = log.weighing.fit.motion
    fastest = [
        np.abs(
            np.convolve(motion.speed[motion.stretch_of_sample == number], np.ones(3) / 3.0)
        ).max()
        for number in np.unique(motion.stretch_of_sample[motion.is_fittable])
    ]
    assert len(fastest) >= 5
    assert min(fastest) > 4.0 * NOISE_M_S / np.sqrt(3.0)
    assert abs(log.error_u) < 2.0


@pytest.mark.parametrize("speed_noise_m_s", [0.02, 0.08])
def test_hills_are_taken_off_the_accelerometer_however_noisy_the_speed(
    speed_noise_m_s: float,
) -> None:
    _, motion = starts(0.0, 0.15, seed=3)
    noise = WhiteNoise(speed_noise_m_s)
    said = motion.speed + np.random.default_rng(4).normal(0.0, speed_noise_m_s, motion.speed.size)
    found = compare_wheels_with_accelerometer(
        replace(motion, speed=said), noise, Settings.model_validate({}).priors
    )
    assert found is not None
    assert not found.is_gain_significant
    assert found.squat == (0.0, 0.0)
