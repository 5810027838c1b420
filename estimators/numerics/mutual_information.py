"""The indices (10) and (11) between acceleration and force over a sliding window."""

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.interpreted import compiled_unless_short_log
from estimators.numerics.rolling import (
    convert_centred_moments_to_products,
    find_begins_of_block_pairs,
    make_window_sum_workspace,
    sum_moments_of_block_pair,
)
from estimators.numerics.small_systems import find_packed_index
from estimators.threads import run_in_chunks

#: A smaller fraction of Σx² than this is rounding, not variance.
_NO_SPREAD = 1e-24


def compute_window_correlation(x: Floats, y: Floats, window: int) -> tuple[Floats, Floats]:
    """Pearson's ρ of x and y over every window of exactly `window` samples.

    Sums of deviations (see `estimators.numerics.rolling`) keep the digits despite a large mean or
    an idle stretch.

    Args:
        x: (n,) first series.
        y: (n,) second series.
        window: samples in a window, at least 2.

    Returns:
        (n,) ρ: NaN where the window is incomplete, holds a NaN or has no variance in x or y.
        (n,) relative variance: the smaller of Sxx / Σx² and Syy / Σy², 0 for constant series.
    """
    rho = np.full(x.size, np.nan)
    spread = np.full(x.size, np.nan)
    A = x.reshape(-1, 1)

    def fill_rows(rows: slice) -> None:
        ends = np.arange(rows.start, rows.stop) + window - 1
        _, rho[ends], spread[ends] = sum_window_products_and_correlation(A, y, window, ends)

    run_in_chunks(fill_rows, max(x.size - window + 1, 0))
    return rho, spread


@compiled_unless_short_log
def sum_window_products_and_correlation(
    A: Floats, f: Floats, window: int, window_ends: Ints
) -> tuple[Floats, Floats, Floats]:
    """`rolling.sum_window_products`, plus the correlation of A's first column with f.

    Returns:
        (entries, rows) packed products, (rows,) ρ and (rows,) relative variance, as in
        `compute_window_correlation`.
    """
    q = A.shape[1] + 1
    work = make_window_sum_workspace(q, window)
    products = np.empty((q * (q + 1) // 2, window_ends.size))
    rho, spread = np.empty(window_ends.size), np.empty(window_ends.size)
    pairs = find_begins_of_block_pairs(window, window_ends)
    for number in range(pairs.size - 1):
        row: int = pairs[number]
        end: int = pairs[number + 1]
        sum_moments_of_block_pair(A, f, window, window_ends, row, end, work)
        convert_centred_moments_to_products(work.moments, work.centre, window, row, end, products)
        fill_correlation_and_relative_variance(
            work.moments, work.centre, window, rho[row:end], spread[row:end]
        )
    return products, rho, spread


@compiled_unless_short_log
def fill_correlation_and_relative_variance(
    moments: Floats, centre: Floats, window: int, rho: Floats, relative_variance: Floats
) -> None:
    """Compute ρ and relative variance (m,) of first and last series (see `rolling.Workspace`)."""
    q = centre.size
    dx, dy, dxx = moments[0], moments[q - 1], moments[q]
    dxy, dyy = moments[q + q - 1], moments[q + find_packed_index(q - 1, q - 1, q)]
    for k in range(rho.size):
        x, y = dx[k] / window, dy[k] / window
        sxx, sxy, syy = dxx[k] - x * dx[k], dxy[k] - x * dy[k], dyy[k] - y * dy[k]
        mean_x, mean_y = centre[0] + x, centre[q - 1] + y
        # a window with a single value has deviations of exactly 0
        of_x = sxx / (sxx + window * (mean_x * mean_x)) if sxx > 0.0 else 0.0 * sxx
        of_y = syy / (syy + window * (mean_y * mean_y)) if syy > 0.0 else 0.0 * syy
        least = of_x if of_x < of_y or np.isnan(of_x) else of_y
        value = sxy / (np.sqrt(sxx) * np.sqrt(syy))
        value = 1.0 if value > 1.0 else value
        value = -1.0 if value < -1.0 else value
        relative_variance[k] = least
        rho[k] = value if least > _NO_SPREAD else np.nan


def correlation_to_information_index(rho: Floats) -> Floats:
    """The index (11), -½ ln(1 - ρ) in nat: ρ = 1 → ∞, 0 → 0, -1 → -0.3466; NaN stays NaN.

    It is not a mutual information (which depends on ρ²), but it is monotone in ρ: gating on Î ≥ γ
    is gating on ρ ≥ 1 - exp(-2γ).
    """
    with np.errstate(divide="ignore"):
        return -0.5 * np.log1p(-rho)


def correlation_to_gaussian_information(rho: Floats) -> Floats:
    """The mutual information (10) of normal variables, -½ ln(1 - ρ²) in nat; NaN stays NaN.

    Either sign of ρ counts: Î ≥ γ is |ρ| ≥ √(1 - exp(-2γ)).
    """
    return correlation_to_information_index(rho * rho)
