"""Recursive least squares against what its recursion solves."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimators.methods import ls, rls


def make(seed, n=300, noise=60.0, parameters=2):
    generator = np.random.default_rng(seed)
    A = generator.normal(size=(n, parameters)) + 0.5
    return A, A @ np.array([3614.0, 2891.0, 300.0])[:parameters] + noise * generator.normal(size=n)


@pytest.mark.heavy
@settings(deadline=None, max_examples=100)
@given(st.integers(0, 2**32 - 1), st.floats(0.9, 1.0), st.integers(2, 3))
def test_the_recursion_solves_the_discounted_batch_with_its_start_as_information(
    seed, forgetting, parameters
):
    """With P₀⁻¹ = σ² I, information and its product with θ each fall by λ a sample."""
    A, f = make(seed, n=120, parameters=parameters)
    window = 40
    sigma2 = A[:window].var(axis=0).min()
    information = sigma2 * np.eye(parameters)
    product = information @ np.linalg.lstsq(A[:window], f[:window])[0]
    for a, force in zip(A[window:], f[window:], strict=True):
        information = forgetting * information + np.outer(a, a)
        product = forgetting * product + a * force
    traced = rls.estimate_along_log(
        A, f, window, np.arange(120) >= window - 1, rls.RlsOptions(forgetting)
    )
    np.testing.assert_allclose(traced.theta[-1], np.linalg.solve(information, product), rtol=1e-9)


def test_each_sample_is_fed_once_however_many_windows_share_it():
    A, f = make(1)
    every = np.arange(300) >= 99
    some = every & ((np.arange(300) - 99) % 67 == 0)
    dense, sparse = (rls.estimate_along_log(A, f, 100, accepted) for accepted in (every, some))
    np.testing.assert_allclose(
        sparse.theta, dense.theta[np.isin(dense.index, sparse.index)], rtol=1e-12
    )


def test_what_is_forgotten_does_not_matter_any_more():
    A, f = make(2, n=2000, noise=1.0)
    f[:1000] = A[:1000] @ np.array([5000.0, 1000.0])
    traced = rls.estimate_along_log(A, f, 100, np.arange(2000) >= 99, rls.RlsOptions(0.95))
    np.testing.assert_allclose(traced.theta[900], [5000.0, 1000.0], rtol=1e-6)
    np.testing.assert_allclose(traced.theta[-1], [3614.0, 2891.0], atol=2.0)


@pytest.mark.parametrize("sign", [1.0, 5.0])
def test_a_column_that_stays_the_same_in_the_first_window_neither_overflows_nor_sticks(sign):
    A, f = make(3, n=600, noise=10.0)
    A = np.column_stack([5.0 * A, np.full(600, sign)])
    f = 5.0 * f + 300.0 * sign
    traced = rls.estimate_along_log(A, f, 100, np.arange(600) >= 99, rls.RlsOptions(1.0))
    whole = ls.fit(A[100:], f[100:])
    np.testing.assert_allclose(traced.theta[-1], whole.theta, rtol=0.02)
    assert np.isfinite(traced.std).all()


def test_without_forgetting_its_deviation_is_that_of_ls_on_all_samples():
    A, f = make(4, n=3000)
    traced = rls.estimate_along_log(A, f, 100, np.arange(3000) >= 99, rls.RlsOptions(1.0))
    np.testing.assert_allclose(traced.std[-1], ls.fit(A[100:], f[100:]).std, rtol=0.05)


def test_step_leaves_the_state_it_was_given():
    A, f = make(5)
    state = rls.start(A[:50], f[:50])
    theta, P = state.theta.copy(), state.P.copy()
    following = rls.step(state, A[50], f[50])
    np.testing.assert_array_equal(state.theta, theta)
    np.testing.assert_array_equal(state.P, P)
    assert not np.array_equal(following.theta, theta)
    np.testing.assert_array_equal(following.P, following.P.T)
