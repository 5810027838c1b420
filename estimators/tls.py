"""Total least squares over sliding windows, on columns scaled by their noise.

On raw units TLS explodes where units differ; with every column of [A f] divided by its noise the
smallest singular direction of the stacked window is the estimate; where A without its noise is
singular (too little motion) there is none, and θ is NaN. From the Gram matrix: θ solves
(G - λI) θ = h with λ the smallest root of φ(λ) = fᵀf - λ - hᵀ(G - λI)⁻¹h.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from estimators.autocorrelation import pooled_autocorrelation
from estimators.linear import condition_number, solve_spd
from estimators.ls import window_residuals
from estimators.rolling import products, unpack, window_ends, window_sums
from estimators.sandwich import window_deviation, window_deviations
from estimators.trace import Bools, Estimate, Floats, Ints, Trace


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
    theta = np.where(np.isnan(std), np.nan, theta)
    rms = float(np.sqrt((residual**2).mean()))
    return Estimate(theta, std, rms, float(condition_number(A.T @ A)))


@njit(cache=True)
def smallest_root(G: Floats, h: Floats, ff: float) -> float:
    """The smallest root of φ, by Newton (Rayleigh quotients) inside a shrinking bracket.

    φ falls and is concave up to G's smallest eigenvalue, so a step may overshoot that, where
    G - λI is no longer positive definite: then the bracket is halved.
    """
    p = h.size
    low = 0.0
    high = np.inf
    lam = 0.0
    shifted = G.copy()
    for _ in range(100):
        for i in range(p):
            shifted[i, i] = G[i, i] - lam
        x = solve_spd(shifted, h)
        if np.isnan(x[0]):
            high = lam
            following = 0.5 * (low + high)
        else:
            value = ff - lam
            slope = 1.0
            for i in range(p):
                value -= h[i] * x[i]
                slope += x[i] * x[i]
            if value > 0.0:
                low = lam
            else:
                high = lam
            following = lam + value / slope
            if not low <= following <= high:
                following = 0.5 * (low + high)
        if abs(following - lam) <= 1e-15 * ff:
            return following
        lam = following
    return lam


@njit(cache=True)
def _solve_windows(
    A: Floats, f: Floats, window: int, index: Ints, scale: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """θ (rows, p), noise-free AᵀA (rows, p, p), RSS and condition (rows,)."""
    p = A.shape[1]
    sums = window_sums(products(A / scale, f), window)
    theta = np.empty((index.size, p))
    grams = np.empty((index.size, p, p))
    rss = np.empty(index.size)
    condition = np.empty(index.size)
    for row in range(index.size):
        G, h, ff = unpack(sums[index[row]], p)
        condition[row] = condition_number(G)
        lam = smallest_root(G, h, ff)
        clean = G.copy()
        for i in range(p):
            clean[i, i] -= lam
        x = solve_spd(clean, h)
        rss[row] = max(ff - 2.0 * (h @ x) + x @ (G @ x), 0.0)
        theta[row] = x / scale
        for i in range(p):
            for c in range(p):
                grams[row, i, c] = clean[i, c] * scale[i] * scale[c]
    return theta, grams, rss, condition


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
    theta, grams, rss, condition = _solve_windows(A, f, window, index, options.scales(p))
    correlation, _ = pooled_autocorrelation(*window_residuals(A, f, theta, index, window), A)
    std = window_deviations(A, grams, rss, index, window, correlation)
    theta = np.where(np.isnan(std), np.nan, theta)
    return Trace(index, theta, std, np.sqrt(rss / window), condition, correlation)
