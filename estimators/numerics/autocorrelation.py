"""Residual autocorrelation, pooled over the log.

Smoothing correlates residuals over its length, so the textbook variance σ²(AᵀA)⁻¹ is several times
too small. One window is too short to estimate the correlation of its residuals; the log is not.

Standard deviations are scaled so that ±1.96 of them cover 95 % for any number of
residuals: with few degrees of freedom, Student's t widens them.
"""

from typing import Final

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.interpreted import compiled_unless_short_log, compiled_with_array_form
from estimators.numerics.fit_loss import compute_fit_loss, list_group_numbers
from estimators.numerics.in_order import sum_axis_in_order
from estimators.numerics.numerics_limits import LIMITS

#: Number of lags whose sums are accumulated side by side, each in its own order.
_AT_ONCE = 32
#: Residuals in a block; if only some blocks are used, they are spread evenly over the log.
_BLOCK: Final = 2048


@compiled_unless_short_log
def sum_lag_products(
    residual: Floats, group: Ints, lags: int, block_interval: int
) -> tuple[Floats, Floats]:
    """Σ e_i e_{i+j} and the number of pairs for j < lags, both ends in one group (group >= 0).

    Only samples i in one of every `block_interval` blocks count.
    """
    sums = np.zeros(-(-lags // _AT_ONCE) * _AT_ONCE)
    pair_counts = np.zeros(lags)
    n = residual.size
    start = 0
    while start < n:
        end = start + 1
        while end < n and group[end] == group[start]:
            end += 1
        if group[start] >= 0:
            for block in range(start // _BLOCK, (end - 1) // _BLOCK + 1):
                # by the golden ratio, blocks are spread evenly and without a period
                if block * 40_503 % 65_536 * block_interval < 65_536:
                    first, last = max(start, block * _BLOCK), min(end, (block + 1) * _BLOCK)
                    _add_lag_products_of_run(residual[first:end], last - first, sums)
                    for j in range(min(lags, end - first)):
                        pair_counts[j] += min(last, end - j) - first
                    # a group may have gaps
                    add_lag_products_across_gap(
                        residual, group, first, last, end, sums, pair_counts
                    )
        start = end
    return sums[:lags], pair_counts


def _add_lag_products_of_run_vectorised(run: Floats, lag_count: int, sums: Floats) -> None:
    """Form of `_add_lag_products_of_run` by whole arrays."""
    padded = np.zeros(run.size + sums.size)
    padded[: run.size] = run
    later = np.lib.stride_tricks.sliding_window_view(padded, sums.size)[:lag_count]
    terms = np.vstack([sums, padded[:lag_count, None] * later])
    sums[:] = sum_axis_in_order(terms, 0)


@compiled_with_array_form(_add_lag_products_of_run_vectorised)
def _add_lag_products_of_run(run: Floats, lag_count: int, sums: Floats) -> None:
    """Add the products of the first samples with their successors, many lags at once."""
    n = min(run.size, lag_count + sums.size)
    # zeros after the end, so that all lags have the same number of terms
    padded = np.zeros(n + sums.size)
    padded[:n] = run[:n]
    for first in range(0, sums.size, _AT_ONCE):
        if first >= n:
            break
        own = sums[first : first + _AT_ONCE]
        last = min(lag_count, n - first)
        # four terms of each sum between loading and storing it, in their order
        for k in range(0, last - 3, 4):
            e0, e1, e2, e3 = padded[k], padded[k + 1], padded[k + 2], padded[k + 3]
            others = padded[k + first : k + first + _AT_ONCE + 3]
            for d in range(_AT_ONCE):
                total = own[d] + e0 * others[d]
                total += e1 * others[d + 1]
                total += e2 * others[d + 2]
                own[d] = total + e3 * others[d + 3]
        for k in range(last - last % 4, last):
            e, others = padded[k], padded[k + first : k + first + _AT_ONCE]
            for d in range(_AT_ONCE):
                own[d] += e * others[d]


@compiled_unless_short_log
def add_lag_products_across_gap(
    residual: Floats,
    group: Ints,
    block_start: int,
    block_end: int,
    run_end: int,
    sums: Floats,
    pair_counts: Floats,
) -> None:
    """Add the pairs of a run's samples with samples of its group beyond a gap."""
    lags = pair_counts.size
    mine, reach = group[block_start], min(block_end - 1 + lags, group.size)
    for other in range(run_end, reach):
        if group[other] == mine:
            for i in range(max(block_start, other - lags + 1), block_end):
                sums[other - i] += residual[i] * residual[other]
                pair_counts[other - i] += 1.0


def compute_autocovariance_loss(group: Ints, A: Floats | None) -> Floats:
    """Loss of autocovariance of the residuals caused by fitting A, (lags, lags).

    It does not depend on the residuals, so repeated fits of the same A can reuse it.

    Args:
        group: (n,) fit that each sample belongs to, negative for none.
        A: (n, p) regressor fitted to each group; None if nothing was fitted.
    """
    n, groups = int((group >= 0).sum()), list_group_numbers(group).size
    if n <= groups * (0 if A is None else A.shape[1]):
        return np.zeros((0, 0))
    # at most as many lags as a quarter of a typical fit's samples
    limit = min(max(1, n // groups // 4), LIMITS.max_lags)
    return np.zeros((limit, limit)) if A is None else compute_fit_loss(A, group, limit)


def estimate_pooled_autocorrelation(
    residual: Floats, group: Ints, A: Floats | None, loss: Floats | None = None
) -> tuple[Floats, float]:
    """Residual autocorrelation over all groups, and variance of the residuals.

    The autocovariance lost to each group's own fit is restored (`fit_loss`). The lags kept are
    chosen by the flat-top rule of Politis (2003): twice the lag after which the correlation stays
    within its noise, weight 1 on the first half and falling to 0 over the second. With few
    residuals the long-run variance has few degrees of freedom, n over the sum of the squared
    weights: it is raised by (t/1.96)², so that 1.96 deviations are 95 %.

    Args:
        residual: (n,) residuals; ignored where group < 0.
        group: (n,) fit that each residual comes from, negative for none.
        A: (n, p) regressor fitted to each group; None if nothing was fitted.
        loss: the fit's `compute_autocovariance_loss`, if already computed.

    Returns:
        (lags,) tapered autocorrelation, 1 first; and the variance at lag 0.

    Raises:
        ValueError: residuals and groups differ in length, so compiled loops would read beyond them.
    """
    if residual.size != group.size:
        raise ValueError(
            f"{residual.size} residuals, but {group.size} group numbers; give one per residual"
        )
    loss = compute_autocovariance_loss(group, A) if loss is None else loss
    limit, n = len(loss), int((group >= 0).sum())
    if not limit:
        return np.ones(1), float("nan")
    sums, pairs = sum_lag_products(residual, group, limit, max(n // LIMITS.correlated_residuals, 1))
    found, n = sums / np.maximum(pairs, 1.0), int(pairs[0])
    if found[0] <= 0.0:
        return np.ones(1), 0.0
    noise = 2.0 * np.sqrt(np.log10(max(n, 10)) / n)
    run = max(5, int(np.ceil(np.sqrt(np.log10(max(n, 10))))))
    # the loss biases all lags downwards: restore it first, with lags up to the first within noise
    kept = find_first_lag_within_noise(found, noise, 1)
    kept = find_first_lag_within_noise(
        restore_autocovariance_lost_by_fit(found, loss, make_flat_top_lag_weights(kept, limit)),
        noise,
        run,
    )
    taper = make_flat_top_lag_weights(kept, limit)
    restored = restore_autocovariance_lost_by_fit(found, loss, taper)
    both_sides = np.where(np.arange(limit) > 0, 2.0, 1.0) * taper
    long_run = max(float(both_sides @ restored), 0.0)
    growth = max(long_run / max(float(both_sides @ found), 1e-3 * found[0]), 1.0)
    degrees_of_freedom = n / float(both_sides @ taper) / growth**2
    allowed = (
        (compute_student_to_normal_ratio(degrees_of_freedom) ** 2 - 1.0)
        * long_run
        / both_sides.sum()
    )
    corrected = (taper * (restored + allowed))[taper > 0.0]
    return corrected / corrected[0], float(corrected[0])


@compiled_unless_short_log
def make_flat_top_lag_weights(kept_lags: int, lag_count: int) -> Floats:
    """Weights of `lag_count` lags: 1 up to `kept_lags`, falling to 0 at twice as many."""
    width = min(2 * kept_lags, lag_count)
    out = np.empty(lag_count)
    for lag in range(lag_count):
        out[lag] = min(max(2.0 * (1.0 - lag / width), 0.0), 1.0)
    return out


@compiled_unless_short_log
def find_first_lag_within_noise(autocovariance: Floats, noise: float, min_run: int) -> int:
    """First lag from which `min_run` lags, or all remaining ones, stay within the noise."""
    first = 1
    for lag in range(1, autocovariance.size):
        if not abs(autocovariance[lag] / autocovariance[0]) < noise:
            first = lag + 1
        elif lag - first + 1 >= min_run:
            break
    return first


def restore_autocovariance_lost_by_fit(
    autocovariance: Floats, loss: Floats, lag_weights: Floats
) -> Floats:
    """Autocovariances (lags,) with the loss from fitting restored.

    It is restored by repeated substitution; if a fit leaves few degrees of freedom, solving the
    equations would be unstable.
    """
    restored = autocovariance
    # without a fit nothing was lost
    for _ in range(LIMITS.loss_rounds if loss.any() else 0):
        restored = autocovariance + loss @ (lag_weights * restored)
    return restored


def compute_disjoint_window_residuals(
    A: Floats, f: Floats, theta: Floats, window_ends: Ints, window: int
) -> tuple[Floats, Ints]:
    """Select disjoint windows that cover the solved ones, and compute their residuals.

    Args:
        A: (n, p) regressor.
        f: (n,) force.
        theta: (rows, p) estimates; rows of NaN are skipped.
        window_ends: (rows,) last sample of each window, ascending.
        window: samples in a window.

    Returns:
        (n,) residuals f - A θ, and (n,) row of the window that each sample belongs to, -1 for none.
    """
    residual, owner = np.zeros(f.size), np.full(f.size, -1, np.int64)
    _fill_window_residuals(A, f, theta, window_ends, window, residual, owner)
    return residual, owner


@compiled_unless_short_log
def _fill_window_residuals(
    A: Floats,
    f: Floats,
    theta: Floats,
    window_ends: Ints,
    window: int,
    residual: Floats,
    owner: Ints,
) -> None:
    free = 0
    for row in range(window_ends.size):
        first = window_ends[row] - window + 1
        if first >= free and not np.isnan(theta[row, 0]):
            free = window_ends[row] + 1
            for k in range(first, free):
                owner[k] = row
                residual[k] = f[k]
                for c in range(A.shape[1]):
                    residual[k] -= A[k, c] * theta[row, c]


def compute_student_to_normal_ratio(degrees_of_freedom: float) -> float:
    """Student's t over the normal quantile at 95 %, by the Cornish-Fisher expansion.

    The error is below 0.5 % from 3 degrees of freedom on; fewer count as 3.
    """
    x = 1.0 / max(degrees_of_freedom, LIMITS.min_degrees_of_freedom)
    return 1.0 + x * (1.2104 + x * (1.4335 + x * (1.2904 + x * 0.89)))


def compute_std_widening_factor(samples: float, correlation: Floats) -> float:
    """Factor for a standard deviation estimated from `samples` correlated residuals.

    The effective number of residuals follows from the sum of squared correlations (Bartlett).
    """
    alike = 2.0 * float(correlation @ correlation) - float(correlation[0]) ** 2
    return compute_student_to_normal_ratio(samples / alike)
