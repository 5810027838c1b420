"""How far noise in the columns draws least squares, from what it found."""

import numpy as np
import pytest

from estimators.methods import ls
from estimators.methods.attenuation import (
    compute_attenuation_by_noise_source,
    compute_attenuation_corrections_of_windows,
)
from estimators.methods.ls import average_over_windows_with_std

TRUTH, NOISE = np.array([100.0, 20.0]), np.array([0.3, 0.1])
COVARIANCE = np.diag([*NOISE**2, 0.0])


def noisy(n=4000, seed=5):
    generator = np.random.default_rng(seed)
    clean = generator.normal(size=(n, 2)) @ [[1.0, 0.4], [0.0, 1.0]]
    f = clean @ TRUTH + generator.normal(size=n)
    return clean, clean + NOISE * generator.normal(size=(n, 2)), f


def test_it_undoes_exactly_what_noise_adds_to_the_products():
    """With AᵀA = A₀ᵀA₀ + N and Aᵀf = A₀ᵀA₀ θ₀."""
    clean, _, _ = noisy()
    added = clean.shape[0] * NOISE**2
    exact = clean.T @ clean
    G = exact + np.diag(added)
    theta = np.linalg.solve(G, exact @ TRUTH)
    drawn = compute_attenuation_by_noise_source(G, theta, added)
    np.testing.assert_allclose(theta + drawn.sum(axis=1), TRUTH, rtol=1e-12)
    alone = compute_attenuation_by_noise_source(G, theta, added * [1.0, 0.0])
    assert not alone[:, 1].any()


def test_columns_that_are_no_more_than_their_noise_give_nan():
    assert np.isnan(
        compute_attenuation_by_noise_source(np.eye(2), TRUTH, np.array([1.1, 0.0]))
    ).all()


def test_windows_are_drawn_by_about_what_is_predicted_of_each():
    _, A, f = noisy()
    accepted = np.ones(f.size, np.bool_)
    traced = ls.estimate_along_log(A, f, 1000, accepted)
    drawn = compute_attenuation_corrections_of_windows(
        A, f, 1000, traced.index, traced.theta, COVARIANCE
    )
    assert drawn.shape == traced.theta.shape
    assert (np.abs(traced.theta - TRUTH) > 5 * traced.std)[:, 0].all()
    np.testing.assert_allclose(traced.theta + drawn, np.broadcast_to(TRUTH, drawn.shape), atol=4.0)


def test_the_mean_of_windows_does_not_average_away_what_draws_them_all_alike():
    _, A, f = noisy()
    traced = ls.estimate_along_log(A, f, 200, np.ones(f.size, np.bool_))
    drawn = compute_attenuation_corrections_of_windows(
        A, f, 200, traced.index, traced.theta, COVARIANCE
    )
    mean, std = average_over_windows_with_std(A, f, 200, traced.index, traced.theta, traced.std)
    same, wider = average_over_windows_with_std(
        A, f, 200, traced.index, traced.theta, traced.std, drawn
    )
    np.testing.assert_array_equal(mean, same)
    assert (np.abs(mean - TRUTH) > 3 * std).all()
    assert np.sqrt(wider**2 - std**2) == pytest.approx(np.abs(mean - TRUTH), rel=0.2)
