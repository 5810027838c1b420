"""What a fit takes out of its residuals' autocovariances, against the matrices that say so."""

import numpy as np
import pytest

from estimators.numerics.fit_loss import compute_fit_loss

LAGS = 9


def shifts(n):
    """R_l: ones at the distances ±l."""
    return [np.eye(n, k=lag) + (np.eye(n, k=-lag) if lag else 0.0) for lag in range(LAGS)]


def by_matrices(A):
    n = A.shape[0]
    Q, _ = np.linalg.qr(A)
    M = np.eye(n) - Q @ Q.T
    R = shifts(n)
    D = [R[0], *(r / 2.0 for r in R[1:])]
    lost = [[np.trace(d @ r) - np.trace(d @ M @ r @ M) for r in R] for d in D]
    return np.array(lost) / (n - np.arange(LAGS))[:, None]


def walk(seed, n, parameters):
    return np.random.default_rng(seed).normal(size=(n, parameters)).cumsum(axis=0)


@pytest.mark.parametrize("parameters", [1, 2, 3])
@pytest.mark.parametrize("n", [12, 60])
def test_the_loss_of_one_fit_is_that_of_its_residual_maker(n, parameters):
    A = walk(1, n, parameters)
    group = np.full(n + 4, -1)
    group[2:-2] = 5
    padded = np.full((n + 4, parameters), np.nan)
    padded[2:-2] = A
    np.testing.assert_allclose(compute_fit_loss(padded, group, LAGS), by_matrices(A), atol=1e-12)


def test_the_loss_of_equal_fits_is_that_of_one():
    A = walk(2, 50, 2)
    both = compute_fit_loss(np.concatenate([A, A]), np.repeat([0, 1], 50), LAGS)
    np.testing.assert_allclose(both, by_matrices(A), atol=1e-12)


def test_a_column_that_depends_on_others_takes_nothing_more():
    A = walk(3, 50, 2)
    more = np.column_stack([A, A @ [2.0, -1.0]])
    group = np.zeros(50, np.int64)
    np.testing.assert_allclose(
        compute_fit_loss(more, group, LAGS), compute_fit_loss(A, group, LAGS), atol=1e-9
    )


def test_a_fit_of_very_many_samples_loses_nothing_worth_counting():
    assert not compute_fit_loss(walk(4, 4000, 2), np.zeros(4000, np.int64), LAGS).any()


def test_put_back_autocovariances_are_right_on_average():
    """Fits of 60 samples to residuals of a mean of five: each lag has lost up to a third."""
    generator = np.random.default_rng(5)
    A = walk(6, 60, 2)
    M = np.eye(60) - A @ np.linalg.pinv(A)
    loss = compute_fit_loss(A, np.zeros(60, np.int64), LAGS)
    noise = np.lib.stride_tricks.sliding_window_view(generator.normal(size=(20_000, 64)), 5, axis=1)
    residual = noise.mean(axis=2) @ M
    found = [(residual[:, : 60 - j] * residual[:, j:]).mean() for j in range(LAGS)]
    truth = np.maximum(1.0 - np.arange(LAGS) / 5.0, 0.0) / 5.0
    np.testing.assert_allclose(found, truth - loss @ truth, atol=1e-3)
    assert np.abs(loss @ truth).max() > 0.1 * truth[0]
