"""Standard deviations under correlated residuals: G⁻¹ (Aᵀ R A) G⁻¹ s², R from pooled lags.

The window's own residuals give the scale: E[RSS] = s² (n - tr(G⁻¹ Aᵀ R A)), so that s² is unbiased
for correlated residuals as well. R = I gives the textbook formula. With few residuals the standard
deviation is increased, so that ±1.96 of it cover 95 %
(`autocorrelation.compute_std_widening_factor`).
"""

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.interpreted import compiled_unless_short_log, compiled_with_array_form
from estimators.numerics.autocorrelation import (
    compute_std_widening_factor,
    estimate_pooled_autocorrelation,
)
from estimators.numerics.in_order import sum_axis_in_order
from estimators.numerics.normal_equations import count_columns_of_packed_products
from estimators.numerics.rolling import (
    add_prefix_sums,
    copy_window_columns_to_buffer,
    count_padded_lanes,
    fill_suffix_sums,
    find_begins_of_block_pairs,
    store_sums_of_requested_rows,
)
from estimators.numerics.small_systems import (
    factor_packed_ldl,
    find_packed_index,
    invert_factored_systems,
    pack_symmetric_matrix,
)
from estimators.threads import run_in_chunks

#: Rows that are processed at once, so that they stay in the nearest cache.
_MEAT_ROWS = 1024


def _compute_sandwich_meat_vectorised(
    A: Floats, group: Ints, group_number: int, first: int, last: int, correlation: Floats
) -> Floats:
    lags = correlation.size
    start = first - (lags - 1)
    own = np.zeros((A.shape[1], last + 1 - start))
    mine = group[max(start, 0) : last + 1] == group_number
    own[:, max(-start, 0) :] = np.where(mine, A[max(start, 0) : last + 1].T, 0.0)
    here, tails = own[:, lags - 1 :], np.empty((len(own), last + 1 - first))
    for column, tail in zip(own, tails, strict=True):
        _add_predecessors_vectorised(column, correlation, tail)
    products = here[:, None] * tails + tails[:, None] * here
    B = sum_axis_in_order(products, 2)
    return np.tril(B) + np.tril(B, -1).T


@compiled_with_array_form(_compute_sandwich_meat_vectorised)
def compute_sandwich_meat(
    A: Floats, group: Ints, group_number: int, first: int, last: int, correlation: Floats
) -> Floats:
    """Aᵀ R A, (p, p), over the samples first … last of group `group_number`.

    Each sample is paired with itself and earlier ones of its group, including those before `first`.
    """
    lags = correlation.size
    # columns of 0 add nothing: a start forwards has no terms of reverse driving
    used = find_nonzero_columns(A, group, group_number, max(first - (lags - 1), 0), last)
    p = used.size
    B = np.zeros((p, p))
    most = min(_MEAT_ROWS, last + 1 - first)
    columns, tail = np.empty((p, most + lags - 1)), np.empty(most)
    # a row at a time, so that the products of one are side by side
    here, tails = np.empty((most, p)), np.empty((most, p))
    for start in range(first, last + 1, _MEAT_ROWS):
        rows = min(_MEAT_ROWS, last + 1 - start)
        copy_columns_of_group(A, group, group_number, start - (lags - 1), used, columns)
        for k in range(rows):
            here[k] = columns[:, lags - 1 + k]
        for c in range(p):
            add_correlated_predecessors(columns[c], correlation, tail[:rows])
            tails[:rows, c] = tail[:rows]
        # four rows of each sum between loading and storing it, in their order
        for k in range(0, rows - 3, 4):
            h0, h1, h2, h3 = here[k], here[k + 1], here[k + 2], here[k + 3]
            t0, t1, t2, t3 = tails[k], tails[k + 1], tails[k + 2], tails[k + 3]
            for i in range(p):
                own_sums = B[i]
                for c in range(i + 1):
                    total = own_sums[c] + (h0[i] * t0[c] + t0[i] * h0[c])
                    total += h1[i] * t1[c] + t1[i] * h1[c]
                    total += h2[i] * t2[c] + t2[i] * h2[c]
                    own_sums[c] = total + (h3[i] * t3[c] + t3[i] * h3[c])
        for k in range(rows - rows % 4, rows):
            for i in range(p):
                mine, its = here[k, i], tails[k, i]
                for c in range(i + 1):
                    B[i, c] += mine * tails[k, c] + its * here[k, c]
    out = np.zeros((A.shape[1], A.shape[1]))
    for i in range(p):
        for c in range(i + 1):
            out[used[i], used[c]] = out[used[c], used[i]] = B[i, c]
    return out


@compiled_unless_short_log
def find_nonzero_columns(A: Floats, group: Ints, group_number: int, first: int, last: int) -> Ints:
    """Columns of A (n, p) that are not 0 in every sample first … last of a group, ascending."""
    is_nonzero = np.zeros(A.shape[1], np.bool_)
    for c in range(A.shape[1]):
        k = first
        while k <= last and (group[k] != group_number or A[k, c] == 0.0):
            k += 1
        is_nonzero[c] = k <= last
    return np.flatnonzero(is_nonzero)


@compiled_unless_short_log
def copy_columns_of_group(
    A: Floats, group: Ints, group_number: int, first: int, used: Ints, columns: Floats
) -> None:
    """Copy some columns of A (n, p) from sample `first` on into rows, with 0 outside the group."""
    for k in range(columns.shape[1]):
        at = first + k
        is_inside = 0 <= at < group.size and group[at] == group_number
        for c in range(used.size):
            columns[c, k] = A[at, used[c]] if is_inside else 0.0


def _add_predecessors_vectorised(own: Floats, correlation: Floats, tail: Floats) -> None:
    """Half of each sample, and its correlated predecessors, by whole arrays."""
    lags, rows = correlation.size, tail.size
    tail[:] = 0.5 * own[lags - 1 : lags - 1 + rows]
    for j in range(1, lags):
        tail += correlation[j] * own[lags - 1 - j : lags - 1 - j + rows]


@compiled_with_array_form(_add_predecessors_vectorised)
def add_correlated_predecessors(own: Floats, correlation: Floats, tail: Floats) -> None:
    """Add half of each sample and its correlated predecessors.

    Args:
        own: samples; the first `correlation.size` - 1 are only predecessors.
        correlation: (lags,) autocorrelation, 1 first.
        tail: (rows,) output.
    """
    lags, rows = correlation.size, tail.size
    for k in range(rows):
        tail[k] = 0.5 * own[lags - 1 + k]
    # eight lags of each sum between loading and storing it, in their order
    for j in range(1, lags - 7, 8):
        c0, c1, c2, c3 = correlation[j : j + 4]
        c4, c5, c6, c7 = correlation[j + 4 : j + 8]
        before = own[lags - 8 - j :]
        for k in range(rows):
            total = tail[k] + c0 * before[k + 7]
            total += c1 * before[k + 6]
            total += c2 * before[k + 5]
            total += c3 * before[k + 4]
            total += c4 * before[k + 3]
            total += c5 * before[k + 2]
            total += c6 * before[k + 1]
            tail[k] = total + c7 * before[k]
    for j in range(lags - (lags - 1) % 8, lags):
        before = own[lags - 1 - j :]
        for k in range(rows):
            tail[k] += correlation[j] * before[k]


def compute_sandwich_stds(G: Floats, B: Floats, rss: float, samples: float) -> Floats:
    """(p,) standard deviations from AᵀA, AᵀRA and the residual sum of squares.

    They are at least the textbook's, since a tapered correlation may not be positive definite.
    """
    meats = pack_symmetric_matrix(B).reshape(-1, 1)
    return compute_larger_of_sandwich_and_textbook_stds(
        invert_packed_gram_matrices(pack_symmetric_matrix(G).reshape(1, -1)),
        meats,
        np.array([rss]),
        samples,
    )[:, 0]


def compute_one_window_stds(
    A: Floats, gram: Floats, residual: Floats, autocorrelation: Floats | None
) -> Floats:
    """Standard deviations of one window's estimate, (p,), in a readable form.

    Args:
        A: (n, p) regressor.
        gram: (p, p) AᵀA or its equivalent.
        residual: (n,) residuals, or pseudo-residuals of a robust fit.
        autocorrelation: (lags,) autocorrelation of the residuals; estimated from them if None.
    """
    one = np.zeros(residual.size, np.int64)
    if autocorrelation is None:
        autocorrelation, _ = estimate_pooled_autocorrelation(residual, one, A)
    B = compute_sandwich_meat(A, one, 0, 0, residual.size - 1, autocorrelation)
    std = compute_sandwich_stds(gram, B, float(residual @ residual), float(residual.size))
    return std * compute_std_widening_factor(residual.size, autocorrelation)


def compute_all_window_stds(
    A: Floats, grams: Floats, rss: Floats, window_ends: Ints, window: int, correlation: Floats
) -> Floats:
    """Standard deviations of windowed estimates.

    Args:
        A: (n, p) regressor.
        grams: (rows, p(p+1)/2) packed AᵀA of each window, or its equivalent.
        rss: (rows,) residual sum of squares of each window.
        window_ends: (rows,) last sample of each window.
        window: samples in a window.
        correlation: (lags,) residual autocorrelation, 1 first; at most half a window of lags.

    Returns:
        (rows, p) standard deviations.
    """
    out = np.empty((window_ends.size, A.shape[1]))

    def fill_rows(rows: slice) -> None:
        meats = compute_window_meats(A, window, window_ends[rows], correlation)
        out[rows] = compute_larger_of_sandwich_and_textbook_stds(
            invert_packed_gram_matrices(grams[rows]), meats, rss[rows], window
        ).T

    run_in_chunks(fill_rows, window_ends.size)
    return out * compute_std_widening_factor(window, correlation)


def invert_packed_gram_matrices(packed_grams: Floats) -> Floats:
    """Inverses (p, p, m) of packed matrices (m, entries)."""
    p = count_columns_of_packed_products(packed_grams.T)
    return invert_factored_systems(*factor_packed_ldl(np.ascontiguousarray(packed_grams.T), p, p))


def compute_larger_of_sandwich_and_textbook_stds(
    bread: Floats, meats: Floats, rss: Floats, samples: float
) -> Floats:
    """Larger of the sandwich and the textbook standard deviation of each parameter, (p, m).

    Args:
        bread: (p, p, m) inverses G⁻¹.
        meats: (entries, m) packed AᵀRA.
        rss: (m,) residual sums of squares.
        samples: samples of a window.
    """
    p = len(bread)
    degrees_of_freedom = samples - compute_product_traces(bread, meats)
    degrees_of_freedom = np.where(degrees_of_freedom > 0.5, degrees_of_freedom, np.nan)
    cover = rss / degrees_of_freedom * compute_sandwich_variances(bread, meats)
    textbook = rss / max(samples - p, 1.0) * np.array([bread[i, i] for i in range(p)])
    return np.sqrt(np.where(cover > textbook, cover, textbook + 0.0 * degrees_of_freedom))


def compute_product_traces(bread: Floats, meats: Floats) -> Floats:
    """Traces tr(G⁻¹ M), (m,)."""
    p = len(bread)
    total = np.zeros(meats.shape[1])
    for i in range(p):
        for j in range(p):
            total += bread[i, j] * meats[find_packed_index(min(i, j), max(i, j), p)]
    return total


def compute_sandwich_variances(bread: Floats, meats: Floats) -> Floats:
    """Diagonals (p, m) of G⁻¹ M G⁻¹, from inverses (p, p, m) and packed M (entries, m)."""
    p = len(bread)
    out = np.zeros((p, meats.shape[1]))
    for i in range(p):
        for r in range(p):
            for c in range(p):
                out[i] += (
                    bread[i, r] * bread[i, c] * meats[find_packed_index(min(r, c), max(r, c), p)]
                )
    return out


@compiled_unless_short_log
def compute_window_meats(A: Floats, window: int, window_ends: Ints, correlation: Floats) -> Floats:
    """Aᵀ R A of windows of any length, packed (entries, rows).

    The pairs of correlated samples inside a window are those inside its part of the first block,
    those inside its part of the second, and those across; the latter are counted with the longer
    part. So they are sums of two scans as well (see `estimators.numerics.rolling`).
    """
    p = A.shape[1]
    entries = p * (p + 1) // 2
    lanes = count_padded_lanes(entries)
    z = np.zeros((p, 2 * window))
    near = np.zeros((p, 2 * window))
    terms = np.zeros((lanes, 2 * window))
    sums = np.empty((lanes, window))
    out = np.empty((entries, window_ends.size))
    pairs = find_begins_of_block_pairs(window, window_ends)
    for number in range(pairs.size - 1):
        row: int = pairs[number]
        end: int = pairs[number + 1]
        last = window_ends[row] - (window_ends[row] + 1) % window
        # the windows that have more of the first block, then those that have more of the second
        middle = row
        while middle < end and window_ends[middle] <= last + window // 2:
            middle += 1
        for begin, stop in ((row, middle), (middle, end)):
            if stop > begin:
                start = window_ends[begin] - window + 1
                samples = window_ends[stop - 1] + 1 - start
                left = last + 1 - start
                copy_window_columns_to_buffer(A, start, samples, z)
                sum_correlated_neighbours(z, samples, left, 2 * left >= window, correlation, near)
                for i in range(p):
                    for j in range(i, p):
                        term, x, y, u, v = (
                            terms[find_packed_index(i, j, p)],
                            z[i],
                            z[j],
                            near[i],
                            near[j],
                        )
                        for k in range(samples):
                            term[k] = x[k] * y[k] + (x[k] * v[k] + u[k] * y[k])
                fill_suffix_sums(terms, left, sums)
                add_prefix_sums(terms, left, window - left, samples - window + 1, sums)
                store_sums_of_requested_rows(sums, window_ends, begin, stop)
                for entry in range(entries):
                    total = sums[entry]
                    for k in range(stop - begin):
                        out[entry, begin + k] = total[k]
    return out


def _sum_correlated_neighbours_vectorised(
    z: Floats,
    samples: int,
    first_block_samples: int,
    count_across_at_later: bool,
    correlation: Floats,
    neighbour_sums: Floats,
) -> None:
    """Correlated neighbours of each sample, by whole arrays."""
    neighbour_sums[:, :samples] = 0.0
    for lag in range(1, min(correlation.size, samples)):
        stop = max(
            first_block_samples - lag
            if count_across_at_later
            else min(first_block_samples, samples - lag),
            0,
        )
        neighbour_sums[:, :stop] += correlation[lag] * z[:, lag : lag + stop]
        starts = first_block_samples if count_across_at_later else first_block_samples + lag
        neighbour_sums[:, starts:samples] += (
            correlation[lag] * z[:, starts - lag : max(samples - lag, 0)]
        )


@compiled_with_array_form(_sum_correlated_neighbours_vectorised)
def sum_correlated_neighbours(
    z: Floats,
    samples: int,
    first_block_samples: int,
    count_across_at_later: bool,
    correlation: Floats,
    neighbour_sums: Floats,
) -> None:
    """Sum the correlated neighbours of each sample, counting each pair once.

    A pair in the second block counts at its later sample, one in the first block at its earlier
    sample, and one across at the later sample if `count_across_at_later`.
    """
    for c in range(z.shape[0]):
        for k in range(samples):
            neighbour_sums[c, k] = 0.0
        for lag in range(1, min(correlation.size, samples)):
            r = correlation[lag]
            stop = (
                first_block_samples - lag
                if count_across_at_later
                else min(first_block_samples, samples - lag)
            )
            total, x = neighbour_sums[c], z[c, lag:]
            for k in range(stop):
                total[k] += r * x[k]
            starts = first_block_samples if count_across_at_later else first_block_samples + lag
            total, x = neighbour_sums[c, starts:], z[c, starts - lag :]
            for k in range(samples - starts):
                total[k] += r * x[k]


def compute_recursive_sandwich_stds(grams: Floats, meats: Floats, white_meats: Floats) -> Floats:
    """Roots of diag G⁻¹ M G⁻¹, (rows, p), for unit variance; at least those of `white_meats`.

    Args:
        grams: (rows, entries) packed G.
        meats: (rows, entries) packed M; a tapered correlation may make it indefinite.
        white_meats: (rows, entries) packed M of uncorrelated residuals.
    """
    bread = invert_packed_gram_matrices(grams)
    squares = np.maximum(
        compute_sandwich_variances(bread, meats.T), compute_sandwich_variances(bread, white_meats.T)
    )
    # columns that are dependent to rounding determine nothing
    return np.sqrt(np.where(squares > 0.0, squares, np.nan)).T
