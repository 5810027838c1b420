"""Sums over windows with weights of the windows' own residuals: O(W) a window, but in step.

Consecutive windows share their samples, so one operation at a time is done on many windows.
"""

from typing import NamedTuple

import numpy as np

from estimators.compiled import compiled
from estimators.normal import Normal, normal_equations, solve_products
from estimators.rolling import sample_products
from estimators.trace import Floats, Ints

#: Consecutive windows that are weighed together: their sums stay in the fastest cache.
AT_ONCE = 128


class Reweighting(NamedTuple):
    """Room to weigh the samples of windows in.

    Attributes:
        raw: (entries, 2 window) products of the samples' columns of [A f], packed.
        weight: (windows,) weights of one sample of each window.
        products: (entries, windows) weighted sums of the products.
        normal: their normal equations.
    """

    raw: Floats
    weight: Floats
    products: Floats
    normal: Normal


@compiled
def reweighting(p: int, window: int) -> Reweighting:
    """Room for the windows of a pair of blocks."""
    entries = (p + 1) * (p + 2) // 2
    return Reweighting(
        np.empty((entries, 2 * window)),
        np.empty(window),
        np.empty((entries, window)),
        normal_equations(p, window),
    )


@compiled
def consecutive(index: Ints, begin: int, end: int) -> int:
    """The end of the consecutive windows from row `begin` on, `AT_ONCE` at most."""
    stop = begin + 1
    while stop < end and stop - begin < AT_ONCE and index[stop] == index[stop - 1] + 1:
        stop += 1
    return stop


@compiled
def reweigh(
    z: Floats,
    window: int,
    index: Ints,
    row: int,
    end: int,
    limit: Floats,
    squared: bool,
    theta: Floats,
    out: Reweighting,
) -> None:
    """Solve windows with weights limit / max(|r|, limit) of their residuals r, or its square.

    Args:
        z: (p + 1, ≥ samples) columns of [A f] from the first sample of window `row` on.
        window: samples in a window.
        index: (rows,) last samples of windows.
        row: the first window to solve, and
        end: the first beyond, all of one pair of blocks.
        limit: (≥ end - row,) residuals up to this weigh fully; 0 only for a window without any.
        squared: whether to weigh by the square.
        theta: (p, ≥ end - row) the estimates that leave the residuals.
        out: gets the weighted `products` and their solutions.
    """
    samples = index[end - 1] - index[row] + window
    sample_products(z, samples, out.raw)
    out.products[:, : end - row] = 0.0
    begin = row
    while begin < end:
        stop = consecutive(index, begin, end)
        offset = index[begin] - index[row]
        _sum_weighted(z, window, offset, begin - row, stop - row, limit, squared, theta, out)
        begin = stop
    solve_products(out.products, end - row, out.normal)


@compiled
def _sum_weighted(
    z: Floats,
    window: int,
    offset: int,
    begin: int,
    end: int,
    limit: Floats,
    squared: bool,
    theta: Floats,
    out: Reweighting,
) -> None:
    """Weighted sums over consecutive windows, of which number `begin` starts at z[:, offset]."""
    m = end - begin
    weight, full = out.weight, limit[begin:end]
    for s in range(offset, offset + window):
        residuals(z, s, theta, begin, end, weight)
        for k in range(m):
            size = abs(weight[k])
            # an exact fit leaves nothing to weigh by
            share = full[k] / size if size > full[k] else 1.0
            weight[k] = share * share if squared else share
        # all but the last entry, fᵀf, which the solution does not need
        for entry in range(out.raw.shape[0] - 1):
            total, product = out.products[entry, begin:end], out.raw[entry, s : s + m]
            for k in range(m):
                total[k] += weight[k] * product[k]


@compiled
def residuals(z: Floats, s: int, theta: Floats, begin: int, end: int, out: Floats) -> None:
    """Residuals (end - begin,) of sample s + k under estimate begin + k."""
    p, m = theta.shape[0], end - begin
    force = z[p, s : s + m]
    for k in range(m):
        out[k] = force[k]
    for c in range(p):
        x, column = theta[c, begin:end], z[c, s : s + m]
        for k in range(m):
            out[k] -= x[k] * column[k]
