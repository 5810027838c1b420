"""Mutual information from nearest neighbours (Kraskov, Stögbauer, Grassberger 2004, first form).

It needs no Gaussian assumption; the paper leaves such an estimate to future work.
"""

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.compiled import compiled


@compiled
def tabulate_digamma_of_integers(max_n: int) -> Floats:
    """Table of ψ(n) at index n, for n = 1 … `max_n`, by ψ(n + 1) = ψ(n) + 1/n."""
    psi = np.empty(max_n + 1)
    psi[0] = np.nan
    psi[1] = -0.5772156649015329
    for n in range(1, max_n):
        psi[n + 1] = psi[n] + 1.0 / n
    return psi


@compiled
def estimate_window_mutual_information(
    x: Floats, y: Floats, window: int, window_ends: Ints, neighbours: int
) -> Floats:
    """I(x; y) of the windows that end at `window_ends`, without a distribution assumption.

    I = ψ(k) + ψ(W) - <ψ(n_x + 1) + ψ(n_y + 1)>, where n_x counts the samples nearer in x than the
    k-th neighbour in the plane (maximum norm), both axes scaled to unit deviation first.

    Args:
        x: (n,) first series.
        y: (n,) second series.
        window: samples W in a window, more than `neighbours`.
        window_ends: (rows,) last samples of the windows.
        neighbours: k; a larger value has less noise and less resolution.

    Returns:
        (rows,) information in nat, which may be slightly negative; NaN for a window without
        variance or with a NaN.
    """
    psi = tabulate_digamma_of_integers(window + 1)
    out = np.full(window_ends.size, np.nan)
    nearest = np.empty(neighbours)
    for row in range(window_ends.size):
        u = x[window_ends[row] - window + 1 : window_ends[row] + 1]
        v = y[window_ends[row] - window + 1 : window_ends[row] + 1]
        deviation_u = np.std(u)
        deviation_v = np.std(v)
        if not (deviation_u > 0.0 and deviation_v > 0.0):
            continue
        u = u / deviation_u
        v = v / deviation_v
        mean = 0.0
        for i in range(window):
            nearest[:] = np.inf
            for j in range(window):
                if j == i:
                    continue
                d = max(abs(u[j] - u[i]), abs(v[j] - v[i]))
                if d < nearest[neighbours - 1]:
                    m = neighbours - 1
                    while m > 0 and nearest[m - 1] > d:
                        nearest[m] = nearest[m - 1]
                        m -= 1
                    nearest[m] = d
            radius = nearest[neighbours - 1]
            n_u = 0
            n_v = 0
            for j in range(window):
                if j != i:
                    n_u += abs(u[j] - u[i]) < radius
                    n_v += abs(v[j] - v[i]) < radius
            mean += (psi[n_u + 1] + psi[n_v + 1]) / window
        out[row] = psi[neighbours] + psi[window] - mean
    return out
