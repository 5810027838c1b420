"""The normal equations of many windows, from the summed products of the columns of [A f]."""

from typing import NamedTuple

import numpy as np

from estimators.compiled import compiled
from estimators.linear import at, factor, substitute
from estimators.trace import Floats


class Normal(NamedTuple):
    """Room to solve windows of p parameters in.

    Attributes:
        L: (p, p, windows) factors of AᵀA.
        inverse: (p, windows) of their pivots.
        x: (p, windows) solutions; NaN where AᵀA is singular.
        rss: (windows,) residual sums of squares.
    """

    L: Floats
    inverse: Floats
    x: Floats
    rss: Floats


@compiled
def normal_equations(p: int, windows: int) -> Normal:
    """Room for that many windows."""
    return Normal(
        np.empty((p, p, windows)),
        np.empty((p, windows)),
        np.empty((p, windows)),
        np.empty(windows),
    )


@compiled
def solve_products(products: Floats, m: int, normal: Normal) -> None:
    """Solve AᵀA x = Aᵀf of m windows; products (entries, ≥ m) packed, p + 1 columns."""
    p = normal.x.shape[0]
    factor(products, p + 1, p, m, normal.L, normal.inverse)
    for i in range(p):
        x, h = normal.x[i], products[at(i, p, p + 1)]
        for k in range(m):
            x[k] = h[k]
    substitute(normal.L, normal.inverse, m, normal.x)
    rss, ff = normal.rss, products[at(p, p, p + 1)]
    for k in range(m):
        rss[k] = ff[k]
    for i in range(p):
        x, h = normal.x[i], products[at(i, p, p + 1)]
        for k in range(m):
            rss[k] -= h[k] * x[k]
    for k in range(m):
        rss[k] = 0.0 if rss[k] < 0.0 else rss[k]


@compiled
def residual_squares(products: Floats, x: Floats, m: int, rss: Floats) -> None:
    """Residual sums of squares (m,) of any solutions x (p, ≥ m): ff - 2 xᵀh + xᵀG x."""
    p = x.shape[0]
    ff = products[at(p, p, p + 1)]
    for k in range(m):
        rss[k] = ff[k]
    for i in range(p):
        a, h = x[i], products[at(i, p, p + 1)]
        for k in range(m):
            rss[k] -= 2.0 * a[k] * h[k]
        for j in range(p):
            b, G = x[j], products[at(min(i, j), max(i, j), p + 1)]
            for k in range(m):
                rss[k] += a[k] * b[k] * G[k]
    for k in range(m):
        rss[k] = 0.0 if rss[k] < 0.0 else rss[k]


@compiled
def store(x: Floats, products: Floats, row: int, m: int, theta: Floats, grams: Floats) -> None:
    """Keep m solutions in theta (rows, p) and their AᵀA, packed, in grams (rows, entries)."""
    p = x.shape[0]
    for i in range(p):
        solution = x[i]
        for k in range(m):
            theta[row + k, i] = solution[k]
        for j in range(i, p):
            entry = products[at(i, j, p + 1)]
            for k in range(m):
                grams[row + k, at(i, j, p)] = entry[k]
