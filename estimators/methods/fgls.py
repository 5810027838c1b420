"""Feasible generalised least squares (16) with bounded weights from the window's own residuals.

The printed σ_i = r_i is singular at r = 0 and self-confirming; here w = 1 / max(r², (κ·rms)²).
Since the weights depend on the residuals that they weight, the estimate follows OLS, and a sandwich
with these weights would describe another estimator: the standard deviation is that of OLS with the
residuals of this estimate (measured in docs/decisions/0005).
"""

from dataclasses import dataclass

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.estimate import Estimate, Trace
from estimators.methods import ls
from estimators.numerics.normal_equations import (
    compute_residual_sums_of_squares,
    extract_packed_gram,
    solve_packed_equations,
)
from estimators.numerics.reweighted import sum_reweighted_products
from estimators.numerics.rolling import find_ends_of_accepted_windows, sum_window_products
from estimators.numerics.sandwich import compute_one_window_stds
from estimators.numerics.small_systems import solve_least_squares_by_svd
from estimators.threads import run_in_chunks


@dataclass(frozen=True, slots=True)
class FglsOptions:
    """κ: smallest residual that sets a weight, relative to the window's r.m.s."""

    floor: float = 0.05


def fit(
    A: Floats, f: Floats, options: FglsOptions | None = None, autocorrelation: Floats | None = None
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
    theta = solve_least_squares_by_svd(A * root[:, None], f * root)
    residual = f - A @ theta
    std = compute_one_window_stds(A, A.T @ A, residual, autocorrelation)
    return Estimate(theta, std, float(np.sqrt((residual**2).mean())), first.condition)


def solve_windows(
    A: Floats, f: Floats, window: int, window_ends: Ints, options: FglsOptions
) -> ls.Windows:
    """Solve the windows that end at `window_ends`."""
    out = ls.Windows.allocate_rows(window_ends.size, A.shape[1])

    def solve_rows(rows: slice) -> None:
        products = sum_window_products(A, f, window, window_ends[rows])
        theta = solve_windows_by_reweighting(A, f, window, window_ends[rows], products, options)
        out.store_windows(
            rows,
            products,
            theta,
            extract_packed_gram(products),
            compute_residual_sums_of_squares(products, theta),
        )

    run_in_chunks(solve_rows, window_ends.size)
    return out


def solve_windows_by_reweighting(
    A: Floats, f: Floats, window: int, window_ends: Ints, products: Floats, options: FglsOptions
) -> Floats:
    """θ (p, rows) of windows with packed products (entries, rows): OLS, then weighted."""
    first = solve_packed_equations(products)
    # fᵀf minus its explained part resolves no residual below rounding
    square = np.maximum(first.rss, np.finfo(np.float64).eps * products[-1])
    limit = options.floor * np.sqrt(square / window)
    return solve_packed_equations(
        sum_reweighted_products(A, f, window, window_ends, first.theta, limit, True)
    ).theta


def estimate_along_log(
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
    index = find_ends_of_accepted_windows(accepted, window)
    if index.size == 0:
        return Trace.empty(A.shape[1])
    return ls.estimate_window_stds(A, f, window, index, solve_windows(A, f, window, index, options))
