"""Ordinary least squares (6) over sliding windows: θ = (AᵀA)⁻¹ Aᵀf, a window stacked."""

from dataclasses import dataclass

import numpy as np

from estimators.autocorrelation import pooled_autocorrelation, window_residuals
from estimators.compiled import compiled
from estimators.linear import condition_number, condition_numbers, lstsq, substitute
from estimators.normal import Normal, normal_equations, solve_products, store
from estimators.rolling import sum_windows, window_ends, workspace
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


def solve_windows(
    A: Floats, f: Floats, window: int, index: Ints
) -> tuple[Floats, Floats, Floats, Floats]:
    """Solve the windows that end at `index`.

    Returns:
        θ (rows, p), AᵀA (rows, p(p+1)/2) packed, RSS (rows,) and condition (rows,).
    """
    rows, p = index.size, A.shape[1]
    theta, grams = np.empty((rows, p)), np.empty((rows, p * (p + 1) // 2))
    rss, condition = np.empty(rows), np.empty(rows)
    _solve(A, f, window, index, theta, grams, rss, condition)
    return theta, grams, rss, condition


@compiled
def _solve(
    A: Floats,
    f: Floats,
    window: int,
    index: Ints,
    theta: Floats,
    grams: Floats,
    rss: Floats,
    condition: Floats,
) -> None:
    p = A.shape[1]
    work = workspace(p + 1, window)
    normal = normal_equations(p, window)
    row = 0
    while row < index.size:
        end = sum_windows(A, f, window, index, row, work)
        solve_products(work.products, end - row, normal)
        store(normal.x, work.products, row, end - row, theta, grams)
        for k in range(end - row):
            rss[row + k] = normal.rss[k]
        condition_numbers(work.products, p + 1, p, end - row, condition[row:end])
        row = end


@compiled
def _promise(
    A: Floats, f: Floats, window: int, index: Ints, predicted: Floats, condition: Floats
) -> None:
    p = A.shape[1]
    work = workspace(p + 1, window)
    normal = normal_equations(p, window)
    row = 0
    while row < index.size:
        end = sum_windows(A, f, window, index, row, work)
        predict(work.products, window, end - row, normal, predicted[row:end])
        condition_numbers(work.products, p + 1, p, end - row, condition[row:end])
        row = end


@compiled
def predict(products: Floats, window: int, m: int, normal: Normal, predicted: Floats) -> None:
    """The predicted deviation of the first parameter (m,) from m windows' packed products."""
    p = normal.x.shape[0]
    solve_products(products, m, normal)
    freedom = max(window - p, 1)
    for k in range(m):
        predicted[k] = normal.rss[k] / freedom
    # (G⁻¹)₁₁ is the first entry of the solution for the first unit vector
    normal.x[:, :m] = 0.0
    normal.x[0, :m] = 1.0
    substitute(normal.L, normal.inverse, m, normal.x)
    first = normal.x[0]
    for k in range(m):
        predicted[k] = np.sqrt(predicted[k] * first[k])


def predicted_deviation(A: Floats, f: Floats, window: int, index: Ints) -> tuple[Floats, Floats]:
    """What a window promises before it is used: sqrt(σ̂² (G⁻¹)₁₁) of the first parameter.

    Textbook variance, so a measure to rank windows by, not the deviation that is reported.

    Returns:
        (rows,) predicted deviation and (rows,) condition number of the windows that end at index.
    """
    predicted, condition = np.empty(index.size), np.empty(index.size)
    _promise(A, f, window, index, predicted, condition)
    return predicted, condition


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
