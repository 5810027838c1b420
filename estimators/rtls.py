"""Recursive total least squares: TLS of the discounted past, a sample at a time.

The recursion keeps the discounted Gram matrix of the scaled [A f], C ← λC + z zᵀ, and takes its
smallest eigenvector afresh at each sample: p is 2 or 3, so that costs no more than tracking it
(Kubus, Kröger, Wahl 2008 update a singular value decomposition instead).
"""

from dataclasses import dataclass, field

import numpy as np

from estimators.autocorrelation import pooled_autocorrelation
from estimators.compiled import compiled
from estimators.linear import at, condition_numbers
from estimators.normal import residual_squares, store
from estimators.recursive import (
    CHUNK,
    discounted_meats,
    fed_samples,
    feed_products,
    packed,
)
from estimators.rolling import window_ends
from estimators.sandwich import meat, recursive_deviations
from estimators.tls import TlsOptions, roots, solve_scaled
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
    return RtlsState(_theta(C, scale), C, float(f.size))


def step(state: RtlsState, a: Floats, f: float, options: RtlsOptions | None = None) -> RtlsState:
    """Feed one sample: a (p,) the regressor's row, f the force."""
    options = options or RtlsOptions()
    scale = options.noise.scales(a.size)
    z = np.append(a / scale, f)
    C = options.forgetting * state.C + np.outer(z, z)
    return RtlsState(_theta(C, scale), C, options.forgetting * state.weight + 1.0)


def unscaled(state: RtlsState, options: RtlsOptions) -> Floats:
    """The discounted Gram matrix (p+1, p+1) of [A f] in its own units."""
    units = np.append(options.noise.scales(len(state.theta)), 1.0)
    return state.C * np.outer(units, units)


@compiled
def _theta(C: Floats, scale: Floats) -> Floats:
    """The estimate (p,) of one scaled Gram matrix, NaN where A without its noise is singular."""
    p = scale.size
    work = roots(p, 1)
    solve_scaled(packed(C).reshape(-1, 1), np.ones(p), 1, work)
    return work.normal.x[:, 0] / scale


@compiled
def _feed(
    A: Floats,
    f: Floats,
    fed: Ints,
    seen: Ints,
    scale: Floats,
    forgetting: float,
    past: Floats,
    weight: float,
    theta: Floats,
    rms: Floats,
    condition: Floats,
    grams: Floats,
) -> None:
    """θ, r.m.s., condition and the noise-free AᵀA (rows, entries) packed, at each row."""
    p = A.shape[1]
    z = np.empty((p + 1, CHUNK))
    terms, sums = np.zeros((past.size, CHUNK)), np.empty((past.size, CHUNK))
    at_rows, square = np.empty((past.size, CHUNK)), np.empty(CHUNK)
    work = roots(p, CHUNK)
    at_rows[:, 0] = past
    square[0] = weight
    m = 1
    row = begin = 0
    while True:
        solve_scaled(at_rows, scale, m, work)
        condition_numbers(at_rows, p + 1, p, m, condition[row : row + m])
        weights = square[:m].copy()
        residual_squares(at_rows, work.normal.x, m, square)
        for k in range(m):
            rms[row + k] = np.sqrt(square[k] / weights[k])
        store(work.normal.x, work.shifted, row, m, theta, grams)
        for i in range(p):
            for j in range(i, p):
                for k in range(m):
                    grams[row + k, at(i, j, p)] *= scale[i] * scale[j]
        row += m
        if begin == fed.size:
            break
        end = feed_products(A, f, fed, begin, forgetting, past, z, terms, sums)
        m = 0
        for i in range(begin, end):
            weight = forgetting * weight + 1.0
            if seen[row + m] == i + 1:
                for lane in range(past.size):
                    at_rows[lane, m] = sums[lane, i - begin]
                square[m] = weight
                m += 1
        begin = end


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
    rows, scale = index.size, options.noise.scales(p)
    theta, rms, condition = np.empty((rows, p)), np.empty(rows), np.empty(rows)
    entries = p * (p + 1) // 2
    bread, meats, white = (np.empty((rows, entries)) for _ in range(3))
    fed, seen = fed_samples(index, window)
    past = packed(unscaled(begin, options))
    decay = options.forgetting
    _feed(A, f, fed, seen, scale, decay, past, begin.weight, theta, rms, condition, bread)
    residual, owner = _residuals(A, f, theta, index, window)
    # the recursion's memory is long: its residuals carry no window's fit to correct for
    correlation, variance = pooled_autocorrelation(residual, owner, None)
    for M, r in ((meats, correlation), (white, np.ones(1))):
        one = np.zeros(window, np.int64)
        of_first = meat(A[first], one, 0, 0, window - 1, r)
        discounted_meats(A, A[first], fed, seen, int(index[0]), decay, decay**2, r, of_first, M)
    std = np.empty((rows, p))
    recursive_deviations(bread, meats, white, std)
    return Trace(index, theta, std * np.sqrt(variance), rms, condition, correlation)


@compiled
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
