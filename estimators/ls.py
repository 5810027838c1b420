"""Ordinary least squares (6) over sliding windows: θ = (AᵀA)⁻¹ Aᵀf, a window stacked."""

from dataclasses import dataclass

import numpy as np
from numba import njit

from estimators.autocorrelation import disjoint_windows, pooled_autocorrelation
from estimators.linear import condition_number, inverse_spd, lstsq, solve_spd
from estimators.rolling import products, unpack, window_ends, window_sums
from estimators.sandwich import window_deviation, window_deviations
from estimators.trace import Bools, Estimate, Floats, Ints, Trace


@dataclass(frozen=True, slots=True)
class LsOptions:
    """Ordinary least squares has nothing to choose."""


def fit(
    A: Floats,
    f: Floats,
    options: LsOptions | None = None,
    autocorrelation: Floats | None = None,
) -> Estimate:
    """Estimate one window, in the readable form of (6).

    Args:
        A: (n, p) regressor, n > p.
        f: (n,) force.
        options: none to choose.
        autocorrelation: (lags,) of the residuals; from this window alone where none is given.

    Returns:
        θ with the sandwich standard deviation.
    """
    del options
    theta = lstsq(A, f)
    residual = f - A @ theta
    gram = A.T @ A
    std = window_deviation(A, gram, residual, autocorrelation)
    rms = float(np.sqrt((residual**2).mean()))
    return Estimate(theta, std, rms, float(condition_number(gram)))


@njit(cache=True)
def solve_windows(
    A: Floats, f: Floats, window: int, index: Ints
) -> tuple[Floats, Floats, Floats, Floats]:
    """θ (rows, p), AᵀA (rows, p, p), RSS and condition (rows,) of the windows that end at index."""
    p = A.shape[1]
    rows = index.size
    sums = window_sums(products(A, f), window)
    theta = np.empty((rows, p))
    grams = np.empty((rows, p, p))
    rss = np.empty(rows)
    condition = np.empty(rows)
    for row in range(rows):
        G, h, ff = unpack(sums[index[row]], p)
        theta[row] = solve_spd(G, h)
        grams[row] = G
        rss[row] = max(ff - h @ theta[row], 0.0)
        condition[row] = condition_number(G)
    return theta, grams, rss, condition


@njit(cache=True)
def predicted_deviation(A: Floats, f: Floats, window: int, index: Ints) -> tuple[Floats, Floats]:
    """What a window promises before it is used: sqrt(σ̂² (G⁻¹)₁₁) of the first parameter.

    Textbook variance, so a measure to rank windows by, not the deviation that is reported.

    Returns:
        (rows,) predicted deviation and (rows,) condition number of the windows that end at index.
    """
    _, grams, rss, condition = solve_windows(A, f, window, index)
    predicted = np.empty(index.size)
    freedom = max(window - A.shape[1], 1)
    for row in range(index.size):
        predicted[row] = np.sqrt(rss[row] / freedom * inverse_spd(grams[row])[0, 0])
    return predicted, condition


def window_residuals(
    A: Floats, f: Floats, theta: Floats, index: Ints, window: int
) -> tuple[Floats, Ints]:
    """Residuals over disjoint solved windows: (n,) residual and (n,) its window, -1 for none."""
    solved = np.isfinite(theta[:, 0])
    index, theta = index[solved], theta[solved]
    owner = disjoint_windows(index, f.size, window)
    residual = np.zeros(f.size)
    used = owner >= 0
    residual[used] = f[used] - np.einsum("ij,ij->i", A[used], theta[owner[used]])
    return residual, owner


def trace(
    A: Floats, f: Floats, window: int, accepted: Bools, options: LsOptions | None = None
) -> Trace:
    """Estimate every accepted window; row k equals `fit` of the `window` samples that end at k.

    Args:
        A: (n, p) regressor; rows outside accepted windows may be NaN.
        f: (n,) force.
        window: samples in a window.
        accepted: (n,) whether the window that ends here is used.
        options: none to choose.
    """
    del options
    index = window_ends(accepted, window)
    if index.size == 0:
        return Trace.empty(A.shape[1])
    theta, grams, rss, condition = solve_windows(A, f, window, index)
    correlation, _ = pooled_autocorrelation(*window_residuals(A, f, theta, index, window), A)
    std = window_deviations(A, grams, rss, index, window, correlation)
    return Trace(index, theta, std, np.sqrt(rss / window), condition, correlation)
