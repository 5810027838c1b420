"""Total least squares over sliding windows, on columns scaled by their noise.

On raw units TLS explodes where units differ; with every column of [A f] divided by its noise the
smallest singular direction of the stacked window is the estimate; where A without its noise is
singular (too little motion) there is none, and θ is NaN. From the Gram matrix: θ solves
(G - λI) θ = h with λ the smallest root of φ(λ) = fᵀf - λ - hᵀ(G - λI)⁻¹h.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from estimators.autocorrelation import pooled_autocorrelation, window_residuals
from estimators.compiled import compiled
from estimators.linear import (
    at,
    condition_number,
    condition_numbers,
    factor,
    solve_spd,
    substitute,
)
from estimators.normal import Normal, normal_equations, residual_squares
from estimators.rolling import sum_windows, window_ends, workspace
from estimators.sandwich import window_deviation, window_deviations
from estimators.trace import Bools, Estimate, Floats, Ints, Trace

#: Newton settles in about five; halving a bracket to working precision takes fifty.
_MOST_STEPS = 100


@dataclass(frozen=True, slots=True)
class TlsOptions:
    """Noise of the columns of A in their order, and of f; only their ratios matter.

    The third column is Coulomb's sign, which is nearly exact.
    """

    noise_A: tuple[float, ...] = (0.01, 0.005, 0.001)
    noise_f: float = 60.0

    def scales(self, parameters: int) -> Floats:
        """(p,) noise of the columns of A over that of f."""
        return np.array(self.noise_A[:parameters]) / self.noise_f


def fit(
    A: Floats,
    f: Floats,
    options: TlsOptions | None = None,
    autocorrelation: Floats | None = None,
) -> Estimate:
    """Estimate one window by the singular value decomposition of the scaled [A f].

    Args:
        A: (n, p) regressor, n > p.
        f: (n,) force.
        options: the noise of each column.
        autocorrelation: (lags,) of the residuals; from this window alone where none is given.
    """
    options = options or TlsOptions()
    p = A.shape[1]
    scale = options.scales(p)
    scaled = A / scale
    _, s, Vt = np.linalg.svd(np.column_stack([scaled, f]), full_matrices=False)
    theta = -Vt[-1, :p] / Vt[-1, p] / scale
    residual = f - A @ theta
    gram = (scaled.T @ scaled - s[-1] ** 2 * np.eye(p)) * np.outer(scale, scale)
    std = window_deviation(A, gram, residual, autocorrelation)
    theta = np.where(np.isnan(solve_spd(gram, gram[0])), np.nan, theta)
    rms = float(np.sqrt((residual**2).mean()))
    return Estimate(theta, std, rms, float(condition_number(A.T @ A)))


class Roots(NamedTuple):
    """Room to solve windows of p parameters in.

    Attributes:
        C: (entries, windows) packed Gram matrices of the scaled [A f].
        shifted: (entries, windows) the same less λ on A's diagonal: free of noise.
        lam: (windows,) smallest roots λ.
        low, high: (windows,) brackets around them.
        done: (windows,) whether they have settled.
        normal: θ solves the shifted normal equations.
    """

    C: Floats
    shifted: Floats
    lam: Floats
    low: Floats
    high: Floats
    done: Bools
    normal: Normal


@compiled
def roots(p: int, windows: int) -> Roots:
    """Room for that many windows."""
    entries = (p + 1) * (p + 2) // 2
    return Roots(
        np.empty((entries, windows)),
        np.empty((entries, windows)),
        np.empty(windows),
        np.empty(windows),
        np.empty(windows),
        np.empty(windows, np.bool_),
        normal_equations(p, windows),
    )


@compiled
def solve_scaled(products: Floats, scale: Floats, m: int, work: Roots) -> None:
    """Total least squares of m windows from their packed products: θ into work.normal.x.

    The smallest root of φ comes by Newton (Rayleigh quotients) inside a shrinking bracket: φ falls
    and is concave up to the smallest eigenvalue of G, so a step may overshoot that, where G - λI is
    no longer positive definite: then the bracket is halved.
    """
    p = scale.size
    for i in range(p + 1):
        for j in range(i, p + 1):
            entry, scaled = products[at(i, j, p + 1)], work.C[at(i, j, p + 1)]
            unit = (scale[i] if i < p else 1.0) * (scale[j] if j < p else 1.0)
            for k in range(m):
                scaled[k] = entry[k] / unit
    for entry in range(work.C.shape[0]):
        work.shifted[entry, :m] = work.C[entry, :m]
    lam, low, high, done, x = work.lam, work.low, work.high, work.done, work.normal.x
    slope = work.normal.rss
    ff = work.C[at(p, p, p + 1)]
    lam[:m] = 0.0
    low[:m] = 0.0
    high[:m] = np.inf
    done[:m] = False
    for _ in range(_MOST_STEPS):
        _solve_shifted(m, work)
        value = work.shifted[at(p, p, p + 1)]
        for k in range(m):
            value[k] = ff[k] - lam[k]
            slope[k] = 1.0
        for i in range(p):
            h, solution = work.C[at(i, p, p + 1)], x[i]
            for k in range(m):
                value[k] -= h[k] * solution[k]
                slope[k] += solution[k] * solution[k]
        unsettled = 0
        for k in range(m):
            beyond = np.isnan(value[k])
            above = value[k] > 0.0
            down = lam[k] if above else low[k]
            up = high[k] if above else lam[k]
            following = lam[k] + value[k] / slope[k]
            inside = following >= down and following <= up
            following = 0.5 * (down + up) if beyond or not inside else following
            settled = done[k] or abs(following - lam[k]) <= 1e-15 * ff[k] or np.isnan(following)
            low[k] = down
            high[k] = up
            lam[k] = lam[k] if done[k] else following
            done[k] = settled
            unsettled += 0 if settled else 1
        if unsettled == 0:
            break
    _solve_shifted(m, work)
    for i in range(p):
        solution = x[i]
        for k in range(m):
            solution[k] /= scale[i]


@compiled
def _solve_shifted(m: int, work: Roots) -> None:
    """Solve (G - λI) x = h with the roots so far."""
    p = work.normal.x.shape[0]
    for i in range(p):
        diagonal, shifted = work.C[at(i, i, p + 1)], work.shifted[at(i, i, p + 1)]
        for k in range(m):
            shifted[k] = diagonal[k] - work.lam[k]
    factor(work.shifted, p + 1, p, m, work.normal.L, work.normal.inverse)
    for i in range(p):
        x, h = work.normal.x[i], work.shifted[at(i, p, p + 1)]
        for k in range(m):
            x[k] = h[k]
    substitute(work.normal.L, work.normal.inverse, m, work.normal.x)


@compiled
def _solve_windows(
    A: Floats,
    f: Floats,
    window: int,
    index: Ints,
    scale: Floats,
    theta: Floats,
    grams: Floats,
    rss: Floats,
    condition: Floats,
) -> None:
    """θ (rows, p), noise-free AᵀA (rows, entries) packed, RSS and condition (rows,)."""
    p = A.shape[1]
    work = workspace(p + 1, window)
    solved = roots(p, window)
    row = 0
    while row < index.size:
        end = sum_windows(A, f, window, index, row, work)
        m = end - row
        condition_numbers(work.products, p + 1, p, m, condition[row:end])
        solve_scaled(work.products, scale, m, solved)
        residual_squares(work.products, solved.normal.x, m, rss[row:end])
        for i in range(p):
            x = solved.normal.x[i]
            for k in range(m):
                theta[row + k, i] = x[k]
            for j in range(i, p):
                clean, unit = solved.shifted[at(i, j, p + 1)], scale[i] * scale[j]
                for k in range(m):
                    grams[row + k, at(i, j, p)] = clean[k] * unit
        row = end


def trace(
    A: Floats, f: Floats, window: int, accepted: Bools, options: TlsOptions | None = None
) -> Trace:
    """Estimate every accepted window; row k equals `fit` of the `window` samples that end at k.

    Args:
        A: (n, p) regressor; rows outside accepted windows may be NaN.
        f: (n,) force.
        window: samples in a window.
        accepted: (n,) whether the window that ends here is used.
        options: the noise of each column.
    """
    options = options or TlsOptions()
    index = window_ends(accepted, window)
    p = A.shape[1]
    if index.size == 0:
        return Trace.empty(p)
    rows = index.size
    theta, grams = np.empty((rows, p)), np.empty((rows, p * (p + 1) // 2))
    rss, condition = np.empty(rows), np.empty(rows)
    _solve_windows(A, f, window, index, options.scales(p), theta, grams, rss, condition)
    correlation, _ = pooled_autocorrelation(*window_residuals(A, f, theta, index, window), A)
    std = window_deviations(A, grams, rss, index, window, correlation)
    return Trace(index, theta, std, np.sqrt(rss / window), condition, correlation)
