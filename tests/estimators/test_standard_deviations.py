"""What the standard deviations promise, against the spread of simulated campaigns.

A moving mean correlates the residuals over its length; the textbook formula does not know that.
"""

import numpy as np
import pytest
from scipy.stats import norm, t

from estimators.methods import ls, pooled, rls, rtls
from estimators.methods.ls import average_over_windows_with_std
from estimators.methods.tls import TlsOptions
from estimators.numerics.autocorrelation import (
    compute_disjoint_window_residuals,
    compute_student_to_normal_ratio,
    estimate_pooled_autocorrelation,
)
from estimators.numerics.sandwich import compute_sandwich_meat, compute_sandwich_stds
from tests.twins import mark_slow_after

TRUTH = np.array([3614.0, 2891.0])
RUNS, SAMPLES, MEAN = 9, 320, 10


def campaign(seed):
    """Nine full-throttle starts at 100 Hz, 200 N of force noise, all after a mean of 10 samples."""
    generator = np.random.default_rng(seed)
    t_s = np.arange(SAMPLES + MEAN - 1) / 100.0
    kernel = np.ones(MEAN) / MEAN
    A, f = [], []
    for _ in range(RUNS):
        a = (1.5 + 0.3 * generator.normal()) * np.exp(-t_s / 1.25)
        v = 2.0 * (1.0 - np.exp(-t_s / 1.25))
        raw = np.column_stack([a, v])
        force = raw @ TRUTH + 200.0 * generator.normal(size=t_s.size)
        A.append(np.column_stack([np.convolve(x, kernel, "valid") for x in raw.T]))
        f.append(np.convolve(force, kernel, "valid"))
    return np.concatenate(A), np.concatenate(f), np.repeat(np.arange(RUNS), SAMPLES)


def accepted_ends(window):
    """Every window that lies inside one start."""
    return np.tile(np.arange(SAMPLES) >= window - 1, RUNS)


def textbook(A, f, theta):
    residual = f - A @ theta
    variance = residual @ residual / (f.size - 2)
    return np.sqrt(variance * np.diag(np.linalg.inv(A.T @ A)))


@pytest.mark.heavy
def test_nominal_95_percent_intervals_of_segments_cover_0_92_to_0_97_where_the_textbooks_miss():
    covered, covered_by_textbook = [], []
    for seed in range(200):
        A, f, manoeuvre_of_sample = campaign(seed)
        traced = pooled.estimate_along_log(A, f, manoeuvre_of_sample)
        covered.extend(np.abs(traced.theta - TRUTH) < 1.96 * traced.std)
        for run, theta in enumerate(traced.theta):
            mine = manoeuvre_of_sample == run
            std = textbook(A[mine], f[mine], theta)
            covered_by_textbook.append(np.abs(theta - TRUTH) < 1.96 * std)
    assert (np.mean(covered, axis=0) > 0.92).all()
    assert (np.mean(covered, axis=0) < 0.97).all()
    assert (np.mean(covered_by_textbook, axis=0) < 0.7).all()


def test_the_deviation_of_a_mean_of_overlapping_windows_is_its_spread():
    means, stds = [], []
    for seed in range(1000, 1120):
        A, f, _ = campaign(seed)
        traced = ls.estimate_along_log(A, f, 200, accepted_ends(200))
        theta, std = average_over_windows_with_std(
            A, f, 200, traced.index, traced.theta, traced.std
        )
        means.append(theta)
        stds.append(std)
    spread = np.std(means, axis=0, ddof=1)
    np.testing.assert_allclose(np.mean(stds, axis=0), spread, rtol=0.15)
    assert (np.abs(np.mean(means, axis=0) - TRUTH) < 4 * spread / np.sqrt(120)).all()


NOISE = TlsOptions((1e-3, 5e-4), 63.0)
#: Two seconds each: one of each recursion and of each memory first.
RECURSIONS = mark_slow_after(
    2,
    [
        pytest.param(rls, rls.RlsOptions(0.998), id="rls"),
        pytest.param(rtls, rtls.RtlsOptions(NOISE, 0.98), id="rtls that forgets within a start"),
        pytest.param(rls, rls.RlsOptions(0.98), id="rls that forgets within a start"),
        pytest.param(
            *(rls, rls.RlsOptions(0.98, directional=True)),
            id="rls that forgets along the samples alone",
        ),
        pytest.param(rtls, rtls.RtlsOptions(NOISE, 0.998), id="rtls"),
    ],
)


@pytest.mark.parametrize(("method", "options"), RECURSIONS)
def test_the_deviation_of_a_recursion_is_its_spread_from_its_first_window_to_its_end(
    method, options
):
    thetas, stds = [], []
    for seed in range(2000, 2120):
        A, f, _ = campaign(seed)
        traced = method.estimate_along_log(A, f, 200, accepted_ends(200), options)
        rows = [0, traced.index.size // 2, -1]
        thetas.append(traced.theta[rows])
        stds.append(traced.std[rows])
    # 120 campaigns tell a spread to within 6.5 % (one sigma)
    spread = np.std(thetas, axis=0, ddof=1)
    np.testing.assert_allclose(np.mean(stds, axis=0), spread, rtol=0.25)
    covered = np.mean(np.abs(np.array(thetas) - TRUTH) < 1.96 * np.array(stds), axis=0)
    assert (covered > 0.88).all()


def test_a_mean_of_one_window_is_that_window():
    A, f, _ = campaign(1)
    traced = ls.estimate_along_log(A, f, 320, accepted_ends(320) & (np.arange(f.size) == 319))
    theta, std = average_over_windows_with_std(A, f, 320, traced.index, traced.theta, traced.std)
    np.testing.assert_allclose(theta, traced.theta[0])
    np.testing.assert_allclose(std, traced.std[0], rtol=0.1)


def test_a_mean_leaves_out_windows_without_an_estimate_and_is_nan_without_any():
    A, f, _ = campaign(2)
    traced = ls.estimate_along_log(A, f, 200, accepted_ends(200))
    unsolved = traced.index % 3 == 0
    holes = np.where(unsolved[:, None], np.nan, traced.theta)
    kept = average_over_windows_with_std(
        A, f, 200, traced.index[~unsolved], traced.theta[~unsolved], traced.std[~unsolved]
    )
    for given, expected in zip(
        average_over_windows_with_std(A, f, 200, traced.index, holes, traced.std),
        kept,
        strict=True,
    ):
        np.testing.assert_allclose(given, expected)
    nothing = average_over_windows_with_std(
        A, f, 200, traced.index, np.full_like(holes, np.nan), traced.std
    )
    assert np.isnan(nothing).all()


@pytest.mark.parametrize("samples", [20, SAMPLES])
def test_without_correlation_the_sandwich_is_the_textbooks_student_interval_over_1_96(samples):
    A, f, _ = campaign(3)
    A, f = A[:samples], f[:samples]
    one = ls.fit(A, f, autocorrelation=np.ones(1))
    student = t.ppf(0.975, samples) / norm.ppf(0.975)
    np.testing.assert_allclose(one.std, student * textbook(A, f, one.theta), rtol=1e-4)


@pytest.mark.parametrize("freedom", [3.0, 4.0, 7.5, 30.0, 1e6])
def test_the_factor_of_few_degrees_of_freedom_is_students(freedom):
    exact = t.ppf(0.975, freedom) / norm.ppf(0.975)
    assert compute_student_to_normal_ratio(freedom) == pytest.approx(exact, rel=0.005)


def test_hardly_any_degree_of_freedom_counts_as_three():
    assert compute_student_to_normal_ratio(0.1) == compute_student_to_normal_ratio(3.0)


def test_the_middle_of_the_sandwich_is_the_regressor_around_the_correlation_matrix():
    A = np.random.default_rng(4).normal(size=(60, 3))
    correlation = np.array([1.0, 0.6, 0.3, 0.1])
    group = np.where(np.arange(60) % 11 == 0, -1, 0)
    lag = np.abs(np.subtract.outer(np.arange(60), np.arange(60)))
    R = np.where(lag < 4, correlation[np.minimum(lag, 3)], 0.0)
    R[group < 0] = R[:, group < 0] = 0.0
    B = compute_sandwich_meat(A, group, 0, 0, 59, correlation)
    np.testing.assert_allclose(B, A.T @ R @ A, rtol=1e-12)


def test_fewer_samples_than_a_deviation_needs_give_nan():
    A = np.random.default_rng(5).normal(size=(2, 2))
    B = compute_sandwich_meat(A, np.zeros(2, np.int64), 0, 0, 1, np.ones(1))
    assert np.isnan(compute_sandwich_stds(A.T @ A, B, 0.0, 2.0)).all()


@pytest.mark.parametrize("seed", range(10))
def test_white_residuals_keep_one_lag_effectively(seed):
    white = np.random.default_rng(seed).normal(size=3000)
    correlation, variance = estimate_pooled_autocorrelation(
        white, np.repeat(np.arange(10), 300), None
    )
    assert correlation[0] == 1.0
    assert np.abs(correlation[1:]).sum() < 0.1
    assert variance == pytest.approx(1.0, abs=0.1)


def test_a_mean_of_ten_is_seen_as_the_triangle_that_it_is():
    white = np.random.default_rng(6).normal(size=30_009)
    smoothed = np.convolve(white, np.ones(10) / 10, "valid")
    group = np.repeat(np.arange(100), 300)
    correlation, variance = estimate_pooled_autocorrelation(smoothed, group, None)
    triangle = np.maximum(1 - np.arange(correlation.size) / 10, 0)
    np.testing.assert_allclose(correlation, triangle, atol=0.06)
    assert variance == pytest.approx(0.1, rel=0.05)


def test_a_part_of_many_residuals_tells_what_all_of_them_do():
    white = np.random.default_rng(7).normal(size=1_200_009)
    smoothed = np.convolve(white, np.ones(10) / 10, "valid")
    for group in (np.zeros(smoothed.size, np.int64), np.arange(smoothed.size) // 240):
        correlation, variance = estimate_pooled_autocorrelation(smoothed, group, None)
        assert 2.0 * correlation.sum() - 1.0 == pytest.approx(10.0, rel=0.04)
        assert variance == pytest.approx(0.1, rel=0.03)


@pytest.mark.parametrize(
    ("residual", "group", "variance"),
    [
        (np.zeros(100), np.zeros(100), 0.0),
        (np.ones(3), np.zeros(3), np.nan),
        (np.full(100, np.nan), np.full(100, -1), np.nan),
    ],
    ids=["all zero", "fewer than the parameters", "none"],
)
def test_residuals_that_say_nothing_have_no_correlation(residual, group, variance):
    A = np.ones((residual.size, 3))
    correlation, found = estimate_pooled_autocorrelation(residual, group.astype(np.int64), A)
    np.testing.assert_array_equal(correlation, [1.0])
    np.testing.assert_array_equal(found, variance)


def test_lags_never_join_two_groups():
    """Each group is constant and alternates in sign with the next: no lag may see both."""
    residual = np.repeat(np.tile([1.0, -1.0], 20), 50)
    correlation, _ = estimate_pooled_autocorrelation(residual, np.repeat(np.arange(40), 50), None)
    assert (correlation[: correlation.size // 2] == 1.0).all()


def test_windows_that_share_samples_are_thinned_to_disjoint_ones_first_come_first():
    A, f = np.ones((22, 1)), np.arange(22.0)
    index = np.array([4, 5, 9, 10, 19])
    residual, owner = compute_disjoint_window_residuals(A, f, np.arange(5.0)[:, None], index, 5)
    expected = [0] * 5 + [2] * 5 + [-1] * 5 + [4] * 5 + [-1] * 2
    np.testing.assert_array_equal(owner, expected)
    np.testing.assert_array_equal(residual, np.where(owner < 0, 0.0, f - owner))
