"""Sums over sliding windows against sums that are exact."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from estimators.methods import ls
from estimators.numerics.rolling import find_ends_of_accepted_windows, sum_window_products
from estimators.numerics.small_systems import find_packed_index

numbers = st.floats(-1e6, 1e6)


def window_sums(x, window, ends=None):
    """Σx² of every window of x, or of those that end at `ends`."""
    index = np.arange(window - 1, x.size) if ends is None else np.asarray(ends)
    return sum_window_products(x[:, None], np.zeros(x.size), window, index)[0]


def exact_sums(x, window):
    return [math.fsum(x[k - window + 1 : k + 1] ** 2) for k in range(window - 1, x.size)]


@settings(deadline=None)
@given(st.lists(numbers, min_size=1, max_size=60), st.integers(1, 60))
def test_every_window_is_the_exact_sum(x, window):
    x = np.array(x)
    if window <= x.size:
        sums = window_sums(x, window)
        assert sums.size == x.size - window + 1
        np.testing.assert_allclose(sums, exact_sums(x, window), rtol=1e-12)


@given(st.data())
def test_a_window_gives_the_same_bits_whichever_others_are_asked_for(data):
    x = np.random.default_rng(7).normal(3.0, 1.0, 90)
    window = data.draw(st.integers(1, 30))
    ends = data.draw(st.sets(st.integers(window - 1, 89), min_size=1))
    index = np.array(sorted(ends))
    every = window_sums(x, window)
    np.testing.assert_array_equal(window_sums(x, window, index), every[index - window + 1])


@pytest.mark.heavy
def test_an_idle_stretch_after_large_values_keeps_all_digits():
    generator = np.random.default_rng(1)
    busy = generator.normal(0, 1e8, 5000)
    idle = generator.normal(0, 1e-6, 5000)
    x = np.concatenate([busy, idle, busy, idle])
    np.testing.assert_allclose(window_sums(x, 320), exact_sums(x, 320), rtol=1e-12)


def test_a_huge_offset_costs_no_more_digits_than_the_number_itself():
    x = 1e12 + np.random.default_rng(2).normal(size=3000)
    np.testing.assert_allclose(window_sums(x, 100), exact_sums(x, 100), rtol=1e-14)


@settings(deadline=None)
@given(
    st.integers(1, 12),
    st.integers(0, 39),
    st.sampled_from([math.nan, math.inf, -math.inf]),
)
@example(12, 0, math.nan)
def test_a_sample_that_is_no_number_spoils_only_the_windows_that_hold_it(window, where, bad):
    x = np.random.default_rng(3).normal(size=40)
    clean = window_sums(x, window)
    x[where] = bad
    sums = window_sums(x, window)
    ends = np.arange(window - 1, 40)
    holds = (ends >= where) & (ends < where + window)
    assert not np.isfinite(sums[holds]).any()
    np.testing.assert_array_equal(sums[~holds], clean[~holds])


@pytest.mark.parametrize("p", [1, 2, 3])
def test_the_packed_sums_are_those_of_the_normal_equations(p):
    generator = np.random.default_rng(4)
    A, f = generator.normal(1.0, 1.0, (500, p)), generator.normal(size=500)
    index = find_ends_of_accepted_windows(np.arange(500) % 3 == 0, 40)
    theta, grams, rss, _ = ls.solve_windows(A, f, 40, index)
    for row, k in enumerate(index):
        a, y = A[k - 39 : k + 1], f[k - 39 : k + 1]
        G = a.T @ a
        for i in range(p):
            for j in range(i, p):
                assert grams[row, find_packed_index(i, j, p)] == pytest.approx(G[i, j], rel=1e-12)
        np.testing.assert_allclose(theta[row], np.linalg.lstsq(a, y)[0], rtol=1e-10)
        assert rss[row] == pytest.approx(((y - a @ theta[row]) ** 2).sum(), rel=1e-10)
