"""Small symmetric systems against LAPACK."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimators.numerics.small_systems import (
    compute_scaled_condition,
    factor_covariance,
    invert_positive_definite,
    solve_positive_definite,
)


def gram(seed, p, scales):
    A = np.random.default_rng(seed).normal(size=(12, p)) * scales
    return A.T @ A


@settings(deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.integers(1, 3),
    st.lists(st.floats(1e-6, 1e6), min_size=3, max_size=3),
)
def test_solutions_inverses_and_condition_are_lapacks_whatever_the_units(seed, p, scales):
    scales = np.array(scales[:p])
    G = gram(seed, p, scales)
    np.testing.assert_allclose(solve_positive_definite(G, G @ (1 / scales)), 1 / scales, rtol=1e-8)
    identity = invert_positive_definite(G) @ G * np.outer(scales, 1 / scales)
    np.testing.assert_allclose(identity, np.eye(p), atol=1e-8)
    unit = G / np.sqrt(np.outer(np.diag(G), np.diag(G)))
    assert compute_scaled_condition(G) == pytest.approx(np.sqrt(np.linalg.cond(unit)), rel=1e-6)


@pytest.mark.parametrize(
    "G",
    [
        [[0.0, 0.0], [0.0, 1.0]],
        [[1.0, 1.0], [1.0, 1.0]],
        [[4.0, 2.0, 6.0], [2.0, 1.0, 3.0], [6.0, 3.0, 9.0]],
        [[np.nan, 0.0], [0.0, 1.0]],
        [[1.0, 2.0], [2.0, 1.0]],
    ],
    ids=["a zero column", "equal columns", "rank one", "nan", "indefinite"],
)
def test_a_singular_matrix_has_no_solution_and_an_infinite_condition(G):
    G = np.array(G)
    assert np.isnan(solve_positive_definite(G, np.ones(len(G)))).all()
    assert np.isnan(invert_positive_definite(G)).all()
    assert compute_scaled_condition(G) > 1e7


@pytest.mark.parametrize("rank", [1, 2, 3])
def test_a_covariance_is_factored_also_where_a_combination_has_no_variance(rank: int) -> None:
    draws = np.random.default_rng(rank).normal(size=(3, rank)) * np.array([[1e3], [1.0], [1e-4]])
    covariance = draws @ draws.T
    lower = factor_covariance(covariance)
    np.testing.assert_allclose(lower @ lower.T, covariance, rtol=1e-6, atol=1e-12)
    assert not np.triu(lower, 1).any()
    assert (np.diag(lower) >= 0.0).all()
