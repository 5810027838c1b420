"""Least squares pooled over all accepted samples of a manoeuvre: one estimate a segment.

Where windows slide over one start again and again, this uses every sample once.
"""

from dataclasses import dataclass

import numpy as np

from estimators.attenuation import DOUBT
from estimators.autocorrelation import pooled_autocorrelation, widening
from estimators.compiled import compiled
from estimators.estimate import Floats, Ints, Trace
from estimators.fit_loss import group_ids
from estimators.linear import condition_numbers, packed_index, unpack
from estimators.normal_equations import columns_of, solve
from estimators.sandwich import deviations, meat


@dataclass(frozen=True, slots=True)
class PooledOptions:
    """What is known of the regressor's own noise.

    Attributes:
        noise_A: r.m.s. noise of each column as it is in A, whose pull towards zero is taken off
            again (`estimators.attenuation`), half of it counted as uncertainty. None takes A as
            exact, which is ordinary least squares.
    """

    noise_A: Floats | None = None


@compiled
def _sums(A: Floats, f: Floats, segment_id: Ints, ids: Ints) -> tuple[Floats, Ints, Ints]:
    """Packed products of the columns of [A f], (entries, ids), first and last sample of each id."""
    p = A.shape[1]
    products = np.zeros(((p + 1) * (p + 2) // 2, ids.size))
    first = np.full(ids.size, -1, np.int64)
    last = np.full(ids.size, -1, np.int64)
    row = 0
    for k in range(f.size):
        if segment_id[k] >= 0:
            if ids[row] != segment_id[k]:
                row = np.searchsorted(ids, segment_id[k])
            if first[row] < 0:
                first[row] = k
            last[row] = k
            add_sample(A[k], f[k], products[:, row])
    return products, first, last


@compiled
def add_sample(a: Floats, f: float, products: Floats) -> None:
    """Add one sample's products to a packed sum (entries,)."""
    p = a.size
    for i in range(p):
        for j in range(i, p):
            products[packed_index(i, j, p + 1)] += a[i] * a[j]
        products[packed_index(i, p, p + 1)] += a[i] * f
    products[packed_index(p, p, p + 1)] += f * f


def without_noise(products: Floats, counts: Floats, options: PooledOptions) -> Floats:
    """Packed sums (entries, ids) of counts (ids,) samples, less what noise added to AᵀA."""
    if options.noise_A is None:
        return products
    clean, q = products.copy(), columns_of(products)
    for i in range(q - 1):
        clean[packed_index(i, i, q)] -= counts * options.noise_A[i] ** 2
    return clean


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
    options = options or PooledOptions()
    p = A.shape[1]
    used = segment_id >= 0
    ids = group_ids(segment_id).astype(np.int64)
    if ids.size == 0:
        return Trace.empty(p)
    products, first, last = _sums(A, f, segment_id, ids)
    counts = np.bincount(np.searchsorted(ids, segment_id[used]), minlength=ids.size).astype(float)
    ordinary = solve(products).theta.T
    clean = without_noise(products, counts, options)
    theta = np.ascontiguousarray(solve(clean).theta.T)
    condition = condition_numbers(products, p + 1, p)
    residual = np.zeros(f.size)
    row_of = np.searchsorted(ids, segment_id[used])
    residual[used] = f[used] - np.einsum("ij,ij->i", A[used], theta[row_of])
    solved = np.isfinite(theta[:, 0])
    group = np.full(f.size, -1, np.int64)
    group[used] = np.where(solved[row_of], segment_id[used], -1)
    correlation, _ = pooled_autocorrelation(residual, group, A)
    rss = np.bincount(row_of, weights=residual[used] ** 2, minlength=ids.size)
    std = np.empty((ids.size, p))
    for row in range(ids.size):
        B = meat(A, segment_id, ids[row], first[row], last[row], correlation)
        gram = unpack(clean[:, row], p + 1, p)
        known = deviations(gram, B, float(rss[row]), float(counts[row]))
        std[row] = known * widening(counts[row], correlation)
    std = np.hypot(std, DOUBT * (theta - ordinary))
    return Trace(last, theta, std, np.sqrt(rss / counts), condition, correlation)
