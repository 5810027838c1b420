"""Least squares pooled over all accepted samples of a manoeuvre: one estimate a segment.

Where windows slide over one start again and again, this uses every sample once.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from estimators.attenuation import DOUBT, attenuations
from estimators.autocorrelation import pooled_autocorrelation
from estimators.linear import condition_number, solve_spd
from estimators.sandwich import deviations, meat
from estimators.trace import Floats, Ints, Trace


@dataclass(frozen=True, slots=True)
class PooledOptions:
    """What is known of the regressor's own noise.

    Attributes:
        noise_A: r.m.s. noise of each column as it is in A, whose pull towards zero is taken off
            again (`estimators.attenuation`), half of it counted as uncertainty. None takes A as
            exact, which is ordinary least squares.
    """

    noise_A: Floats | None = None


@njit(cache=True)
def _grams(A: Floats, f: Floats, segment_id: Ints, ids: Ints) -> tuple[Floats, Floats, Ints, Ints]:
    """AᵀA, Aᵀf, first and last sample of each segment in `ids` (ascending)."""
    p = A.shape[1]
    G = np.zeros((ids.size, p, p))
    h = np.zeros((ids.size, p))
    first = np.full(ids.size, -1, np.int64)
    last = np.full(ids.size, -1, np.int64)
    for k in range(f.size):
        if segment_id[k] < 0:
            continue
        row = np.searchsorted(ids, segment_id[k])
        if first[row] < 0:
            first[row] = k
        last[row] = k
        for i in range(p):
            h[row, i] += A[k, i] * f[k]
            for c in range(p):
                G[row, i, c] += A[k, i] * A[k, c]
    return G, h, first, last


def trace(A: Floats, f: Floats, segment_id: Ints, options: PooledOptions | None = None) -> Trace:
    """Estimate every segment.

    Args:
        A: (n, p) regressor; rows with a negative segment_id may be NaN.
        f: (n,) force.
        segment_id: (n,) the segment that each sample is pooled into, negative for none.
        options: noise of the columns, where it is known.

    Returns:
        A row a segment, in ascending order of segment_id; `index` is its last pooled sample.
        A segment whose samples do not determine θ has NaN.
    """
    noise = (options or PooledOptions()).noise_A
    p = A.shape[1]
    used = segment_id >= 0
    ids = np.unique(segment_id[used]).astype(np.int64)
    if ids.size == 0:
        return Trace.empty(p)
    G, h, first, last = _grams(A, f, segment_id, ids)
    counts = np.bincount(np.searchsorted(ids, segment_id[used]), minlength=ids.size).astype(float)
    theta = np.stack([solve_spd(G[row], h[row]) for row in range(ids.size)])
    clean, change = G, np.zeros_like(theta)
    if noise is not None:
        change = attenuations(G, counts, theta, noise)
        clean, theta = G - counts[:, None, None] * np.diag(np.square(noise)), theta + change
    residual = np.zeros(f.size)
    row_of = np.searchsorted(ids, segment_id[used])
    residual[used] = f[used] - np.einsum("ij,ij->i", A[used], theta[row_of])
    solved = np.isfinite(theta[:, 0])
    group = np.full(f.size, -1, np.int64)
    group[used] = np.where(solved[row_of], segment_id[used], -1)
    correlation, _ = pooled_autocorrelation(residual, group, p)
    rss = np.bincount(row_of, weights=residual[used] ** 2, minlength=ids.size)
    std = np.empty((ids.size, p))
    for row in range(ids.size):
        B = meat(A, segment_id, ids[row], first[row], last[row], correlation)
        std[row] = deviations(clean[row], B, rss[row], counts[row])
    std = np.hypot(std, DOUBT * change)
    condition = np.array([condition_number(g) for g in G])
    return Trace(last, theta, std, np.sqrt(rss / counts), condition, correlation)
