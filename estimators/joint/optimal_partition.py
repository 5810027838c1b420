"""Optimal partitioning: the exact least cost of a series of levels, with pruning.

Jackson et al. 2005, An algorithm for optimal partitioning of data on an interval; Killick et al.
2012, Optimal detection of changepoints with a linear computational cost.
"""

import math

import numpy as np

from estimators.estimate import Floats, Ints
from estimators.interpreted import compiled_ahead
from estimators.numerics.in_order import sum_in_order


@compiled_ahead
def optimal_partition(level: Floats, weight: Floats, cost: Floats, spread: float) -> Ints:
    """The partition of least Σ w (y - ȳ)² + log(W L²/2π) a level, and the changes' own cost.

    Args:
        level: (n,) y.
        weight: (n,) w, the reciprocal of each one's variance; W is the sum over a level.
        cost: (n - 1,) of a change between neighbours; may be negative.
        spread: L, how far apart levels may be.

    Returns:
        (n,) numbers of the levels, from 0.
    """
    n = level.size
    y = level - sum_in_order(level) / n
    w, wy, wyy = np.zeros(n + 1), np.zeros(n + 1), np.zeros(n + 1)
    w[1:], wy[1:], wyy[1:] = np.cumsum(weight), np.cumsum(weight * y), np.cumsum(weight * y * y)
    area = spread * spread / (2.0 * np.pi)
    # what one level more costs: at least, and at most
    least_level, most_level = math.log(weight.min() * area), math.log(w[n] * area)
    before, begins = np.zeros(n + 1, np.int64), np.zeros(n, np.int64)
    # the best that ends here, the change included
    paid, bare = np.zeros(n), np.zeros(n)
    alive = 0
    for end in range(1, n + 1):
        begins[alive] = end - 1
        alive += 1
        least = np.inf
        for k in range(alive):
            begin = begins[k]
            inside, sums = w[end] - w[begin], wy[end] - wy[begin]
            bare[k] = paid[begin] + wyy[end] - wyy[begin] - sums * sums / inside
            if bare[k] + least_level < least:
                total = bare[k] + math.log(inside * area)
                if total < least:
                    least, before[end] = total, begin
        if end == n:
            break
        paid[end] = least + cost[end - 1]
        # a level that is worse by more than a change and a level cost never comes back
        kept = 0
        for k in range(alive):
            if bare[k] + least_level < paid[end] + most_level:
                begins[kept] = begins[k]
                kept += 1
        alive = kept
    return _number_levels(before)


@compiled_ahead
def _number_levels(before: Ints) -> Ints:
    """Numbers of the levels, from where the one that ends at each place begins."""
    end = before.size - 1
    begins = np.zeros(end, np.int64)
    while end > 0:
        end = before[end]
        begins[end] = 1
    return np.cumsum(begins) - 1
