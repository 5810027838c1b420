"""Feasible generalised least squares (16), guarded: weights from the window's own residuals.

The printed σ_i = r_i is singular at r = 0 and confirms itself; here w = 1 / max(r², (κ·rms)²).
The weights follow the residuals that they weigh, so the estimate moves with OLS and a sandwich
with these weights would describe another estimator: its standard deviation is that of OLS at
this estimate's residuals (measured in docs/decisions/0005).
"""

from dataclasses import dataclass

import numpy as np

from estimators import ls
from estimators.autocorrelation import pooled_autocorrelation, window_residuals
from estimators.compiled import compiled
from estimators.linear import at, condition_numbers, lstsq
from estimators.normal import Normal, normal_equations, residual_squares, solve_products, store
from estimators.reweighted import Reweighting, reweigh, reweighting
from estimators.rolling import sum_windows, window_ends, workspace
from estimators.sandwich import window_deviation, window_deviations
from estimators.trace import Bools, Estimate, Floats, Ints, Trace

_ROUNDING = float(np.finfo(np.float64).eps)


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


@compiled
def _solve_windows(
    A: Floats,
    f: Floats,
    window: int,
    index: Ints,
    floor: float,
    theta: Floats,
    grams: Floats,
    rss: Floats,
    condition: Floats,
) -> None:
    """θ (rows, p), AᵀA (rows, entries) packed, RSS and condition (rows,)."""
    p = A.shape[1]
    work = workspace(p + 1, window)
    normal = normal_equations(p, window)
    weighted = reweighting(p, window)
    limit = np.empty(window)
    row = 0
    while row < index.size:
        end = sum_windows(A, f, window, index, row, work)
        m = end - row
        condition_numbers(work.products, p + 1, p, m, condition[row:end])
        solve_products(work.products, m, normal)
        weigh(work.z, work.products, window, index, row, end, floor, normal, limit, weighted)
        residual_squares(work.products, weighted.normal.x, m, rss[row:end])
        store(weighted.normal.x, work.products, row, m, theta, grams)
        row = end


@compiled
def weigh(
    z: Floats,
    products: Floats,
    window: int,
    index: Ints,
    row: int,
    end: int,
    floor: float,
    normal: Normal,
    limit: Floats,
    out: Reweighting,
) -> None:
    """Solve windows row … end - 1 once more, with the guarded weights of their OLS residuals."""
    p = normal.x.shape[0]
    ff = products[at(p, p, p + 1)]
    for k in range(end - row):
        # fᵀf less what is explained knows no residual below its own rounding
        square = max(normal.rss[k], _ROUNDING * ff[k])
        limit[k] = floor * np.sqrt(square / window)
    reweigh(z, window, index, row, end, limit, True, normal.x, out)


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
    rows, p = index.size, A.shape[1]
    theta, grams = np.empty((rows, p)), np.empty((rows, p * (p + 1) // 2))
    rss, condition = np.empty(rows), np.empty(rows)
    _solve_windows(A, f, window, index, options.floor, theta, grams, rss, condition)
    correlation, _ = pooled_autocorrelation(*window_residuals(A, f, theta, index, window), A)
    std = window_deviations(A, grams, rss, index, window, correlation)
    return Trace(index, theta, std, np.sqrt(rss / window), condition, correlation)
