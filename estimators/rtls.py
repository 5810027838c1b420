"""Recursive total least squares: TLS of the discounted past, a sample at a time.

The recursion keeps the discounted Gram matrix of the scaled [A f], C ← λC + z zᵀ, and takes its
smallest eigenvector afresh at each sample: p is 2 or 3, so that costs no more than tracking it
(Kubus, Kröger, Wahl 2008 update a singular value decomposition instead).
"""

from dataclasses import dataclass, field

import numpy as np
from numba import njit

from estimators.autocorrelation import pooled_autocorrelation
from estimators.linear import condition_number, inverse_spd, solve_spd
from estimators.rolling import window_ends
from estimators.tls import TlsOptions, smallest_root
from estimators.trace import Bools, Floats, Ints, Trace


@dataclass(frozen=True, slots=True)
class RtlsOptions:
    """The noise of each column (as for TLS) and λ, the forgetting of a sample."""

    noise: TlsOptions = field(default_factory=TlsOptions)
    forgetting: float = 0.998


@dataclass(frozen=True, slots=True)
class RtlsState:
    """All that the recursion keeps.

    Attributes:
        theta: (p,) estimate; NaN where the past does not determine it.
        C: (p+1, p+1) discounted Gram matrix of the scaled [A f].
        weight: discounted number of samples.
    """

    theta: Floats
    C: Floats
    weight: float


def start(A: Floats, f: Floats, options: RtlsOptions | None = None) -> RtlsState:
    """Begin from the TLS estimate of a first window: A (n, p), f (n,)."""
    options = options or RtlsOptions()
    p = A.shape[1]
    scale = options.noise.scales(p)
    z = np.column_stack([A / scale, f])
    C: Floats = z.T @ z
    return RtlsState(_theta(C) / scale, C, float(f.size))


def step(state: RtlsState, a: Floats, f: float, options: RtlsOptions | None = None) -> RtlsState:
    """Feed one sample: a (p,) the regressor's row, f the force."""
    options = options or RtlsOptions()
    scale = options.noise.scales(a.size)
    z = np.append(a / scale, f)
    C = options.forgetting * state.C + np.outer(z, z)
    return RtlsState(_theta(C) / scale, C, options.forgetting * state.weight + 1.0)


@njit(cache=True)
def _theta(C: Floats) -> Floats:
    """The scaled estimate of one Gram matrix, NaN where A without its noise is singular."""
    p = C.shape[0] - 1
    G = C[:p, :p].copy()
    h = C[:p, p].copy()
    lam = smallest_root(G, h, float(C[p, p]))
    for i in range(p):
        G[i, i] -= lam
    return solve_spd(G, h)


@njit(cache=True)
def _feed(
    A: Floats,
    f: Floats,
    window: int,
    index: Ints,
    scale: Floats,
    forgetting: float,
    C: Floats,
    weight: float,
) -> tuple[Floats, Floats, Floats, Floats]:
    """θ (rows, p), r.m.s., condition and the inverse clean Gram matrices over the union."""
    rows = index.size
    p = scale.size
    C = C.copy()
    theta = np.empty((rows, p))
    rms = np.empty(rows)
    condition = np.empty(rows)
    bread = np.empty((rows, p, p))
    z = np.empty(p + 1)
    for row in range(rows):
        first = max(index[row - 1] + 1, index[row] - window + 1) if row else index[0] + 1
        for k in range(first, index[row] + 1):
            for c in range(p):
                z[c] = A[k, c] / scale[c]
            z[p] = f[k]
            for i in range(p + 1):
                for c in range(p + 1):
                    C[i, c] = forgetting * C[i, c] + z[i] * z[c]
            weight = forgetting * weight + 1.0
        G = C[:p, :p].copy()
        h = C[:p, p].copy()
        condition[row] = condition_number(G)
        x = _theta(C)
        square = C[p, p]
        for i in range(p):
            square -= 2.0 * h[i] * x[i]
            for c in range(p):
                square += x[i] * G[i, c] * x[c]
        rms[row] = np.sqrt(max(square, 0.0) / weight)
        lam = smallest_root(G, h, C[p, p])
        for i in range(p):
            theta[row, i] = x[i] / scale[i]
            G[i, i] -= lam
        inverse = inverse_spd(G)
        for i in range(p):
            for c in range(p):
                bread[row, i, c] = inverse[i, c] / (scale[i] * scale[c])
    return theta, rms, condition, bread


@njit(cache=True)
def _deviations(
    A: Floats, window: int, index: Ints, forgetting: float, bread: Floats, correlation: Floats
) -> Floats:
    """Root of diag G⁻¹ B G⁻¹ for residuals of variance 1; B is the discounted Aᵀ R A so far."""
    rows = index.size
    n, p = A.shape
    fed = np.zeros(n, np.bool_)
    B = np.zeros((p, p))
    white = np.zeros((p, p))
    std = np.empty((rows, p))
    tail = np.empty(p)
    for row in range(rows):
        first = index[row] - window + 1
        if row:
            first = max(first, index[row - 1] + 1)
        for k in range(first, index[row] + 1):
            tail[:] = 0.5 * A[k]
            discount = 1.0
            for j in range(1, min(correlation.size, k + 1)):
                discount *= forgetting
                if fed[k - j]:
                    for c in range(p):
                        tail[c] += correlation[j] * discount * A[k - j, c]
            fed[k] = True
            # the first window enters undiscounted, as `start` takes it
            decay = forgetting * forgetting if row else 1.0
            for i in range(p):
                for c in range(p):
                    B[i, c] = decay * B[i, c] + A[k, i] * tail[c] + tail[i] * A[k, c]
                    white[i, c] = decay * white[i, c] + A[k, i] * A[k, c]
        cover = bread[row] @ B @ bread[row]
        floor = bread[row] @ white @ bread[row]
        for i in range(p):
            # a tapered correlation need not be positive definite
            std[row, i] = np.sqrt(max(cover[i, i], floor[i, i]))
    return std


def trace(
    A: Floats, f: Floats, window: int, accepted: Bools, options: RtlsOptions | None = None
) -> Trace:
    """Run the recursion over the union of the accepted windows; equals repeated `step`.

    Args:
        A: (n, p) regressor; rows outside accepted windows may be NaN.
        f: (n,) force.
        window: samples in a window.
        accepted: (n,) whether the window that ends here is used.
        options: noise and forgetting.

    Returns:
        A row an accepted window, the state after its last sample; the first is TLS of the first
        window.
    """
    options = options or RtlsOptions()
    index = window_ends(accepted, window)
    p = A.shape[1]
    if index.size == 0:
        return Trace.empty(p)
    first = slice(index[0] - window + 1, index[0] + 1)
    begin = start(A[first], f[first], options)
    theta, rms, condition, bread = _feed(
        A, f, window, index, options.noise.scales(p), options.forgetting, begin.C, begin.weight
    )
    residual, fed = _residuals(A, f, theta, index, window)
    # the recursion's memory is long: its residuals carry no window's fit to correct for
    correlation, variance = pooled_autocorrelation(residual, fed, None)
    std = _deviations(A, window, index, options.forgetting, bread, correlation)
    std = std * np.sqrt(variance)
    theta = np.where(np.isnan(std), np.nan, theta)
    return Trace(index, theta, std, rms, condition, correlation)


@njit(cache=True)
def _residuals(
    A: Floats, f: Floats, theta: Floats, index: Ints, window: int
) -> tuple[Floats, Ints]:
    """Each fed sample's residual under the state that it led to, and 0; -1 where there is none."""
    residual = np.zeros(f.size)
    fed = np.full(f.size, -1, np.int64)
    done = -1
    for row in range(index.size):
        for k in range(max(done + 1, index[row] - window + 1), index[row] + 1):
            if np.isfinite(theta[row, 0]):
                residual[k] = f[k]
                for c in range(A.shape[1]):
                    residual[k] -= A[k, c] * theta[row, c]
                fed[k] = 0
        done = index[row]
    return residual, fed
