"""Sums over sliding windows without drift: the two-scan algorithm (van Herk 1992, Gil-Werman 1993).

The log is cut into blocks of one window's length. Prefix sums run forward in each block, suffix
sums backward; any window is one suffix and one prefix added. Nothing is ever subtracted, so a sum
neither drifts over hours nor loses digits in an idle stretch, and a NaN spoils only the windows
that contain it.
"""

import numpy as np
from numba import njit

from estimators.trace import Bools, Floats, Ints


def window_ends(accepted: Bools, window: int) -> Ints:
    """The last samples of the accepted windows, ascending; a window must be complete."""
    ends = np.flatnonzero(accepted).astype(np.int64)
    return ends[ends >= window - 1]


@njit(cache=True)
def window_sums(values: Floats, window: int) -> Floats:
    """Sum every run of exactly `window` consecutive rows.

    Args:
        values: (n, q).
        window: rows in a window, 1 <= window.

    Returns:
        (n, q): row k sums rows k-window+1 … k; NaN where k < window-1.
    """
    n, q = values.shape
    sums = np.full((n, q), np.nan)
    suffix = np.empty((window, q))
    prefix = np.empty(q)
    for start in range(0, n - window + 1, window):
        # suffix[i] = values[start+i] + … + values[start+window-1]
        suffix[window - 1] = values[start + window - 1]
        for i in range(window - 2, -1, -1):
            for c in range(q):
                suffix[i, c] = suffix[i + 1, c] + values[start + i, c]
        sums[start + window - 1] = suffix[0]
        prefix[:] = 0.0
        for i in range(1, window):
            k = start + window - 1 + i
            if k >= n:
                break
            for c in range(q):
                prefix[c] += values[k, c]
                sums[k, c] = suffix[i, c] + prefix[c]
    return sums


@njit(cache=True)
def products(A: Floats, f: Floats) -> Floats:
    """Per-sample products of the columns of [A f]: the upper triangle, row by row, (n, q)."""
    n, p = A.shape
    out = np.empty((n, (p + 1) * (p + 2) // 2))
    for k in range(n):
        c = 0
        for i in range(p + 1):
            x = A[k, i] if i < p else f[k]
            for j in range(i, p + 1):
                out[k, c] = x * (A[k, j] if j < p else f[k])
                c += 1
    return out


@njit(cache=True)
def unpack(sums: Floats, p: int) -> tuple[Floats, Floats, float]:
    """AᵀA (p, p), Aᵀf (p,) and fᵀf from one row of summed `products`."""
    G = np.empty((p, p))
    h = np.empty(p)
    c = 0
    for i in range(p):
        for j in range(i, p):
            G[i, j] = sums[c]
            G[j, i] = sums[c]
            c += 1
        h[i] = sums[c]
        c += 1
    return G, h, sums[c]
