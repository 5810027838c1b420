"""Least squares pooled over segments, wherever in the log their samples lie."""

import numpy as np

from estimators.methods import pooled
from estimators.numerics.autocorrelation import compute_student_to_normal_ratio


def interleaved(n=600, seed=1):
    """Two segments that alternate, with samples of neither between them."""
    generator = np.random.default_rng(seed)
    A = generator.normal(size=(n, 2)) + 1.0
    noise = np.convolve(generator.normal(size=n + 4), np.ones(5) / 5, "valid")
    manoeuvre_of_sample = np.tile([3, 3, 3, 8, 8, -1, 3, 8, 8, 8], n // 10).astype(np.int64)
    truth = np.where((manoeuvre_of_sample == 3)[:, None], [100.0, 20.0], [300.0, 50.0])
    f = np.einsum("ij,ij->i", A, truth) + noise
    A[manoeuvre_of_sample < 0] = np.nan
    return A, f, manoeuvre_of_sample


def test_rows_are_in_ascending_order_of_the_segments_at_their_last_samples():
    A, f, manoeuvre_of_sample = interleaved()
    traced = pooled.estimate_along_log(A, f, manoeuvre_of_sample)
    assert traced.index.tolist() == [596, 599]
    np.testing.assert_allclose(traced.theta, [[100, 20], [300, 50]], rtol=0.01)


def test_the_deviation_is_the_sandwich_over_the_segments_own_samples():
    A, f, manoeuvre_of_sample = interleaved()
    traced = pooled.estimate_along_log(A, f, manoeuvre_of_sample)
    lags = traced.autocorrelation
    for row, number in enumerate((3, 8)):
        at = np.flatnonzero(manoeuvre_of_sample == number)
        lag = np.abs(np.subtract.outer(at, at))
        R = np.where(lag < lags.size, lags[np.minimum(lag, lags.size - 1)], 0.0)
        bread = np.linalg.inv(A[at].T @ A[at])
        B = A[at].T @ R @ A[at]
        residual = f[at] - A[at] @ traced.theta[row]
        scale = residual @ residual / (at.size - np.trace(bread @ B))
        expected = np.sqrt(scale * np.diag(bread @ B @ bread))
        white = np.sqrt(residual @ residual / (at.size - 2) * np.diag(bread))
        widened = compute_student_to_normal_ratio(at.size / (1.0 + 2.0 * (lags[1:] ** 2).sum()))
        np.testing.assert_allclose(
            traced.std[row], widened * np.maximum(expected, white), rtol=1e-9
        )


def test_a_segment_that_does_not_determine_its_parameters_is_nan_and_spoils_no_other():
    A, f, manoeuvre_of_sample = interleaved()
    alone = pooled.estimate_along_log(
        A, f, np.where(manoeuvre_of_sample == 8, 8, -1).astype(np.int64)
    )
    A[manoeuvre_of_sample == 3, 1] = 2.0 * A[manoeuvre_of_sample == 3, 0]
    both = pooled.estimate_along_log(A, f, manoeuvre_of_sample)
    assert np.isnan(both.theta[0]).all()
    assert np.isnan(both.std[0]).all()
    np.testing.assert_allclose(both.theta[1], alone.theta[0], rtol=1e-12)
    np.testing.assert_allclose(both.std[1], alone.std[0], rtol=1e-9)


def test_known_noise_of_the_columns_is_taken_off_and_half_of_that_is_uncertainty():
    """Noise in a column draws its parameter towards zero; n σ² less in AᵀA undoes it."""
    n, noise = 20_000, np.array([0.3, 0.0])
    generator = np.random.default_rng(5)
    clean = generator.normal(size=(n, 2))
    f = clean @ [100.0, 20.0] + generator.normal(size=n)
    A = clean + noise * generator.normal(size=(n, 2))
    one = np.zeros(n, np.int64)
    ordinary = pooled.estimate_along_log(A, f, one)
    known = pooled.estimate_along_log(A, f, one, pooled.PooledOptions(np.diag([*noise**2, 0.0])))
    np.testing.assert_allclose(ordinary.theta[0, 0], 100.0 / 1.09, rtol=0.01)
    np.testing.assert_allclose(known.theta[0], [100.0, 20.0], rtol=0.02)
    change = known.theta[0] - ordinary.theta[0]
    assert (known.std[0] >= np.abs(change) / 2).all()


def test_noise_that_columns_and_force_share_is_taken_off_as_well():
    """A speed and its backward difference have one noise; so may a vibrating force."""
    n = 20_000
    covariance = np.array([[0.2, 0.1, 3.0], [0.1, 0.1, 0.0], [3.0, 0.0, 100.0]])
    generator = np.random.default_rng(6)
    clean = generator.normal(size=(n, 2))
    noise = generator.multivariate_normal(np.zeros(3), covariance, size=n)
    A, f = clean + noise[:, :2], clean @ [100.0, 20.0] + noise[:, 2]
    one = np.zeros(n, np.int64)
    known = pooled.estimate_along_log(A, f, one, pooled.PooledOptions(covariance))
    np.testing.assert_allclose(known.theta[0], [100.0, 20.0], rtol=0.05)
    alone = pooled.estimate_along_log(A, f, one, pooled.PooledOptions(np.diag(np.diag(covariance))))
    assert np.abs(alone.theta[0] - [100.0, 20.0]).max() > 2.0


def test_noise_that_is_larger_than_the_columns_leaves_no_number():
    A, f, manoeuvre_of_sample = interleaved()
    lost = pooled.estimate_along_log(
        A, f, manoeuvre_of_sample, pooled.PooledOptions(np.diag([81.0, 81.0, 0.0]))
    )
    assert np.isnan(lost.theta).all()
    assert np.isnan(lost.std).all()
