"""The correlation of a window and the index (11) made of it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimators.numerics.mutual_information import (
    compute_window_correlation,
    correlation_to_gaussian_information,
    correlation_to_information_index,
)


@pytest.mark.heavy
@settings(deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.integers(5, 40),
    st.floats(-1e6, 1e6),
    st.floats(-1e6, 1e6),
    st.floats(-1, 1),
    st.floats(1e-3, 1e3),
)
def test_every_window_agrees_with_numpy_whatever_the_means(seed, window, mean_x, mean_y, mix, gain):
    generator = np.random.default_rng(seed)
    x = generator.normal(size=100)
    y = gain * (mix * x + generator.normal(size=100)) + mean_y
    x = x + mean_x
    rho, spread = compute_window_correlation(x, y, window)
    assert np.isnan(rho[: window - 1]).all()
    assert np.isnan(spread[: window - 1]).all()
    expected = [
        np.corrcoef(x[k - window + 1 : k + 1], y[k - window + 1 : k + 1])[0, 1]
        for k in range(window - 1, 100)
    ]
    np.testing.assert_allclose(rho[window - 1 :], expected, atol=1e-5)


def test_a_mean_a_billion_times_the_motion_costs_few_digits():
    generator = np.random.default_rng(5)
    x = generator.normal(size=2000)
    y = 0.5 * x + generator.normal(size=2000)
    near, _ = compute_window_correlation(x, y, 320)
    far, _ = compute_window_correlation(x + 1e9, y - 1e9, 320)
    np.testing.assert_allclose(far[319:], near[319:], atol=1e-6)


@given(st.floats(-1e12, 1e12), st.floats(-1e12, 1e12), st.integers(2, 30))
def test_a_constant_window_has_no_correlation_and_no_spread(value, other, window):
    varying = np.sin(np.arange(40.0)) + 3.0
    for x, y in [
        (np.full(40, value), varying),
        (varying, np.full(40, other)),
        (np.full(40, value), np.full(40, other)),
    ]:
        rho, spread = compute_window_correlation(x, y, window)
        assert np.isnan(rho).all()
        np.testing.assert_array_equal(spread[window - 1 :], 0.0)


def test_a_window_far_longer_than_the_log_takes_no_memory():
    rho, spread = compute_window_correlation(np.arange(9.0), np.arange(9.0), 2_000_000_000_000)
    assert np.isnan(rho).all()
    assert np.isnan(spread).all()


def test_a_constant_stretch_inside_a_log_is_not_a_correlation_of_rounding():
    x = np.concatenate([np.random.default_rng(6).normal(size=100), np.full(100, 0.1)])
    rho, _ = compute_window_correlation(x, 3.0 * x + 0.7, 20)
    np.testing.assert_allclose(rho[19:100], 1.0, atol=1e-12)
    assert np.isnan(rho[119:]).all()


@pytest.mark.parametrize("scale", [1e-120, 1e-60, 1e60, 1e120])
def test_the_scale_of_the_numbers_does_not_matter(scale):
    generator = np.random.default_rng(8)
    x, y = generator.normal(size=(2, 60))
    expected, _ = compute_window_correlation(x, y, 10)
    rho, _ = compute_window_correlation(scale * x, scale * y, 10)
    np.testing.assert_allclose(rho, expected, rtol=1e-9)


@given(st.integers(0, 39), st.integers(2, 12))
def test_a_nan_spoils_only_the_windows_that_hold_it(at, window):
    x, y = np.random.default_rng(9).normal(size=(2, 40))
    clean, _ = compute_window_correlation(x, y, window)
    y[at] = np.nan
    rho, _ = compute_window_correlation(x, y, window)
    holds = np.zeros(40, bool)
    holds[at : at + window] = True
    assert np.isnan(rho[holds]).all()
    np.testing.assert_array_equal(rho[~holds], clean[~holds])


def test_the_index_is_minus_0_3466_at_minus_one_then_0_then_infinite():
    index = correlation_to_information_index(np.array([-1.0, 0.0, 0.5, 1.0, np.nan]))
    np.testing.assert_allclose(index[:3], [-0.5 * np.log(2.0), 0.0, 0.5 * np.log(2.0)])
    assert index[0] == pytest.approx(-0.3466, abs=1e-4)
    assert index[3] == np.inf
    assert np.isnan(index[4])


@given(st.floats(-1, 1), st.floats(-1, 5))
def test_a_threshold_on_the_index_is_a_threshold_on_the_correlation(rho, gamma):
    limit = -np.expm1(-2.0 * gamma)
    if abs(rho - limit) > 1e-9:
        assert bool(correlation_to_information_index(np.array([rho]))[0] >= gamma) == (rho >= limit)


def test_0_7_nat_asks_for_a_correlation_of_0_753():
    assert correlation_to_information_index(np.array([0.7534]))[0] == pytest.approx(0.7, abs=1e-4)


def test_index_10_is_even_in_the_correlation_and_asks_for_more_of_it_than_11():
    rho = np.array([-0.8, 0.8, 0.0, 1.0, np.nan])
    index = correlation_to_gaussian_information(rho)
    assert index[0] == index[1] == pytest.approx(0.5108, abs=1e-4)
    assert index[2] == 0.0
    assert np.isposinf(index[3])
    assert np.isnan(index[4])
    assert index[1] < correlation_to_information_index(rho)[1]
