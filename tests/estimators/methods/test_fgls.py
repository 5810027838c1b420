"""Feasible generalised least squares: guarded where the paper's form is singular."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimators.methods import fgls, ls


def exact_log(n=100):
    t = np.linspace(0, 6, n)
    A = np.column_stack([np.cos(t), np.sin(t) + 1.0])
    return A, A @ np.array([2.0, 3.0])


def ends(n, window):
    return np.arange(n) >= window - 1


@settings(deadline=None, max_examples=50)
@given(st.lists(st.tuples(st.integers(0, 99), st.floats(-1e3, 1e3)), max_size=8))
def test_residuals_that_are_exactly_zero_are_no_infinite_weight(outliers):
    A, f = exact_log()
    for at, error in outliers:
        f[at] += error
    traced = fgls.estimate_along_log(A, f, 50, ends(100, 50))
    for array in (traced.theta, traced.std, traced.residual_rms, traced.condition):
        assert np.isfinite(array).all()


def test_a_whole_window_of_zeros_is_zero():
    traced = fgls.estimate_along_log(exact_log()[0], np.zeros(100), 50, ends(100, 50))
    np.testing.assert_array_equal(traced.theta, 0.0)
    np.testing.assert_array_equal(traced.std, 0.0)
    np.testing.assert_array_equal(fgls.fit(exact_log()[0], np.zeros(100)).theta, 0.0)


def test_no_weight_exceeds_the_guards():
    A, f = exact_log(50)
    f = f + np.where(np.arange(50) % 2, 1.0, -1.0) * np.linspace(0.0, 1.0, 50)
    first = ls.fit(A, f)
    residual = f - A @ first.theta
    weight = 1.0 / np.maximum(residual**2, (0.3 * first.residual_rms) ** 2)
    root = np.sqrt(weight)
    expected = np.linalg.lstsq(A * root[:, None], f * root)[0]
    np.testing.assert_allclose(fgls.fit(A, f, fgls.FglsOptions(0.3)).theta, expected, rtol=1e-12)


def test_a_spike_weighs_less_than_in_ls():
    A, f = exact_log()
    f = f + 0.01 * np.random.default_rng(1).normal(size=100)
    f[40] += 50.0
    truth = np.array([2.0, 3.0])
    error_ls = np.abs(ls.fit(A, f).theta - truth).max()
    error_fgls = np.abs(fgls.fit(A, f).theta - truth).max()
    assert error_fgls < 0.2 * error_ls


@pytest.mark.parametrize("floor", [0.05, 1.0])
def test_equal_residuals_leave_ls_as_it_is(floor):
    A = np.column_stack([np.ones(40), np.zeros(40)])
    A[:, 1] = np.repeat([1.0, -1.0], 20)
    f = A @ np.array([5.0, 1.0]) + np.tile([1.0, -1.0], 20)
    options = fgls.FglsOptions(floor)
    np.testing.assert_allclose(fgls.fit(A, f, options).theta, ls.fit(A, f).theta, rtol=1e-12)
