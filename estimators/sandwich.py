"""Standard deviations under correlated residuals: G⁻¹ (Aᵀ R A) G⁻¹ s², R from pooled lags.

The window's own residuals give the scale: E[RSS] = s² (n - tr(G⁻¹ Aᵀ R A)), so that s² is right
for correlated residuals as well. R = I gives the textbook formula.
"""

import numpy as np
from numba import njit

from estimators.autocorrelation import pooled_autocorrelation
from estimators.linear import inverse_spd
from estimators.rolling import window_sums
from estimators.trace import Floats, Ints


@njit(cache=True)
def meat(A: Floats, group: Ints, of: int, first: int, last: int, correlation: Floats) -> Floats:
    """Aᵀ R A over the samples first … last that belong to group `of`: (p, p).

    Each is paired with itself and those of its group before it, ahead of `first` as well.
    """
    p = A.shape[1]
    B = np.zeros((p, p))
    tail = np.empty(p)
    lags = correlation.size
    for k in range(first, last + 1):
        if group[k] != of:
            continue
        tail[:] = 0.5 * A[k]
        for j in range(1, min(lags, k + 1)):
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


def window_deviation(
    A: Floats, gram: Floats, residual: Floats, autocorrelation: Floats | None
) -> Floats:
    """Standard deviations of one window's estimate, (p,): the readable form.

    Args:
        A: (n, p) regressor.
        gram: (p, p) what stands for AᵀA.
        residual: (n,) residuals, or pseudo-residuals of a robust fit.
        autocorrelation: (lags,) of the residuals; from these alone where none is given.
    """
    one = np.zeros(residual.size, np.int64)
    if autocorrelation is None:
        autocorrelation, _ = pooled_autocorrelation(residual, one, A.shape[1])
    B = meat(A, one, 0, 0, residual.size - 1, autocorrelation)
    return deviations(gram, B, float(residual @ residual), float(residual.size))


@njit(cache=True)
def window_meats(A: Floats, index: Ints, window: int, correlation: Floats) -> Floats:
    """Aᵀ R A of the windows that end at `index`, (rows, p, p), at a cost that W does not enter.

    Per sample, its products with itself and with the samples before it, weighed by their
    correlation, are summed over the window without a subtraction (`estimators.rolling`). That
    counts pairs that reach over the window's start; these are carried along as the window slides,
    and counted afresh once a window so that rounding does not pile up.
    """
    n, p = A.shape
    lags = correlation.size
    q = p * (p + 1) // 2
    # what no window holds must not leave a rounding error behind
    Z = np.zeros((n, p))
    held = -1
    for row in range(index.size):
        for k in range(max(held + 1, index[row] - window + 1), index[row] + 1):
            Z[k] = A[k]
        held = index[row]
    before = np.zeros((n, p))
    after = np.zeros((n, p))
    for k in range(n):
        for j in range(1, min(lags, k + 1)):
            for c in range(p):
                before[k, c] += correlation[j] * Z[k - j, c]
                after[k - j, c] += correlation[j] * Z[k, c]
    terms = np.empty((n, q))
    across = np.zeros((n, q))
    for k in range(n):
        if k > 0 and k % window == 0:
            # every pair of a sample before k and one from k on
            for i in range(k, min(k + lags - 1, n)):
                for j in range(i - k + 1, min(lags, i + 1)):
                    m = 0
                    for r in range(p):
                        for c in range(r, p):
                            pair = Z[i, r] * Z[i - j, c] + Z[i - j, r] * Z[i, c]
                            across[k, m] += correlation[j] * pair
                            m += 1
        m = 0
        for r in range(p):
            for c in range(r, p):
                pair = Z[k, r] * before[k, c] + before[k, r] * Z[k, c]
                terms[k, m] = Z[k, r] * Z[k, c] + pair
                if k + 1 < n and (k + 1) % window != 0:
                    ahead = Z[k, r] * after[k, c] + after[k, r] * Z[k, c]
                    across[k + 1, m] = across[k, m] + ahead - pair
                m += 1
    sums = window_sums(terms, window)
    out = np.empty((index.size, p, p))
    for row in range(index.size):
        m = 0
        for r in range(p):
            for c in range(r, p):
                value = sums[index[row], m] - across[index[row] - window + 1, m]
                out[row, r, c] = value
                out[row, c, r] = value
                m += 1
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
    meats = window_meats(A, index, window, correlation)
    out = np.empty((index.size, A.shape[1]))
    for row in range(index.size):
        out[row] = deviations(grams[row], meats[row], rss[row], float(window))
    return out
