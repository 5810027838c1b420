"""Feasible generalised least squares (16), guarded: weights from the window's own residuals.

The printed σ_i = r_i is singular at r = 0 and confirms itself; here w = 1 / max(r², (κ·rms)²).
The weights follow the residuals that they weigh, so the estimate moves with OLS and a sandwich
with these weights would describe another estimator: its standard deviation is that of OLS at
this estimate's residuals (measured in docs/decisions/0005).
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from estimators import ls
from estimators.autocorrelation import pooled_autocorrelation
from estimators.linear import lstsq, solve_spd
from estimators.rolling import window_ends
from estimators.sandwich import window_deviation, window_deviations
from estimators.trace import Bools, Estimate, Floats, Ints, Trace


@dataclass(frozen=True, slots=True)
class FglsOptions:
    """κ: the smallest |residual| that a weight believes, over the window's r.m.s."""

    floor: float = 0.05


def fit(
    A: Floats,
    f: Floats,
    options: FglsOptions | None = None,
    autocorrelation: Floats | None = None,
) -> Estimate:
    """Estimate one window: OLS, then once more with the guarded weights of its residuals.

    Args:
        A: (n, p) regressor, n > p.
        f: (n,) force.
        options: the guard.
        autocorrelation: (lags,) of the residuals; from this window alone where none is given.
    """
    options = options or FglsOptions()
    first = ls.fit(A, f, autocorrelation=autocorrelation)
    residual = f - A @ first.theta
    guard = (options.floor * first.residual_rms) ** 2
    if guard == 0.0:
        return first
    root = 1.0 / np.sqrt(np.maximum(residual**2, guard))
    theta = lstsq(A * root[:, None], f * root)
    residual = f - A @ theta
    std = window_deviation(A, A.T @ A, residual, autocorrelation)
    return Estimate(theta, std, float(np.sqrt((residual**2).mean())), first.condition)


@njit(cache=True)
def _reweigh(
    A: Floats, f: Floats, window: int, index: Ints, start: Floats, floor: float
) -> tuple[Floats, Floats]:
    """θ (rows, p) and RSS (rows,) of the weighted fits that follow the estimates in `start`."""
    p = A.shape[1]
    theta = start.copy()
    rss = np.zeros(index.size)
    for row in range(index.size):
        first = index[row] - window + 1
        square = 0.0
        for k in range(first, index[row] + 1):
            e = f[k]
            for c in range(p):
                e -= A[k, c] * start[row, c]
            square += e * e
        guard = floor * floor * square / window
        if guard == 0.0:
            continue
        G = np.zeros((p, p))
        h = np.zeros(p)
        for k in range(first, index[row] + 1):
            e = f[k]
            for c in range(p):
                e -= A[k, c] * start[row, c]
            w = 1.0 / max(e * e, guard)
            for i in range(p):
                h[i] += w * A[k, i] * f[k]
                for c in range(p):
                    G[i, c] += w * A[k, i] * A[k, c]
        theta[row] = solve_spd(G, h)
        for k in range(first, index[row] + 1):
            e = f[k]
            for c in range(p):
                e -= A[k, c] * theta[row, c]
            rss[row] += e * e
    return theta, rss


def trace(
    A: Floats, f: Floats, window: int, accepted: Bools, options: FglsOptions | None = None
) -> Trace:
    """Estimate every accepted window; row k equals `fit` of the `window` samples that end at k.

    Args:
        A: (n, p) regressor; rows outside accepted windows may be NaN.
        f: (n,) force.
        window: samples in a window.
        accepted: (n,) whether the window that ends here is used.
        options: the guard.
    """
    options = options or FglsOptions()
    index = window_ends(accepted, window)
    if index.size == 0:
        return Trace.empty(A.shape[1])
    first, grams, _, condition = ls.solve_windows(A, f, window, index)
    theta, rss = _reweigh(A, f, window, index, first, options.floor)
    correlation, _ = pooled_autocorrelation(*ls.window_residuals(A, f, theta, index, window), A)
    std = window_deviations(A, grams, rss, index, window, correlation)
    return Trace(index, theta, std, np.sqrt(rss / window), condition, correlation)
