"""Huber's robust regression over sliding windows: outliers pull with a bounded force.

Iteratively reweighted least squares, w = min(1, c / |r/s|), s = median|r| / 0.6745 of the first
OLS residuals (Huber 1964; Huber and Ronchetti 2009, 7.8). To first order the estimate is OLS of the
pseudo-residuals ψ(r) / mean ψ', so their sandwich is its standard deviation.
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

#: Iterations converge linearly; more than this many change nothing that matters.
_MOST_STEPS = 50
_SETTLED = 1e-10


@dataclass(frozen=True, slots=True)
class HuberOptions:
    """c: residuals up to c·s weigh fully; 1.345 keeps 95 % efficiency for Gaussian noise."""

    bend: float = 1.345


def fit(
    A: Floats,
    f: Floats,
    options: HuberOptions | None = None,
    autocorrelation: Floats | None = None,
) -> Estimate:
    """Estimate one window.

    Args:
        A: (n, p) regressor, n > p.
        f: (n,) force.
        options: where the weights begin to fall.
        autocorrelation: (lags,) of the pseudo-residuals; from this window alone if not given.
    """
    options = options or HuberOptions()
    first = ls.fit(A, f, autocorrelation=autocorrelation)
    theta = first.theta
    limit = options.bend * float(np.median(np.abs(f - A @ theta))) / 0.6745
    if limit == 0.0:
        return first
    for _ in range(_MOST_STEPS):
        residual = f - A @ theta
        root = np.sqrt(np.minimum(1.0, limit / np.maximum(np.abs(residual), limit)))
        following = lstsq(A * root[:, None], f * root)
        moved = np.abs(following - theta).max() / max(np.abs(following).max(), 1e-300)
        theta = following
        if moved < _SETTLED:
            break
    residual = f - A @ theta
    pseudo = np.clip(residual, -limit, limit) / (np.abs(residual) <= limit).mean()
    std = window_deviation(A, A.T @ A, pseudo, autocorrelation)
    return Estimate(theta, std, float(np.sqrt((residual**2).mean())), first.condition)


@njit(cache=True)
def _solve(
    A: Floats, f: Floats, window: int, index: Ints, start: Floats, bend: float
) -> tuple[Floats, Floats, Floats]:
    """θ (rows, p), the clipping limit and the r.m.s. of the residuals (rows,)."""
    rows, p = start.shape
    theta = start.copy()
    limit = np.zeros(rows)
    rms = np.zeros(rows)
    residual = np.empty(window)
    for row in range(rows):
        first = index[row] - window + 1
        for i in range(window):
            residual[i] = f[first + i]
            for c in range(p):
                residual[i] -= A[first + i, c] * theta[row, c]
        limit[row] = bend * np.median(np.abs(residual)) / 0.6745
        for _ in range(_MOST_STEPS):
            if limit[row] == 0.0:
                break
            G = np.zeros((p, p))
            h = np.zeros(p)
            for i in range(window):
                w = limit[row] / max(abs(residual[i]), limit[row])
                for c in range(p):
                    h[c] += w * A[first + i, c] * f[first + i]
                    for d in range(p):
                        G[c, d] += w * A[first + i, c] * A[first + i, d]
            following = solve_spd(G, h)
            moved = 0.0
            size = 1e-300
            for c in range(p):
                moved = max(moved, abs(following[c] - theta[row, c]))
                size = max(size, abs(following[c]))
                theta[row, c] = following[c]
            for i in range(window):
                residual[i] = f[first + i]
                for c in range(p):
                    residual[i] -= A[first + i, c] * theta[row, c]
            if not moved / size >= _SETTLED:
                break
        square = 0.0
        for i in range(window):
            square += residual[i] * residual[i]
        rms[row] = np.sqrt(square / window)
    return theta, limit, rms


@njit(cache=True)
def _pseudo_squares(
    A: Floats, f: Floats, window: int, index: Ints, theta: Floats, limit: Floats
) -> tuple[Floats, Floats]:
    """Σ of squared pseudo-residuals, and mean ψ' of each window, (rows,) both."""
    rows, p = theta.shape
    squares = np.zeros(rows)
    kept = np.ones(rows)
    for row in range(rows):
        if limit[row] == 0.0:
            continue
        inside = 0
        for k in range(index[row] - window + 1, index[row] + 1):
            e = f[k]
            for c in range(p):
                e -= A[k, c] * theta[row, c]
            if abs(e) <= limit[row]:
                inside += 1
            clipped = max(-limit[row], min(limit[row], e))
            squares[row] += clipped * clipped
        kept[row] = inside / window
        squares[row] /= kept[row] * kept[row]
    return squares, kept


def trace(
    A: Floats, f: Floats, window: int, accepted: Bools, options: HuberOptions | None = None
) -> Trace:
    """Estimate every accepted window; row k equals `fit` of the `window` samples that end at k.

    Args:
        A: (n, p) regressor; rows outside accepted windows may be NaN.
        f: (n,) force.
        window: samples in a window.
        accepted: (n,) whether the window that ends here is used.
        options: where the weights begin to fall.
    """
    options = options or HuberOptions()
    index = window_ends(accepted, window)
    p = A.shape[1]
    if index.size == 0:
        return Trace.empty(p)
    first, grams, _, condition = ls.solve_windows(A, f, window, index)
    theta, limit, rms = _solve(A, f, window, index, first, options.bend)
    squares, kept = _pseudo_squares(A, f, window, index, theta, limit)
    residual, owner = ls.window_residuals(A, f, theta, index, window)
    used = owner >= 0
    solved = np.flatnonzero(np.isfinite(theta[:, 0]))
    row = solved[owner[used]]
    residual[used] = np.clip(residual[used], -limit[row], limit[row]) / kept[row]
    correlation, _ = pooled_autocorrelation(residual, owner, A)
    std = window_deviations(A, grams, squares, index, window, correlation)
    return Trace(index, theta, std, rms, condition, correlation)
