"""Small symmetric systems inside compiled loops: p is 2 or 3, where LAPACK's call costs more."""

import numpy as np
from numba import njit

from estimators.trace import Floats


def lstsq(A: Floats, f: Floats) -> Floats:
    """The least-squares solution of A θ = f, (p,), by SVD: the readable forms' solver."""
    return np.asarray(np.linalg.lstsq(A, f, rcond=None)[0], np.float64)


@njit(cache=True)
def solve_spd(G: Floats, h: Floats) -> Floats:
    """Solve G x = h by Cholesky on columns scaled to unit diagonal; NaN where G is singular.

    Args:
        G: (p, p) symmetric positive definite.
        h: (p,) right-hand side.

    Returns:
        (p,) solution.
    """
    p = h.size
    scale = np.empty(p)
    for i in range(p):
        if not G[i, i] > 0.0:
            return np.full(p, np.nan)
        scale[i] = 1.0 / np.sqrt(G[i, i])
    L = np.zeros((p, p))
    for i in range(p):
        for j in range(i + 1):
            s = G[i, j] * scale[i] * scale[j]
            for m in range(j):
                s -= L[i, m] * L[j, m]
            if i == j:
                # 1e-14: below it the scaled columns are dependent to working precision
                if not s > 1e-14:
                    return np.full(p, np.nan)
                L[i, i] = np.sqrt(s)
            else:
                L[i, j] = s / L[j, j]
    x = np.empty(p)
    for i in range(p):
        s = h[i] * scale[i]
        for m in range(i):
            s -= L[i, m] * x[m]
        x[i] = s / L[i, i]
    for i in range(p - 1, -1, -1):
        s = x[i]
        for m in range(i + 1, p):
            s -= L[m, i] * x[m]
        x[i] = s / L[i, i]
    return x * scale


@njit(cache=True)
def inverse_spd(G: Floats) -> Floats:
    """The inverse of a small symmetric positive definite matrix; NaN where it is singular."""
    p = G.shape[0]
    inverse = np.empty((p, p))
    unit = np.zeros(p)
    for i in range(p):
        unit[i] = 1.0
        inverse[:, i] = solve_spd(G, unit)
        unit[i] = 0.0
    return inverse


@njit(cache=True)
def condition_number(G: Floats) -> float:
    """The condition number of A from its Gram matrix G = AᵀA, columns scaled to unit norm."""
    p = G.shape[0]
    scaled = np.empty((p, p))
    for i in range(p):
        for j in range(p):
            norm = np.sqrt(G[i, i] * G[j, j])
            if not norm > 0.0:
                return np.inf
            scaled[i, j] = G[i, j] / norm
    if p == 1:
        return 1.0
    if p == 2:
        c = min(abs(scaled[0, 1]), 1.0)
        return np.inf if c == 1.0 else np.sqrt((1.0 + c) / (1.0 - c))
    eigenvalues = np.linalg.eigvalsh(scaled)
    if not eigenvalues[0] > 0.0:
        return np.inf
    return np.sqrt(eigenvalues[-1] / eigenvalues[0])
