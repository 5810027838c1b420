"""The autocorrelation of the residuals, pooled over the log.

Smoothing correlates residuals over its length, so the textbook variance σ²(AᵀA)⁻¹ is several times
too small. One window is too short to tell its residuals' correlation; the log is not.
"""

import numpy as np

from estimators.compiled import compiled
from estimators.trace import Floats, Ints

#: More lags are never looked at: a manoeuvre may be a whole shift.
MOST_LAGS = 256


@compiled
def _lag_sums(residual: Floats, group: Ints, lags: int) -> tuple[Floats, Floats]:
    """Σ e_i e_{i+j} and the number of pairs for j < lags, both ends in one group (group >= 0)."""
    sums = np.zeros(lags)
    pairs = np.zeros(lags)
    n = residual.size
    for i in range(n):
        mine = group[i]
        if mine >= 0:
            count = min(lags, n - i)
            e = residual[i]
            following, theirs = residual[i : i + count], group[i : i + count]
            for j in range(count):
                # a group may have holes
                both = theirs[j] == mine
                sums[j] += e * following[j] if both else 0.0
                pairs[j] += 1.0 if both else 0.0
    return sums, pairs


def pooled_autocorrelation(residual: Floats, group: Ints, parameters: int) -> tuple[Floats, float]:
    """Estimate the residuals' autocorrelation over all groups, and their variance.

    Each group (a window, a manoeuvre) has had its own `parameters` fitted, which takes about
    p·ω/n from every lag (ω the long-run variance); that is put back. The lags kept are chosen by
    the flat-top rule of Politis (2003): twice the lag after which the correlation stays within
    its noise, weight 1 on the first half and falling to 0 over the second.

    Args:
        residual: (n,) residuals; where group < 0 they are not looked at.
        group: (n,) the fit that each residual comes from, negative for none.
        parameters: parameters fitted in each group.

    Returns:
        (lags,) autocorrelation with its taper applied, 1 first; and the variance at lag 0.
    """
    used = group >= 0
    n = int(used.sum())
    groups = np.unique(group[used]).size
    if n <= groups * parameters:
        return np.ones(1), float("nan")
    # no more lags than a quarter of a typical fit can tell
    limit = min(max(1, n // groups // 4), MOST_LAGS)
    sums, pairs = _lag_sums(residual, group, limit)
    covariance = sums / np.maximum(pairs, 1.0)
    if covariance[0] <= 0.0:
        return np.ones(1), 0.0
    band = 2.0 * np.sqrt(np.log10(max(n, 10)) / n)
    run = max(5, int(np.ceil(np.sqrt(np.log10(max(n, 10))))))
    quiet = np.abs(covariance / covariance[0]) < band
    kept = limit
    for lag in range(1, limit):
        if quiet[lag : lag + run].all():
            kept = lag
            break
    width = min(2 * kept, limit)
    taper = np.clip(2.0 * (1.0 - np.arange(width) / width), 0.0, 1.0)
    tapered = taper * covariance[:width]
    # E[c_j] ≈ r_j - pω/n per group, with ω itself made of the r_j: solve for ω
    share = parameters * groups / n
    long_run = tapered[0] + 2.0 * tapered[1:].sum()
    weight = taper[0] + 2.0 * taper[1:].sum()
    long_run = max(long_run, 0.0) / max(1.0 - share * weight, 0.25)
    corrected = taper * (covariance[:width] + share * long_run)
    return corrected / corrected[0], float(corrected[0])


def window_residuals(
    A: Floats, f: Floats, theta: Floats, index: Ints, window: int
) -> tuple[Floats, Ints]:
    """Cover the solved windows with disjoint ones, first come first, and take their residuals.

    Args:
        A: (n, p) regressor.
        f: (n,) force.
        theta: (rows, p) estimates; a row of NaN has no window.
        index: (rows,) last samples of their windows, ascending.
        window: samples in a window.

    Returns:
        (n,) residuals f - A θ, and (n,) the row whose window owns each sample, -1 for none.
    """
    residual, owner = np.zeros(f.size), np.full(f.size, -1, np.int64)
    _residuals(A, f, theta, index, window, residual, owner)
    return residual, owner


@compiled
def _residuals(
    A: Floats,
    f: Floats,
    theta: Floats,
    index: Ints,
    window: int,
    residual: Floats,
    owner: Ints,
) -> None:
    free = 0
    for row in range(index.size):
        first = index[row] - window + 1
        if first >= free and not np.isnan(theta[row, 0]):
            free = index[row] + 1
            for k in range(first, free):
                owner[k] = row
                residual[k] = f[k]
                for c in range(A.shape[1]):
                    residual[k] -= A[k, c] * theta[row, c]
