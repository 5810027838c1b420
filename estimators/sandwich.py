"""Standard deviations under correlated residuals: G⁻¹ (Aᵀ R A) G⁻¹ s², R from pooled lags.

The window's own residuals give the scale: E[RSS] = s² (n - tr(G⁻¹ Aᵀ R A)), so that s² is right
for correlated residuals as well. R = I gives the textbook formula. What few residuals leave open
widens the deviation, so that 1.96 of it are 95 % (`estimators.student`).
"""

import numpy as np

from estimators.autocorrelation import pooled_autocorrelation
from estimators.compiled import compiled
from estimators.linear import at, factor, inverse_spd, invert
from estimators.normal import normal_equations
from estimators.rolling import (
    add_prefix_sums,
    lanes_of,
    load_columns,
    pair_of_blocks,
    suffix_sums,
    take,
)
from estimators.student import widening
from estimators.trace import Floats, Ints

#: Rows of a recursive estimator that are worked on together.
_ROWS = 512


@compiled
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


def deviations(G: Floats, B: Floats, rss: float, samples: float) -> Floats:
    """(p,) standard deviations from AᵀA, AᵀRA and the residual sum of squares.

    Never smaller than the textbook's: a tapered correlation need not be positive definite.
    """
    p = G.shape[0]
    bread = inverse_spd(G).reshape(p, p, 1)
    meats = B[np.triu_indices(p)].reshape(-1, 1)
    out = np.empty((1, p))
    _deviate(bread, meats, np.array([rss]), samples, 1, out)
    return out[0]


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
        autocorrelation, _ = pooled_autocorrelation(residual, one, A)
    B = meat(A, one, 0, 0, residual.size - 1, autocorrelation)
    std = deviations(gram, B, float(residual @ residual), float(residual.size))
    return std * widening(residual.size, autocorrelation)


def window_deviations(
    A: Floats, grams: Floats, rss: Floats, index: Ints, window: int, correlation: Floats
) -> Floats:
    """Standard deviations of windowed estimates.

    Args:
        A: (n, p) regressor.
        grams: (rows, p(p+1)/2) packed, what stands for AᵀA in each window.
        rss: (rows,) residual sum of squares of each window.
        index: (rows,) last sample of each window.
        window: samples in a window.
        correlation: (lags,) residual autocorrelation, 1 first; at most half a window of lags.

    Returns:
        (rows, p) standard deviations.
    """
    out = np.empty((index.size, A.shape[1]))
    _window_deviations(A, grams, rss, index, window, correlation, out)
    return out * widening(window, correlation)


@compiled
def _window_deviations(
    A: Floats,
    grams: Floats,
    rss: Floats,
    index: Ints,
    window: int,
    correlation: Floats,
    out: Floats,
) -> None:
    """Aᵀ R A of each window at a cost that W does not enter, and the deviations that follow.

    The pairs of correlated samples inside a window are those inside its part of the first block,
    those inside its part of the second, and those across; the latter are counted with the longer
    part. So they are sums of two scans as well (see `estimators.rolling`).
    """
    p = A.shape[1]
    entries = p * (p + 1) // 2
    lanes = lanes_of(entries)
    z = np.zeros((p + 1, 2 * window))
    near = np.zeros((p, 2 * window))
    terms = np.zeros((lanes, 2 * window))
    meats = np.empty((lanes, window))
    G = np.empty((entries, window))
    normal = normal_equations(p, window)
    bread = np.empty((p, p, window))
    square = np.empty(window)
    row = 0
    while row < index.size:
        first, end = pair_of_blocks(window, index, row)
        # the windows that have more of the first block, then those that have more of the second
        middle = row
        while middle < end and index[middle] < first + window + window // 2:
            middle += 1
        for begin, stop in ((row, middle), (middle, end)):
            m = stop - begin
            if m > 0:
                _sum_pairs(A, window, index, first, begin, stop, correlation, z, near, terms, meats)
                for entry in range(entries):
                    for k in range(m):
                        G[entry, k] = grams[begin + k, entry]
                for k in range(m):
                    square[k] = rss[begin + k]
                factor(G, p, p, m, normal.L, normal.inverse)
                invert(normal.L, normal.inverse, m, bread)
                _deviate(bread, meats, square, float(window), m, out[begin:stop])
        row = end


@compiled
def _sum_pairs(
    A: Floats,
    window: int,
    index: Ints,
    first: int,
    begin: int,
    end: int,
    correlation: Floats,
    z: Floats,
    near: Floats,
    terms: Floats,
    meats: Floats,
) -> None:
    """Aᵀ R A of the windows begin … end - 1, which all hold more of one of the two blocks."""
    p = A.shape[1]
    lags = correlation.size
    start = index[begin] - window + 1
    samples = index[end - 1] + 1 - start
    span = samples - window + 1
    left = first + window - start
    long_first = 2 * left >= window
    load_columns(A, start, samples, z)
    # each sample's correlated neighbours, counted with the later one of a pair in the second
    # block and with the earlier one in the first; across, with the one in the shorter part
    for c in range(p):
        near[c, :samples] = 0.0
        for lag in range(1, min(lags, samples)):
            r = correlation[lag]
            stop = left - lag if long_first else min(left, samples - lag)
            total, x = near[c], z[c, lag:]
            for k in range(stop):
                total[k] += r * x[k]
            begins = left if long_first else left + lag
            total, x = near[c, begins:], z[c, begins - lag :]
            for k in range(samples - begins):
                total[k] += r * x[k]
    for i in range(p):
        for j in range(i, p):
            term, x, y, u, v = terms[at(i, j, p)], z[i], z[j], near[i], near[j]
            for k in range(samples):
                term[k] = x[k] * y[k] + (x[k] * v[k] + u[k] * y[k])
    suffix_sums(terms, left, meats)
    add_prefix_sums(terms, left, window - left, span, meats)
    take(meats, index, begin, end)


@compiled
def _deviate(
    bread: Floats, meats: Floats, rss: Floats, samples: float, m: int, out: Floats
) -> None:
    """Standard deviations (m, p) from inverses (p, p, m), packed meats and RSS (m,)."""
    p = bread.shape[0]
    for k in range(m):
        trace = 0.0
        for i in range(p):
            for j in range(p):
                trace += meats[at(min(i, j), max(i, j), p), k] * bread[i, j, k]
        freedom = samples - trace
        for i in range(p):
            cover = 0.0
            for r in range(p):
                for c in range(p):
                    B = meats[at(min(r, c), max(r, c), p), k]
                    cover += bread[i, r, k] * B * bread[i, c, k]
            textbook = rss[k] / max(samples - p, 1.0)
            variance = max(rss[k] / freedom * cover, textbook * bread[i, i, k])
            out[k, i] = np.sqrt(variance) if freedom > 0.5 else np.nan


@compiled
def recursive_deviations(grams: Floats, meats: Floats, white: Floats, out: Floats) -> None:
    """Roots of diag G⁻¹ M G⁻¹, (rows, p), for residuals of variance 1; never below `white`'s.

    Args:
        grams: (rows, entries) packed G.
        meats: (rows, entries) packed M; a tapered correlation need not leave it positive.
        white: (rows, entries) packed M of uncorrelated residuals.
        out: (rows, p).
    """
    rows, p = out.shape
    G = np.empty((grams.shape[1], _ROWS))
    normal = normal_equations(p, _ROWS)
    bread = np.empty((p, p, _ROWS))
    for begin in range(0, rows, _ROWS):
        m = min(_ROWS, rows - begin)
        for entry in range(G.shape[0]):
            for k in range(m):
                G[entry, k] = grams[begin + k, entry]
        factor(G, p, p, m, normal.L, normal.inverse)
        invert(normal.L, normal.inverse, m, bread)
        for k in range(m):
            for i in range(p):
                cover = floor = 0.0
                for r in range(p):
                    for c in range(p):
                        both = bread[i, r, k] * bread[i, c, k]
                        entry = at(min(r, c), max(r, c), p)
                        cover += both * meats[begin + k, entry]
                        floor += both * white[begin + k, entry]
                out[begin + k, i] = np.sqrt(max(cover, floor))
