"""Sums over windows weighted by each window's own residuals: O(W) per window, in batches.

Consecutive windows share their samples, so each operation is done on many windows at once.
"""

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.interpreted import compiled_unless_short_log, compiled_with_array_form
from estimators.numerics.rolling import (
    copy_force_samples,
    copy_window_columns_to_buffer,
    fill_sample_products,
)

#: Consecutive windows that are processed together, so that their sums stay in the fastest cache.
AT_ONCE = 256
#: Number of samples of a window that are added per step.
_IN_STEP = 4


@compiled_unless_short_log
def find_begins_of_window_batches(window_ends: Ints) -> Ints:
    """First row of each batch of consecutive windows, and the end of the last, (batches + 1,)."""
    starts = np.empty(window_ends.size + 1, np.int64)
    count = 0
    for row in range(window_ends.size):
        follows = row > 0 and window_ends[row] == window_ends[row - 1] + 1
        if not follows or row - starts[count - 1] == AT_ONCE:
            starts[count] = row
            count += 1
    starts[count] = window_ends.size
    return starts[: count + 1]


@compiled_unless_short_log
def copy_samples_to_buffer(
    A: Floats, f: Floats, first_sample: int, sample_count: int, buffer: Floats
) -> None:
    """Copy samples of [A f] from `first_sample` on into z (p + 1, > samples), then zeros."""
    copy_window_columns_to_buffer(A, first_sample, sample_count, buffer)
    copy_force_samples(f, first_sample, sample_count, buffer[A.shape[1]])
    for c in range(buffer.shape[0]):
        for k in range(sample_count, min(sample_count + _IN_STEP, buffer.shape[1])):
            buffer[c, k] = 0.0


@compiled_unless_short_log
def copy_consecutive_estimates(theta: Floats, start: int, end: int) -> Floats:
    """Copy the estimates theta (p, rows) of windows begin … end - 1."""
    out = np.empty((theta.shape[0], end - start))
    for c in range(theta.shape[0]):
        copy_force_samples(theta[c], start, end - start, out[c])
    return out


def _add_weighted_products_vectorised(
    weights: Floats, raw: Floats, sample: int, sums: Floats
) -> None:
    m = sums.shape[1]
    u, v, w, x = weights[:, :m]
    a, b, c, d = (raw[: len(sums) - 1, sample + k : sample + k + m] for k in range(_IN_STEP))
    sums[:-1] += (u * a + v * b) + (w * c + x * d)


@compiled_with_array_form(_add_weighted_products_vectorised)
def add_weighted_sample_products(weights: Floats, raw: Floats, sample: int, sums: Floats) -> None:
    """Add `_IN_STEP` samples from `sample` + k on to sums (entries, m), except the last entry."""
    entries, m = sums.shape
    u, v, w, x = weights[0], weights[1], weights[2], weights[3]
    for entry in range(entries - 1):
        total, product = sums[entry], raw[entry, sample : sample + m + _IN_STEP]
        for k in range(m):
            early = u[k] * product[k] + v[k] * product[k + 1]
            total[k] += early + (w[k] * product[k + 2] + x[k] * product[k + 3])


def _subtract_fit_vectorised(z: Floats, sample: int, theta: Floats, out: Floats) -> None:
    p, m = theta.shape
    out[:m] = z[p, sample : sample + m]
    for c in range(p):
        out[:m] -= theta[c] * z[c, sample : sample + m]


@compiled_with_array_form(_subtract_fit_vectorised)
def fill_residuals_of_sample(z: Floats, sample: int, theta: Floats, out: Floats) -> None:
    """Residuals (m,) of sample `sample` + k for estimate k of theta (p, m)."""
    p, m = theta.shape
    x, column, force = theta[0], z[0, sample : sample + m], z[p, sample : sample + m]
    for k in range(m):
        out[k] = force[k] - x[k] * column[k]
    for c in range(1, p):
        x, column = theta[c], z[c, sample : sample + m]
        for k in range(m):
            out[k] -= x[k] * column[k]


@compiled_unless_short_log
def sum_reweighted_products(
    A: Floats,
    f: Floats,
    window: int,
    window_ends: Ints,
    theta: Floats,
    clipping_limit: Floats,
    squared: bool,
) -> Floats:
    """Sum with weights limit / max(|r|, limit) of the residuals r, or with their squares.

    Args:
        A: (n, p) regressor.
        f: (n,) force.
        window: samples in a window.
        window_ends: (rows,) last samples of windows, ascending.
        theta: (p, rows) estimates that define the residuals.
        clipping_limit: (rows,) largest residual with full weight; 0 only for a window without
            residuals.
        squared: whether to square the weights.

    Returns:
        (entries, rows) packed, weighted products of the columns of [A f]; the last, fᵀf, is 0.
    """
    q = A.shape[1] + 1
    entries = q * (q + 1) // 2
    z = np.empty((q, window + AT_ONCE + _IN_STEP))
    raw = np.empty((entries, window + AT_ONCE + _IN_STEP))
    weights = np.empty((_IN_STEP, AT_ONCE))
    out = np.zeros((entries, window_ends.size))
    starts = find_begins_of_window_batches(window_ends)
    for number in range(starts.size - 1):
        start: int = starts[number]
        end: int = starts[number + 1]
        m = end - start
        first = window_ends[start] - window + 1
        copy_samples_to_buffer(A, f, first, window + m - 1, z)
        fill_sample_products(z, window + m - 1 + _IN_STEP, raw)
        now, full = copy_consecutive_estimates(theta, start, end), clipping_limit[start:end]
        sums = np.zeros((entries, m))
        for s in range(0, window, _IN_STEP):
            for c in range(_IN_STEP):
                weight = weights[c]
                fill_residuals_of_sample(z, s + c, now, weight)
                for k in range(m):
                    size = abs(weight[k])
                    # an exact fit has no residuals for weights
                    share = full[k] / size if size > full[k] else 1.0
                    weight[k] = share * share if squared else share
                if s + c >= window:
                    for k in range(m):
                        weight[k] = 0.0
            add_weighted_sample_products(weights, raw, s, sums)
        for entry in range(entries):
            total = sums[entry]
            for k in range(m):
                out[entry, start + k] = total[k]
    return out
