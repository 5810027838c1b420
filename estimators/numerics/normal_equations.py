"""Normal equations of many windows, from summed products of the columns of [A f]."""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats
from estimators.interpreted import compiled_with_array_form
from estimators.numerics.small_systems import (
    factor_packed_ldl,
    find_packed_index,
    make_packed_index_table,
    solve_factored_in_place,
)


class Solution(NamedTuple):
    """Solution of m windows: θ (p, m), NaN where AᵀA is singular, its factors, and RSS (m,)."""

    theta: Floats
    L: Floats
    inverse: Floats
    rss: Floats


def count_columns_of_packed_products(products: Floats) -> int:
    """Number of columns of [A f], from the number of its packed products."""
    return (int(np.sqrt(8 * len(products) + 1)) - 1) // 2


def solve_packed_equations(products: Floats) -> Solution:
    """Solve AᵀA θ = Aᵀf of m windows, from packed products (entries, m)."""
    q = count_columns_of_packed_products(products)
    p = q - 1
    L, inverse = factor_packed_ldl(products, q, p)
    *sides, square = make_packed_index_table(q)[p]
    theta = products[sides]
    solve_factored_in_place(L, inverse, theta)
    rss = products[square].copy()
    for side, x in zip(sides, theta, strict=True):
        rss -= products[side] * x
    return Solution(theta, L, inverse, np.maximum(rss, 0.0))


def _compute_residual_sums_of_squares_vectorised(products: Floats, theta: Floats) -> Floats:
    p = len(theta)
    rows = make_packed_index_table(p + 1)
    rss = products[rows[p][p]].copy()
    for i in range(p):
        rss -= 2.0 * theta[i] * products[rows[i][p]]
        for j in range(p):
            rss += theta[i] * theta[j] * products[rows[i][j]]
    return np.maximum(rss, 0.0)


@compiled_with_array_form(_compute_residual_sums_of_squares_vectorised)
def compute_residual_sums_of_squares(products: Floats, theta: Floats) -> Floats:
    """Residual sums of squares (m,) for any θ (p, m): ff - 2 θᵀh + θᵀG θ."""
    p, m = theta.shape
    rss = products[find_packed_index(p, p, p + 1)].copy()
    for i in range(p):
        side = products[find_packed_index(i, p, p + 1)]
        for k in range(m):
            rss[k] -= 2.0 * theta[i, k] * side[k]
        for j in range(p):
            entry = products[find_packed_index(min(i, j), max(i, j), p + 1)]
            for k in range(m):
                rss[k] += theta[i, k] * theta[j, k] * entry[k]
    return np.maximum(rss, 0.0)


def extract_packed_gram(products: Floats) -> Floats:
    """Packed AᵀA (p(p+1)/2, m) from the products of [A f]."""
    p = count_columns_of_packed_products(products) - 1
    return products[
        [entry for i, row in enumerate(make_packed_index_table(p + 1)[:p]) for entry in row[i:p]]
    ]
