"""Mutual information by nearest neighbours: against its definition, and where it is known."""

import numpy as np
import pytest
from scipy.special import digamma

from estimators.numerics.nearest_neighbours import estimate_window_mutual_information


def by_definition(x: np.ndarray, y: np.ndarray, k: int) -> float:
    x, y = x / x.std(), y / y.std()
    dx, dy = np.abs(x[:, None] - x), np.abs(y[:, None] - y)
    both = np.maximum(dx, dy)
    np.fill_diagonal(both, np.inf)
    radius = np.sort(both, axis=1)[:, k - 1 : k]
    n_x, n_y = (dx < radius).sum(1) - 1, (dy < radius).sum(1) - 1
    return float(digamma(k) + digamma(x.size) - (digamma(n_x + 1) + digamma(n_y + 1)).mean())


@pytest.mark.parametrize("k", [1, 4, 10])
def test_each_window_equals_the_definition(k: int) -> None:
    rng = np.random.default_rng(1)
    x, y = rng.normal(size=(2, 300))
    y += 0.7 * x
    ends = np.array([99, 150, 299])
    found = estimate_window_mutual_information(x, y, 100, ends, k)
    expected = [by_definition(x[e - 99 : e + 1], y[e - 99 : e + 1], k) for e in ends]
    np.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9, -0.9])
def test_gaussian_series_have_the_known_information_whatever_the_sign(rho: float) -> None:
    rng = np.random.default_rng(2)
    x, noise = rng.normal(size=(2, 3000))
    y = rho * x + np.sqrt(1 - rho**2) * noise
    (found,) = estimate_window_mutual_information(x, y, 3000, np.array([2999]), 4)
    assert found == pytest.approx(-0.5 * np.log(1 - rho**2), abs=0.06)


def test_units_do_not_matter_and_a_dependence_without_correlation_is_seen() -> None:
    rng = np.random.default_rng(3)
    x = rng.normal(size=1000)
    y = x**2 + 0.05 * rng.normal(size=1000)
    ends = np.array([999])
    (found,) = estimate_window_mutual_information(x, y, 1000, ends, 4)
    (scaled,) = estimate_window_mutual_information(1e6 * x, 1e-3 * y, 1000, ends, 4)
    assert abs(np.corrcoef(x, y)[0, 1]) < 0.2
    assert found > 1.0
    assert scaled == pytest.approx(found, rel=1e-9)


def test_a_constant_or_missing_series_has_none() -> None:
    x = np.random.default_rng(4).normal(size=50)
    holed = np.where(np.arange(50) == 10, np.nan, x)
    ends = np.array([49])
    assert np.isnan(estimate_window_mutual_information(x, np.ones(50), 50, ends, 4)).all()
    assert np.isnan(estimate_window_mutual_information(holed, x, 50, ends, 4)).all()
