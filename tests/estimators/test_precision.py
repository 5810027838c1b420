"""Twelve hours, idle stretches, tiny variances and large means cost no more than nine digits.

What is exact is computed from the window alone: LAPACK's least squares and singular values, sums by
`math.fsum`, the recursion's information form in extended precision.
"""

import math

import numpy as np
import pytest

from estimators.methods import fgls, ls, rls, tls
from estimators.numerics.mutual_information import compute_window_correlation

W = 320
TWELVE_HOURS = 4_320_000
PICKED = 100_000
NOISE = tls.TlsOptions((0.01, 0.005), 60.0)


def shift(samples, seed=1):
    """Starts and stops, then an hour's share of idling, over and over; the paper's noise."""
    generator = np.random.default_rng(seed)
    t = np.arange(samples) / 100.0
    busy = (t // 90.0) % 2 == 0
    a = np.where(busy, 0.8 * np.cos(t * np.pi / 6.0), 0.0)
    v = np.where(busy, 1.5 + 1.5 * np.sin(t * np.pi / 6.0), 0.0)
    noise = generator.normal(size=(3, samples)) * np.array([[0.003], [0.0016], [19.0]])
    # at rest even the noise is small
    noise[:, ~busy] *= 1e-3
    A = np.column_stack([a + noise[0], v + noise[1]])
    return A, 3614.0 * a + 2891.0 * v + noise[2]


def hard_cases():
    """Logs of a few windows, by what is hard about them."""
    A, f = shift(3000)
    generator = np.random.default_rng(2)
    tiny = generator.normal(size=(3000, 2)) * 1e-9
    loud = np.where((np.arange(3000) // 500 % 2 == 0)[:, None], 1e6, 1e-6)
    mean = generator.normal(size=(3000, 2)) * 0.05 + [0.0, 3.0]
    sign = np.column_stack([A, np.where(np.arange(3000) // 170 % 2, 1.0, -1.0)])
    return {
        "motion and idling": (A, f),
        "tiny variance": (tiny, tiny @ [3614.0, 2891.0] + 1e-8 * generator.normal(size=3000)),
        "a million, then a millionth": (
            A * loud,
            (A * loud) @ [3614.0, 2891.0] + loud[:, 0] * generator.normal(size=3000),
        ),
        "small motion about a large speed": (
            mean,
            mean @ [3614.0, 2891.0] + 20.0 * generator.normal(size=3000),
        ),
        "with a sign column": (sign, f + 300.0 * sign[:, 2]),
    }


def windows_of(A, f, index):
    """A (rows, W, p) and f (rows, W) of the windows, without copying."""
    rows = np.lib.stride_tricks.sliding_window_view(A, W, axis=0)[index - W + 1]
    forces = np.lib.stride_tricks.sliding_window_view(f, W)[index - W + 1]
    return rows.transpose(0, 2, 1), forces


def by_qr(A, f, index):
    """Least squares of each window by LAPACK's QR, columns scaled to unit norm."""
    rows, forces = windows_of(A, f, index)
    scale = np.linalg.norm(rows, axis=1)
    Q, R = np.linalg.qr(rows / scale[:, None, :])
    side = np.einsum("nkp,nk->np", Q, forces)
    return np.linalg.solve(R, side[..., None])[..., 0] / scale


def exact_correlation(x, y):
    mean_x, mean_y = math.fsum(x) / x.size, math.fsum(y) / y.size
    u, v = x - mean_x, y - mean_y
    return math.fsum(u * v) / math.sqrt(math.fsum(u * u) * math.fsum(v * v))


@pytest.fixture(scope="module")
def twelve_hours():
    A, f = shift(TWELVE_HOURS)
    # windows that stand still altogether have no motion to tell θ from
    index = np.sort(np.random.default_rng(3).integers(W - 1, TWELVE_HOURS, PICKED))
    return A, f, np.unique(index)


def assert_digits(found, exact, digits=1e-9):
    """Each parameter to nine digits of itself or, where it is nearly zero, of the largest."""
    size = np.maximum(np.abs(exact), 1e-3 * np.abs(exact).max(axis=1, keepdims=True))
    assert np.max(np.abs(found - exact) / size) <= digits


#: What the gate accepts at most (settings.gate.condition_max).
ACCEPTED = 1000.0


@pytest.mark.heavy
def test_ols_over_twelve_hours_is_that_of_each_window_alone(twelve_hours):
    A, f, index = twelve_hours
    solved = ls.solve_windows(A, f, W, index)
    fine = np.flatnonzero(solved.condition <= ACCEPTED)
    assert fine.size > 0.97 * PICKED
    assert (solved.condition[fine] > 100.0).sum() > 50
    for part in np.array_split(fine, 20):
        assert_digits(solved.theta[part], by_qr(A, f, index[part]))


@pytest.mark.heavy
def test_the_correlation_over_twelve_hours_is_that_of_exact_sums(twelve_hours):
    A, f, index = twelve_hours
    rho, _ = compute_window_correlation(A[:, 0].copy(), f, W)
    for k in index[::25]:
        exact = exact_correlation(A[k - W + 1 : k + 1, 0], f[k - W + 1 : k + 1])
        assert rho[k] == pytest.approx(exact, rel=1e-9, abs=1e-12)


@pytest.mark.slow
def test_tls_over_twelve_hours_is_the_singular_direction_of_each_window(twelve_hours):
    A, f, index = twelve_hours
    some = index[::5]
    solved = tls.solve_windows(A, f, W, some, NOISE)
    units = np.array([*NOISE.noise_A, NOISE.noise_f])
    rows, forces = windows_of(A, f, some)
    stacked = np.concatenate([rows, forces[..., None]], axis=2) / units
    _, singular, directions = np.linalg.svd(stacked, full_matrices=False)
    exact = -directions[:, -1, :2] / directions[:, -1, 2:] * units[2] / units[:2]
    # at rest there is noise alone, which has no direction that is smaller than the others
    fine = singular[:, -1] < 0.5 * singular[:, -2]
    assert fine.sum() > 8_000
    assert_digits(solved.theta[fine], exact[fine])


@pytest.mark.parametrize("case", hard_cases())
def test_ols_and_the_correlation_keep_nine_digits_of(case):
    A, f = hard_cases()[case]
    index = np.arange(W - 1, f.size)
    solved = ls.solve_windows(A, f, W, index)
    fine = solved.condition <= ACCEPTED
    assert fine.mean() > 0.7
    assert_digits(solved.theta[fine], by_qr(A, f, index[fine]))
    rho, _ = compute_window_correlation(A[:, 0].copy(), f, W)
    for k in index[::50]:
        exact = exact_correlation(A[k - W + 1 : k + 1, 0], f[k - W + 1 : k + 1])
        assert rho[k] == pytest.approx(exact, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("forgetting", [0.998, 0.99, 1.0])
def test_rls_is_its_information_form_in_extended_precision(forgetting):
    A, f = shift(20_000)
    accepted = np.arange(f.size) >= W - 1
    traced = rls.estimate_along_log(A, f, W, accepted, rls.RlsOptions(forgetting))
    begin = rls.start(A[:W], f[:W])
    R = np.diag(1.0 / np.diag(begin.P)).astype(np.longdouble)
    h = R @ begin.theta
    for k in range(W, f.size):
        a = A[k].astype(np.longdouble)
        R, h = forgetting * R + np.outer(a, a), forgetting * h + a * f[k]
        if k % 50 == 0 and traced.condition[k - W + 1] <= ACCEPTED:
            determinant = R[0, 0] * R[1, 1] - R[0, 1] ** 2
            exact = np.array([R[1, 1] * h[0] - R[0, 1] * h[1], R[0, 0] * h[1] - R[0, 1] * h[0]])
            assert_digits(traced.theta[None, k - W + 1], (exact / determinant)[None].astype(float))


def test_fgls_is_finite_where_residuals_are_exactly_zero():
    a = np.arange(1000.0) % 7 - 3.0
    v = np.arange(1000.0) % 5
    A = np.column_stack([a, v])
    f = 2.0 * a + 3.0 * v
    f[500] += 64.0
    traced = fgls.estimate_along_log(A, f, W, np.arange(1000) >= W - 1)
    for array in (traced.theta, traced.std, traced.residual_rms, traced.condition):
        assert np.isfinite(array).all()
    np.testing.assert_allclose(traced.theta, [[2.0, 3.0]] * traced.index.size, rtol=1e-2)


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_however_many_threads_share_the_windows_the_bits_are_the_same(threads, monkeypatch):
    from estimators import threads as sharing

    A, f = shift(20_000)
    index = np.arange(W - 1, f.size)
    alone = fgls.solve_windows(A, f, W, index, fgls.FglsOptions())
    monkeypatch.setattr(sharing, "CHUNK", 700)
    monkeypatch.setattr(sharing, "_WORTH_THREADS", 1)
    monkeypatch.setattr(sharing.config, "NUMBA_NUM_THREADS", threads)
    shared = fgls.solve_windows(A, f, W, index, fgls.FglsOptions())
    for one, other in zip(alone, shared, strict=True):
        np.testing.assert_array_equal(one, other)
