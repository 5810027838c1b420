"""Least squares pooled over all accepted samples of a manoeuvre: one estimate each.

Sliding windows use the samples of a start repeatedly; here every sample is used once.
"""

from dataclasses import dataclass

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.estimate import Trace
from estimators.interpreted import compiled_unless_short_log
from estimators.methods.method_limits import LIMITS
from estimators.numerics.autocorrelation import (
    compute_std_widening_factor,
    estimate_pooled_autocorrelation,
)
from estimators.numerics.fit_loss import list_group_numbers
from estimators.numerics.normal_equations import (
    count_columns_of_packed_products,
    solve_packed_equations,
)
from estimators.numerics.sandwich import compute_sandwich_meat, compute_sandwich_stds
from estimators.numerics.small_systems import (
    compute_condition_numbers,
    find_packed_index,
    unpack_leading_block,
)


@dataclass(frozen=True, slots=True)
class PooledOptions:
    """Known noise of the regressor.

    Attributes:
        noise: (p + 1, p + 1) covariance of the noise in a row of [A f]. Its attenuation is
            corrected (`estimators.methods.attenuation`), with half of the correction counted as
            uncertainty. None treats A as exact, which is ordinary least squares.
    """

    noise: Floats | None = None


@compiled_unless_short_log
def add_sample_products(
    A: Floats, f: Floats, used_samples: Ints, column_of_sample: Ints, products: Floats
) -> None:
    """Add the products of each used sample to its column of packed sums (entries, ids).

    Sample `used_samples[i]` is added to column `column_of_sample[i]`.
    """
    for i in range(used_samples.size):
        k: int = used_samples[i]
        row: int = column_of_sample[i]
        add_one_sample_product(A[k], f[k], products[:, row])


@compiled_unless_short_log
def add_one_sample_product(a: Floats, f: float, products: Floats) -> None:
    """Add one sample's products to a packed sum (entries,)."""
    p = a.size
    for i in range(p):
        for j in range(i, p):
            products[find_packed_index(i, j, p + 1)] += a[i] * a[j]
        products[find_packed_index(i, p, p + 1)] += a[i] * f
    products[find_packed_index(p, p, p + 1)] += f * f


def subtract_expected_noise(products: Floats, counts: Floats, options: PooledOptions) -> Floats:
    """Packed sums (entries, ids) of `counts` (ids,) samples, minus the expected noise products."""
    if options.noise is None:
        return products
    clean, q = products.copy(), count_columns_of_packed_products(products)
    for i in range(q - 1):
        for j in range(i, q):
            clean[find_packed_index(i, j, q)] -= counts * options.noise[i, j]
    return clean


def estimate_along_log(
    A: Floats, f: Floats, manoeuvre_of_sample: Ints, options: PooledOptions | None = None
) -> Trace:
    """Estimate every manoeuvre.

    Args:
        A: (n, p) regressor; rows of samples in no manoeuvre may be NaN.
        f: (n,) force.
        manoeuvre_of_sample: (n,) manoeuvre of each sample, negative for none.
        options: noise of the columns, if known.

    Returns:
        A row per manoeuvre, ascending by its number, with the last pooled sample as `index`; NaN if
        the samples of a manoeuvre do not determine θ.
    """
    options = options or PooledOptions()
    p = A.shape[1]
    used = np.flatnonzero(manoeuvre_of_sample >= 0)
    ids = list_group_numbers(manoeuvre_of_sample).astype(np.int64)
    if ids.size == 0:
        return Trace.empty(p)
    row_of = np.searchsorted(ids, manoeuvre_of_sample[used])
    products = np.zeros(((p + 1) * (p + 2) // 2, ids.size))
    add_sample_products(A, f, used, row_of, products)
    counts = np.bincount(row_of, minlength=ids.size).astype(float)
    first, last = np.empty(ids.size, np.int64), np.empty(ids.size, np.int64)
    # if an element is assigned several times, the last value remains
    first[row_of[::-1]], last[row_of] = used[::-1], used
    ordinary = solve_packed_equations(products).theta.T
    clean = subtract_expected_noise(products, counts, options)
    theta = np.ascontiguousarray(solve_packed_equations(clean).theta.T)
    condition = compute_condition_numbers(products, p + 1, p)
    residual = np.zeros(f.size)
    residual[used] = f[used] - np.einsum("ij,ij->i", A[used], theta[row_of])
    solved = np.isfinite(theta[:, 0])
    group = np.full(f.size, -1, np.int64)
    group[used] = np.where(solved[row_of], manoeuvre_of_sample[used], -1)
    correlation, _ = estimate_pooled_autocorrelation(residual, group, A)
    rss = np.bincount(row_of, weights=residual[used] ** 2, minlength=ids.size)
    std = np.empty((ids.size, p))
    for row in range(ids.size):
        B = compute_sandwich_meat(
            A, manoeuvre_of_sample, ids[row], first[row], last[row], correlation
        )
        gram = unpack_leading_block(clean[:, row], p + 1, p)
        known = compute_sandwich_stds(gram, B, float(rss[row]), float(counts[row]))
        std[row] = known * compute_std_widening_factor(counts[row], correlation)
    std = np.hypot(std, LIMITS.uncertain_correction_fraction * (theta - ordinary))
    return Trace(last, theta, std, np.sqrt(rss / counts), condition, correlation)
