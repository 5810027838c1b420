"""Sums over sliding windows against sums that are exact."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from estimators.rolling import products, unpack, window_sums

numbers = st.floats(-1e6, 1e6)


def exact_sums(x, window):
    return [math.fsum(x[k - window + 1 : k + 1]) for k in range(window - 1, x.size)]


@settings(deadline=None)
@given(st.lists(numbers, min_size=1, max_size=60), st.integers(1, 70))
def test_every_window_is_the_exact_sum_and_incomplete_ones_are_nan(x, window):
    x = np.array(x)
    sums = window_sums(x[:, None], window)[:, 0]
    assert np.isnan(sums[: window - 1]).all()
    np.testing.assert_allclose(
        sums[window - 1 :], exact_sums(x, window), rtol=0, atol=1e-15 * np.abs(x).sum()
    )


def test_an_idle_stretch_after_large_values_keeps_all_digits():
    generator = np.random.default_rng(1)
    busy = generator.normal(0, 1e8, 5000)
    idle = generator.normal(0, 1e-6, 5000)
    x = np.concatenate([busy, idle, busy, idle])
    sums = window_sums((x**2)[:, None], 320)[319:, 0]
    np.testing.assert_allclose(sums, exact_sums(x**2, 320), rtol=1e-13)


def test_a_huge_offset_costs_no_more_digits_than_the_number_itself():
    x = 1e12 + np.random.default_rng(2).normal(size=3000)
    sums = window_sums(x[:, None], 100)[99:, 0]
    np.testing.assert_allclose(sums, exact_sums(x, 100), rtol=1e-14)


@settings(deadline=None)
@given(
    st.integers(1, 12),
    st.integers(0, 39),
    st.sampled_from([math.nan, math.inf, -math.inf]),
)
@example(12, 0, math.nan)
def test_a_sample_that_is_no_number_spoils_only_the_windows_that_hold_it(window, at, bad):
    x = np.random.default_rng(3).normal(size=40)
    clean = window_sums(x[:, None], window)[:, 0]
    x[at] = bad
    sums = window_sums(x[:, None], window)[:, 0]
    holds = np.zeros(40, bool)
    holds[at : at + window] = True
    assert not np.isfinite(sums[holds]).any()
    np.testing.assert_array_equal(sums[~holds], clean[~holds])


def test_columns_are_summed_apart():
    x = np.random.default_rng(4).normal(size=(50, 3))
    x[20, 1] = np.nan
    sums = window_sums(x, 7)
    for column in range(3):
        alone = window_sums(np.ascontiguousarray(x[:, [column]]), 7)
        np.testing.assert_array_equal(sums[:, [column]], alone)


@pytest.mark.parametrize("p", [1, 2, 3])
@given(data=st.data())
def test_products_unpack_to_the_normal_equations(p, data):
    A = data.draw(arrays.arrays(np.float64, (8, p), elements=numbers))
    f = data.draw(arrays.arrays(np.float64, 8, elements=numbers))
    G, h, ff = unpack(products(A, f).sum(axis=0), p)
    np.testing.assert_allclose(G, A.T @ A, rtol=1e-12, atol=1e-3)
    np.testing.assert_allclose(h, A.T @ f, rtol=1e-12, atol=1e-3)
    assert ff == pytest.approx(f @ f, abs=1e-3)
