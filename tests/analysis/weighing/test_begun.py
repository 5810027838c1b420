"""What is begun from an earlier fit finds what it finds from the start."""

import numpy as np
import pytest

from analysis.model.axes import X
from analysis.stages.noise.column_noise import ColumnNoise
from analysis.weighing.fit_columns import PreviousEstimates, average_and_weight_fit_columns
from analysis.weighing.motion_samples import CachedNoise
from analysis.weighing.wheel_comparison import compare_wheels_with_accelerometer
from tests.analysis.weighing.weighed import RICH, weighed

REACH_S = 0.4
#: A force and a speed that are moved in time as far as a fit may move them.
FOUND = PreviousEstimates(force_delay_s=-0.29, slip_1_N=1e-5, speed_delay_s=0.15)


@pytest.fixture(scope="module")
def log():
    return weighed(RICH)


@pytest.fixture(scope="module")
def noise(log):
    settings = log.machine.settings.noise
    return CachedNoise(ColumnNoise.select_axis_noise(X, log.replayed.frames["noise"], settings))


def test_samples_around_the_fitted_ones_make_the_same_columns(log, noise):
    fit = log.weighing.fit
    near = fit.motion.drop_samples_far_from_fitted(REACH_S)
    assert near.force.size < fit.motion.force.size
    for found in (PreviousEstimates(), FOUND):
        whole, part = (
            average_and_weight_fit_columns(motion, noise, fit.terms, fit.samples_per_mean, found)
            for motion in (fit.motion, near)
        )
        np.testing.assert_array_equal(part.group, whole.group)
        np.testing.assert_allclose(part.f, whole.f, rtol=1e-9)
        np.testing.assert_allclose(part.A, whole.A, rtol=1e-9, atol=1e-9 * np.abs(whole.A).max())


def test_noise_that_is_kept_is_that_of_its_columns(noise):
    for samples in (1, 10, 10):
        np.testing.assert_array_equal(
            noise.compute_covariance_of_means(samples),
            noise.columns.compute_covariance_of_means(samples),
        )


def test_wheels_that_begin_from_their_own_words_say_them_again(log, noise):
    motion, priors = log.weighing.fit.motion, log.machine.settings.priors
    first = compare_wheels_with_accelerometer(motion, noise, priors)
    again = compare_wheels_with_accelerometer(motion, noise, priors, first)
    assert first is not None
    assert again is not None
    assert again.is_consistent == first.is_consistent
    assert again.is_gain_significant == first.is_gain_significant
    for name in ("gain", "gain_by_prior", "delay_s", "slip_1_N"):
        (was, std), (now, std_now) = getattr(first, name), getattr(again, name)
        assert abs(now - was) < 0.05 * std
        assert std_now == pytest.approx(std, rel=0.05)


def test_wheels_of_a_speed_that_is_moved_are_found_from_where_they_were(log, noise):
    motion, priors = log.weighing.fit.motion, log.machine.settings.priors
    first = compare_wheels_with_accelerometer(motion, noise, priors)
    moved = motion.advance_speed(-0.02)
    begun, anew = (
        compare_wheels_with_accelerometer(moved, noise, priors, first),
        compare_wheels_with_accelerometer(moved, noise, priors),
    )
    assert begun is not None
    assert anew is not None
    assert abs(begun.delay_s[0] - anew.delay_s[0]) < 0.1 * anew.delay_s[1]
    assert abs(begun.slip_1_N[0] - anew.slip_1_N[0]) < 0.1 * anew.slip_1_N[1]
