"""Feasible generalised least squares (16), guarded: weights from the window's own residuals.

The printed σ_i = r_i is singular at r = 0 and confirms itself; here w = 1 / max(r², (κ·rms)²).
The weights follow the residuals that they weigh, so the estimate moves with OLS and a sandwich
with these weights would describe another estimator: its standard deviation is that of OLS at
this estimate's residuals (measured in docs/decisions/0005).
"""

from dataclasses import dataclass

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.estimate import Estimate, Trace
from estimators.methods import ls
from estimators.numerics.normal_equations import gram, residual_sums_of_squares, solve
from estimators.numerics.reweighted import reweighted_sums
from estimators.numerics.rolling import sum_windows, window_ends
from estimators.numerics.sandwich import window_std
from estimators.numerics.small_systems import lstsq
from estimators.threads import run_in_chunks


@dataclass(frozen=True, slots=True)
class FglsOptions:
    """κ: smallest residual that sets a weight, relative to the window's r.m.s."""

    floor: float = 0.05


def fit(
    A: Floats,
    f: Floats,
    options: FglsOptions | None = None,
    autocorrelation: Floats | None = None,
) -> Estimate:
    """Estimate one window by OLS, then by weights from its residuals.

    Args:
        A: (n, p) regressor, n > p.
        f: (n,) force.
        options: the guard.
        autocorrelation: (lags,) autocorrelation of the residuals; estimated from this window if not
            given.
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
    std = window_std(A, A.T @ A, residual, autocorrelation)
    return Estimate(theta, std, float(np.sqrt((residual**2).mean())), first.condition)


def solve_windows(
    A: Floats, f: Floats, window: int, index: Ints, options: FglsOptions
) -> ls.Windows:
    """Solve the windows that end at `index`."""
    out = ls.Windows.empty(index.size, A.shape[1])

    def solve_rows(rows: slice) -> None:
        products = sum_windows(A, f, window, index[rows])
        theta = reweight(A, f, window, index[rows], products, options)
        out.keep(rows, products, theta, gram(products), residual_sums_of_squares(products, theta))

    run_in_chunks(solve_rows, index.size)
    return out


def reweight(
    A: Floats, f: Floats, window: int, index: Ints, products: Floats, options: FglsOptions
) -> Floats:
    """θ (p, rows) of windows with packed products (entries, rows): OLS, then weighted."""
    first = solve(products)
    # fᵀf less what is explained knows no residual below its own rounding
    square = np.maximum(first.rss, np.finfo(np.float64).eps * products[-1])
    limit = options.floor * np.sqrt(square / window)
    return solve(reweighted_sums(A, f, window, index, first.theta, limit, True)).theta


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
    return ls.estimate_window_stds(A, f, window, index, solve_windows(A, f, window, index, options))
