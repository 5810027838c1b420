"""Huber's robust regression over sliding windows: outliers have a bounded influence.

Iteratively reweighted least squares, w = min(1, c / |r/s|), s = median|r| / 0.6745 of the first
OLS residuals (Huber 1964; Huber and Ronchetti 2009, 7.8). To first order the estimate is OLS of the
pseudo-residuals ψ(r) / mean ψ', so their sandwich is its standard deviation.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.estimate import Estimate, Trace
from estimators.interpreted import compiled_unless_short_log
from estimators.methods import ls
from estimators.methods.method_limits import LIMITS
from estimators.numerics.autocorrelation import (
    compute_disjoint_window_residuals,
    estimate_pooled_autocorrelation,
)
from estimators.numerics.normal_equations import (
    compute_residual_sums_of_squares,
    extract_packed_gram,
    solve_packed_equations,
)
from estimators.numerics.reweighted import (
    AT_ONCE,
    copy_consecutive_estimates,
    copy_samples_to_buffer,
    fill_residuals_of_sample,
    find_begins_of_window_batches,
    sum_reweighted_products,
)
from estimators.numerics.rolling import (
    fill_sample_products,
    find_ends_of_accepted_windows,
    sum_window_products,
)
from estimators.numerics.sandwich import compute_all_window_stds, compute_one_window_stds
from estimators.numerics.small_systems import find_packed_index, solve_least_squares_by_svd
from estimators.threads import run_in_chunks


@dataclass(frozen=True, slots=True)
class HuberOptions:
    """c: residuals up to c·s have full weight; 1.345 keeps 95 % efficiency for Gaussian noise."""

    bend: float = 1.345


def fit(
    A: Floats, f: Floats, options: HuberOptions | None = None, autocorrelation: Floats | None = None
) -> Estimate:
    """Estimate one window.

    Args:
        A: (n, p) regressor, n > p.
        f: (n,) force.
        options: tuning constant of the weights.
        autocorrelation: (lags,) autocorrelation of the pseudo-residuals; estimated from this window
            if not given.
    """
    options = options or HuberOptions()
    first = ls.fit(A, f, autocorrelation=autocorrelation)
    theta = first.theta
    limit = options.bend * float(np.median(np.abs(f - A @ theta))) / 0.6745
    if limit == 0.0:
        return first
    for _ in range(LIMITS.reweighting_max_steps):
        residual = f - A @ theta
        root = np.sqrt(np.minimum(1.0, limit / np.maximum(np.abs(residual), limit)))
        following = solve_least_squares_by_svd(A * root[:, None], f * root)
        moved = np.abs(following - theta).max() / max(np.abs(following).max(), 1e-300)
        theta = following
        if moved < LIMITS.huber_tolerance:
            break
    residual = f - A @ theta
    pseudo = np.clip(residual, -limit, limit) / (np.abs(residual) <= limit).mean()
    std = compute_one_window_stds(A, A.T @ A, pseudo, autocorrelation)
    return Estimate(theta, std, float(np.sqrt((residual**2).mean())), first.condition)


class ResidualStatistics(NamedTuple):
    """Statistics of the residuals r of m solved windows, (m,) each.

    Attributes:
        limit: largest residual with full weight.
        kept: mean ψ', the fraction of samples with full weight.
        squares: Σ of squared pseudo-residuals ψ(r) / mean ψ'.
    """

    limit: Floats
    kept: Floats
    squares: Floats


def solve_windows_robustly(
    A: Floats, f: Floats, window: int, window_ends: Ints, products: Floats, options: HuberOptions
) -> tuple[Floats, ResidualStatistics]:
    """Solve windows with packed products (entries, rows); returns θ (p, rows) and statistics.

    Huber's loss is piecewise quadratic, so Newton's method reaches its minimum exactly, mostly
    within five steps; other windows are iteratively reweighted.
    """
    theta = solve_packed_equations(products).theta
    limit = (
        options.bend * compute_median_absolute_residuals(A, f, window, window_ends, theta) / 0.6745
    )
    left = np.flatnonzero(limit > 0.0)
    for step in range(LIMITS.newton_steps + LIMITS.reweighting_max_steps):
        if left.size == 0:
            break
        sums = sum_newton_equations if step < LIMITS.newton_steps else sum_reweighted_products
        now = theta[:, left]
        following = solve_packed_equations(
            sums(A, f, window, window_ends[left], now, limit[left], False)
        ).theta
        stuck = np.isnan(following).any(axis=0)
        theta[:, left] = following = np.where(stuck, now, following)
        moved = np.abs(following - now).max(axis=0)
        left = left[stuck | (moved > LIMITS.huber_tolerance * np.abs(following).max(axis=0))]
    kept, squares = summarise_clipped_residuals(A, f, window, window_ends, theta, limit)
    # without a limit nothing is clipped; at least one sample counts, if rounding leaves none
    kept = np.where(limit > 0.0, np.maximum(kept, 1.0 / window), 1.0)
    return theta, ResidualStatistics(limit, kept, squares / kept**2)


@compiled_unless_short_log
def compute_median_absolute_residuals(
    A: Floats, f: Floats, window: int, window_ends: Ints, theta: Floats
) -> Floats:
    """Median absolute residual of each window, (rows,)."""
    p = theta.shape[0]
    out = np.empty(window_ends.size)
    size = np.empty(window)
    for row in range(window_ends.size):
        first = window_ends[row] - window + 1
        for s in range(window):
            e = f[first + s]
            for c in range(p):
                e -= A[first + s, c] * theta[c, row]
            size[s] = abs(e)
        out[row] = np.median(size)
    return out


@compiled_unless_short_log
def sum_newton_equations(
    A: Floats,
    f: Floats,
    window: int,
    window_ends: Ints,
    theta: Floats,
    clipping_limit: Floats,
    _squared: bool,
) -> Floats:
    """Normal equations of a Newton step; samples above the limit add a constant force.

    Arguments and return value are those of `sum_reweighted_products`.
    """
    p = A.shape[1]
    entries = (p + 1) * (p + 2) // 2
    z = np.empty((p + 1, window + AT_ONCE))
    raw = np.empty((entries, window + AT_ONCE))
    pull, full = np.empty(AT_ONCE), np.empty(AT_ONCE)
    out = np.zeros((entries, window_ends.size))
    starts = find_begins_of_window_batches(window_ends)
    for number in range(starts.size - 1):
        start: int = starts[number]
        end: int = starts[number + 1]
        m = end - start
        copy_samples_to_buffer(A, f, window_ends[start] - window + 1, window + m - 1, z)
        fill_sample_products(z, window + m - 1, raw)
        now, bends = copy_consecutive_estimates(theta, start, end), clipping_limit[start:end]
        sums = np.zeros((entries, m))
        for s in range(window):
            fill_residuals_of_sample(z, s, now, pull)
            force = z[p, s : s + m]
            for k in range(m):
                inside = abs(pull[k]) <= bends[k]
                clipped = bends[k] if pull[k] > 0.0 else -bends[k]
                pull[k] = force[k] if inside else clipped
                full[k] = 1.0 if inside else 0.0
            for i in range(p):
                for j in range(i, p):
                    entry = find_packed_index(i, j, p + 1)
                    total, product = sums[entry], raw[entry, s : s + m]
                    for k in range(m):
                        total[k] += full[k] * product[k]
                total, column = sums[find_packed_index(i, p, p + 1)], z[i, s : s + m]
                for k in range(m):
                    total[k] += pull[k] * column[k]
        for entry in range(entries):
            total = sums[entry]
            for k in range(m):
                out[entry, start + k] = total[k]
    return out


@compiled_unless_short_log
def summarise_clipped_residuals(
    A: Floats, f: Floats, window: int, window_ends: Ints, theta: Floats, clipping_limit: Floats
) -> tuple[Floats, Floats]:
    """Fraction of |r| ≤ limit, and sum of clipped r², of each window, (rows,) each."""
    p = A.shape[1]
    z = np.empty((p + 1, window + AT_ONCE))
    e = np.empty(AT_ONCE)
    kept, squares = np.zeros(window_ends.size), np.zeros(window_ends.size)
    starts = find_begins_of_window_batches(window_ends)
    for number in range(starts.size - 1):
        start: int = starts[number]
        end: int = starts[number + 1]
        m = end - start
        copy_samples_to_buffer(A, f, window_ends[start] - window + 1, window + m - 1, z)
        now, bends = copy_consecutive_estimates(theta, start, end), clipping_limit[start:end]
        inside, square = kept[start:end], squares[start:end]
        for s in range(window):
            fill_residuals_of_sample(z, s, now, e)
            for k in range(m):
                size = abs(e[k])
                inside[k] += 1.0 if size <= bends[k] else 0.0
                size = size if size < bends[k] else bends[k]
                square[k] += size * size
    return kept / window, squares


def estimate_along_log(
    A: Floats, f: Floats, window: int, accepted: Bools, options: HuberOptions | None = None
) -> Trace:
    """Estimate every accepted window; row k equals `fit` of the `window` samples that end at k.

    Args:
        A: (n, p) regressor; rows outside accepted windows may be NaN.
        f: (n,) force.
        window: samples in a window.
        accepted: (n,) whether the window that ends here is used.
        options: tuning constant of the weights.
    """
    options = options or HuberOptions()
    index = find_ends_of_accepted_windows(accepted, window)
    p = A.shape[1]
    if index.size == 0:
        return Trace.empty(p)
    solved = ls.Windows.allocate_rows(index.size, p)
    statistics = ResidualStatistics(*(np.empty(index.size) for _ in ResidualStatistics._fields))

    def solve_rows(rows: slice) -> None:
        products = sum_window_products(A, f, window, index[rows])
        theta, of_rows = solve_windows_robustly(A, f, window, index[rows], products, options)
        solved.store_windows(
            rows,
            products,
            theta,
            extract_packed_gram(products),
            compute_residual_sums_of_squares(products, theta),
        )
        for whole, part in zip(statistics, of_rows, strict=True):
            whole[rows] = part

    run_in_chunks(solve_rows, index.size)
    residual, owner = compute_disjoint_window_residuals(A, f, solved.theta, index, window)
    used = owner >= 0
    row = owner[used]
    limit = statistics.limit[row]
    residual[used] = np.clip(residual[used], -limit, limit) / statistics.kept[row]
    correlation, _ = estimate_pooled_autocorrelation(residual, owner, A)
    std = compute_all_window_stds(A, solved.grams, statistics.squares, index, window, correlation)
    rms = np.sqrt(solved.rss / window)
    return Trace(index, solved.theta, std, rms, solved.condition, correlation)
