"""From a later m̂ back to its mass, with Fieller's interval."""

import numpy as np
import pytest
from scipy.stats import chi2, norm
from scipy.stats import t as student_t

from analysis.calibration.line.line_inversion import LineInversion, compute_two_sided_student_factor
from analysis.calibration.line.line_model import RunMeans, fit_line_and_variances
from analysis.calibration.line.variance_components import WithinRunVariance

X = np.array([0.0, 50.0, 100.0, 150.0, 200.0, 250.0])
NONE = np.array([np.nan])


def inverse(y, x=X):
    """Of single readings with exact references: plain regression."""
    count = y.size
    ones = np.ones(count, np.int64)
    points = RunMeans(
        y, ones, np.arange(count), 0 * ones, x, np.zeros((count, count)), WithinRunVariance(0, 0)
    )
    return LineInversion.from_line(fit_line_and_variances(points))


def textbook(x, y, y0):
    """Fieller's interval of plain regression, m = 1 (Draper and Smith, 3.2)."""
    n = x.size
    slope, level = np.polyfit(x - x.mean(), y, 1)
    left = y - level - slope * (x - x.mean())
    s = np.sqrt(left @ left / (n - 2))
    t, squares = student_t.ppf(0.975, n - 2), ((x - x.mean()) ** 2).sum()
    g = t**2 * s**2 / (slope**2 * squares)
    away = (y0 - level) / slope
    root = np.sqrt((1 - g) * (1 + 1 / n) + away**2 / squares)
    centre, half = away / (1 - g), t * s / slope * root / (1 - g)
    return x.mean() + centre - half, x.mean() + centre + half


@pytest.mark.parametrize("y0", [-40.0, 60.0, 128.0, 400.0])
def test_the_interval_is_fieller_s_of_the_textbook(y0):
    y = X + np.array([3.0, -5.0, 8.0, -2.0, -7.0, 4.0])
    found = inverse(y).invert_mass_estimates(np.array([y0]), np.ones(1), NONE, 0.95)
    assert (found.low_kg[0], found.high_kg[0]) == pytest.approx(textbook(X, y, y0), rel=1e-6)


def test_a_slope_that_cannot_be_told_from_nothing_bounds_no_mass():
    y = np.array([100.0, 300.0, 80.0, 290.0, 110.0, 310.0])
    found = inverse(y).invert_mass_estimates(np.array([200.0]), np.ones(1), NONE, 0.95)
    assert np.isnan([found.low_kg[0], found.high_kg[0]]).all()


def test_the_interval_of_the_slope_is_the_textbook_s():
    y = X + np.array([3.0, -5.0, 8.0, -2.0, -7.0, 4.0])
    slope, level = np.polyfit(X - 125.0, y, 1)
    left = y - level - slope * (X - 125.0)
    half = student_t.ppf(0.975, 4) * np.sqrt(left @ left / 4 / ((X - 125.0) ** 2).sum())
    found = inverse(y).compute_slope_interval(0.95)
    assert found == pytest.approx((slope - half, slope + half), rel=1e-6)


def test_tails_are_those_of_the_distribution_behind_the_interval():
    y = X + np.array([3.0, -5.0, 8.0, -2.0, -7.0, 4.0])
    found = inverse(y)
    u = found.compute_later_mass_u_kg(100.0, 1.0)
    for distance in (0.0, 5.0, 20.0):
        exact = student_t.sf(distance / u, 4)
        assert found.compute_exceedance_probability(distance, 100.0, 1.0) == pytest.approx(
            exact, abs=1e-4
        )
        assert found.compute_exceedance_probability(-distance, 100.0, 1.0) == pytest.approx(
            1.0 - exact, abs=1e-4
        )
    assert found.compute_exceedance_probability(1e9, 100.0, 1.0) <= 1e-6


def test_student_s_factor_is_the_normal_one_where_all_is_known():
    assert compute_two_sided_student_factor(0.95, np.array([np.inf, 4.0])) == pytest.approx(
        [norm.ppf(0.975), student_t.ppf(0.975, 4)]
    )


def test_the_chi_square_of_the_readings_is_the_freedom_of_their_repeatability():
    dice = np.random.default_rng(5)
    squares = 400.0 * chi2.rvs(54, random_state=dice)
    points = RunMeans(
        X + dice.normal(0.0, 6.0, 6), np.full(6, 10), np.arange(6), np.zeros(6, np.int64), X,
        np.zeros((6, 6)), WithinRunVariance(squares, 54),
    )  # fmt: skip
    found = LineInversion.from_line(fit_line_and_variances(points))
    assert found.variance_kg2[0] == pytest.approx(squares / 54, rel=1e-6)
