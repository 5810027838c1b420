"""A straight line with errors in both variables (ISO/TS 28037)."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.calibration.line.distance_regression import fit_line_by_generalised_distance
from estimators.errors import DataError

#: x, u(x), y, u(y), and what the examples print: a, b, u(a), u(b), cov(a, b), χ².
EXAMPLES = {
    "equal uncertainties": (
        [1.0, 2.0, 3.0, 4.0, 5.0, 6.0],
        [0.0] * 6,
        [3.3, 5.6, 7.1, 9.3, 10.7, 12.1],
        [0.5] * 6,
        ("1.8667", "1.7571", "0.4655", "0.1195", "-0.0500", "1.665"),
    ),
    "unequal uncertainties": (
        [1.0, 2.0, 3.0, 4.0, 5.0, 6.0],
        [0.0] * 6,
        [3.2, 4.3, 7.6, 8.6, 11.7, 12.8],
        [0.5] * 3 + [1.0] * 3,
        ("0.8852", "2.0570", "0.5297", "0.1779", "-0.0823", "4.131"),
    ),
    "errors in both": (
        [1.2, 1.9, 2.9, 4.0, 4.7, 5.9],
        [0.2] * 6,
        [3.4, 4.4, 7.2, 8.5, 10.8, 13.5],
        [0.2] * 3 + [0.4] * 3,
        ("0.5788", "2.1597", "0.4764", "0.1355", "-0.0577", "2.743"),
    ),
}


@pytest.mark.parametrize("name", EXAMPLES)
def test_a_worked_example_comes_out_to_its_printed_digits(name):
    x, u_x, y, u_y, printed = EXAMPLES[name]
    line = fit_line_by_generalised_distance(
        np.array(x), np.array(y), np.diag(np.square(u_x)), np.diag(np.square(u_y))
    )
    u_a, u_b = np.sqrt(np.diag(line.covariance))
    found = (line.intercept, line.slope, u_a, u_b, line.covariance[0, 1])
    assert [f"{value:.4f}" for value in found] == list(printed[:5])
    assert f"{line.chi2:.3f}" == printed[5]
    assert line.degrees_of_freedom == 4


#: Drums weighed one after the other on one scale: x shares most of its errors.
X = np.array([10.0, 20.0, 30.0, 40.0, 50.0])
X_COV = 0.4**2 + np.minimum.outer(np.arange(1, 6), np.arange(1, 6)) * 0.3**2
Y_COV = np.diag([0.5, 0.5, 0.5, 1.0, 1.0]) ** 2 + 0.3**2


@pytest.mark.heavy
def test_correlated_references_have_the_uncertainties_of_a_monte_carlo():
    dice = np.random.default_rng(4)
    drawn = []
    for _ in range(2000):
        x = dice.multivariate_normal(X, X_COV)
        y = dice.multivariate_normal(3.0 + 2.0 * X, Y_COV)
        line = fit_line_by_generalised_distance(x, y, X_COV, Y_COV)
        drawn.append((line.intercept, line.slope, line.chi2))
    values = np.array(drawn)
    stated = fit_line_by_generalised_distance(X, 3.0 + 2.0 * X, X_COV, Y_COV).covariance
    found = np.cov(values[:, :2].T)
    assert values[:, 0].mean() == pytest.approx(3.0, abs=0.12)
    assert values[:, 1].mean() == pytest.approx(2.0, abs=0.003)
    # 2000 draws tell a deviation to 1.6 %
    assert np.sqrt(np.diag(found)) == pytest.approx(np.sqrt(np.diag(stated)), rel=0.06)
    assert found[0, 1] == pytest.approx(stated[0, 1], rel=0.12)
    assert values[:, 2].mean() == pytest.approx(3.0, rel=0.05)
    # taken for independent the same errors would be stated too small at the centre
    alone = fit_line_by_generalised_distance(
        X, 3.0 + 2.0 * X, np.diag(np.diag(X_COV)), np.diag(np.diag(Y_COV))
    )
    centre = np.array([1.0, 30.0])
    assert centre @ stated @ centre > 1.5 * (centre @ alone.covariance @ centre)


@given(
    st.lists(st.floats(-5.0, 5.0), min_size=5, max_size=5),
    st.floats(0.0, 1.0),
    st.floats(-100.0, 100.0),
    st.floats(0.1, 10.0),
)
def test_the_line_moves_and_scales_with_its_points(noise, u_x, shift, scale):
    y = 3.0 + 2.0 * X + np.array(noise)
    x_cov = u_x**2 * np.eye(5)
    line = fit_line_by_generalised_distance(X, y, x_cov, np.eye(5))
    other = fit_line_by_generalised_distance(
        scale * X + shift, scale * y, scale**2 * x_cov, scale**2 * np.eye(5)
    )
    assert other.slope == pytest.approx(line.slope, rel=1e-6)
    assert other.chi2 == pytest.approx(line.chi2, rel=1e-6, abs=1e-9)
    assert other.intercept + other.slope * shift == pytest.approx(
        scale * line.intercept, rel=1e-5, abs=1e-4
    )


def test_exact_abscissae_are_weighted_least_squares():
    y = np.array([21.0, 45.0, 62.0, 85.0, 101.0])
    line = fit_line_by_generalised_distance(X, y, np.zeros((5, 5)), Y_COV)
    design = np.column_stack([np.ones(5), X])
    weight = np.linalg.inv(Y_COV)
    covariance = np.linalg.inv(design.T @ weight @ design)
    assert np.array([line.intercept, line.slope]) == pytest.approx(
        covariance @ design.T @ weight @ y
    )
    assert line.covariance == pytest.approx(covariance)


@pytest.mark.parametrize(
    ("x", "y_cov", "said"),
    [
        (np.ones(5), np.eye(5), "two different masses"),
        (X, np.zeros((5, 5)), "not positive definite"),
        (X, -np.eye(5), "not positive definite"),
    ],
)
def test_points_that_determine_no_line_are_refused(x, y_cov, said):
    with pytest.raises(DataError, match=said):
        fit_line_by_generalised_distance(x, 2.0 * x, np.zeros((5, 5)), y_cov)
