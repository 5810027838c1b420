"""Standard deviations under correlated residuals: G⁻¹ (Aᵀ R A) G⁻¹ s², R from pooled lags.

The window's own residuals give the scale: E[RSS] = s² (n - tr(G⁻¹ Aᵀ R A)), so that s² is right
for correlated residuals as well. R = I gives the textbook formula.
"""

import numpy as np
from numba import njit

from estimators.linear import inverse_spd
from estimators.trace import Floats, Ints


@njit(cache=True)
def meat(A: Floats, group: Ints, of: int, first: int, last: int, correlation: Floats) -> Floats:
    """Aᵀ R A over the samples first … last that belong to group `of`: (p, p)."""
    p = A.shape[1]
    B = np.zeros((p, p))
    tail = np.empty(p)
    lags = correlation.size
    for k in range(first, last + 1):
        if group[k] != of:
            continue
        tail[:] = 0.5 * A[k]
        for j in range(1, min(lags, k - first + 1)):
            if group[k - j] == of:
                for c in range(p):
                    tail[c] += correlation[j] * A[k - j, c]
        for i in range(p):
            for c in range(p):
                B[i, c] += A[k, i] * tail[c] + tail[i] * A[k, c]
    return B


@njit(cache=True)
def deviations(G: Floats, B: Floats, rss: float, samples: float) -> Floats:
    """(p,) standard deviations from AᵀA, AᵀRA and the residual sum of squares.

    Never smaller than the textbook's: a tapered correlation need not be positive definite.
    """
    p = G.shape[0]
    bread = inverse_spd(G)
    BG = B @ bread
    freedom = samples - np.trace(BG)
    out = np.empty(p)
    if not freedom > 0.5:
        out[:] = np.nan
        return out
    scale = rss / freedom
    cover = bread @ BG
    textbook = rss / max(samples - p, 1.0)
    for i in range(p):
        out[i] = np.sqrt(max(scale * cover[i, i], textbook * bread[i, i]))
    return out


@njit(cache=True)
def window_deviations(
    A: Floats, grams: Floats, rss: Floats, index: Ints, window: int, correlation: Floats
) -> Floats:
    """Standard deviations of windowed estimates.

    Args:
        A: (n, p) regressor.
        grams: (rows, p, p) what stands for AᵀA in each window.
        rss: (rows,) residual sum of squares of each window.
        index: (rows,) last sample of each window.
        window: samples in a window.
        correlation: (lags,) residual autocorrelation, 1 first.

    Returns:
        (rows, p) standard deviations.
    """
    rows = index.size
    n, p = A.shape
    one_group = np.zeros(n, np.int64)
    out = np.empty((rows, p))
    for row in range(rows):
        k = index[row]
        B = meat(A, one_group, 0, k - window + 1, k, correlation)
        out[row] = deviations(grams[row], B, rss[row], float(window))
    return out
