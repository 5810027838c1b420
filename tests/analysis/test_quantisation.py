"""The step of a coarse channel is seen through the grid, whatever its own rate."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.stages.noise.noise_spectra import find_resolution_of_column

GRID_HZ = 100.0


def coarse_speed(rate_hz: float, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Ten starts to 2 m/s and stops, in readings of a step, on the grid; and what moves."""
    own = np.arange(0.0, 80.0, 1.0 / rate_hz)
    speed = 2.0 * np.clip(np.mod(own, 8.0) / 2.0 - 0.5, 0.0, 1.0) * (np.mod(own, 8.0) < 6.0)
    t = np.arange(0.0, 79.0, 1.0 / GRID_HZ)
    x = np.interp(t, own, np.round(speed / step) * step)
    return x, (np.mod(t, 8.0) > 1.0) & (np.mod(t, 8.0) < 6.0)


@given(st.floats(40.0, 200.0), st.sampled_from([0.05, 0.1, 0.2]))
def test_the_step_of_a_coarse_speed_is_found(rate_hz: float, step: float) -> None:
    x, moving = coarse_speed(rate_hz, step)
    assert find_resolution_of_column(x, moving) == pytest.approx(step, rel=1e-6)


@given(st.sampled_from([4 / 3, 50 / 38, 5 / 4, 3 / 2]))
def test_rates_that_keep_step_with_each_other_do_not_hide_it(ratio: float) -> None:
    x, moving = coarse_speed(GRID_HZ / ratio, 0.1)
    assert find_resolution_of_column(x, moving) == pytest.approx(0.1, rel=1e-6)


@given(st.integers(0, 1000))
def test_noise_has_no_step(seed: int) -> None:
    x = np.random.default_rng(seed).normal(size=5000)
    assert find_resolution_of_column(x, np.ones(x.size, np.bool_)) is None
