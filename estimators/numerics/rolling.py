"""Sums over sliding windows without drift: the two-scan algorithm (van Herk 1992, Gil-Werman 1993).

The log is cut into blocks of one window's length. Prefix sums run forward in each block, suffix
sums backward; the sum over any window is one suffix plus one prefix. Nothing is ever subtracted, so
sums neither drift over hours nor lose digits in an idle stretch, and a NaN affects only the windows
that contain it.

The summands are samples minus the last sample of the suffix's block, which every window of the pair
of blocks contains, and their products, so that a large mean costs no digits of a variance either.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.interpreted import compiled_unless_short_log, compiled_with_array_form
from estimators.numerics.small_systems import find_packed_index


def find_ends_of_accepted_windows(accepted: Bools, window: int) -> Ints:
    """Last samples of the accepted windows, ascending; incomplete windows are skipped."""
    ends = np.flatnonzero(accepted).astype(np.int64)
    return ends[ends >= window - 1]


class Workspace(NamedTuple):
    """Reusable arrays of a loop over pairs of blocks, for q columns of [A f].

    Attributes:
        z: (q, 2 window) samples of the two blocks, a row per column of [A f].
        centre: (q,) values subtracted from the samples.
        terms: (lanes, 2 window) summands: deviations, then their packed products.
        moments: (lanes, window) sums of the terms over the requested windows.
    """

    z: Floats
    centre: Floats
    terms: Floats
    moments: Floats


@compiled_unless_short_log
def count_padded_lanes(quantities: int) -> int:
    """Number of sums, rounded up to a multiple of three that run in parallel."""
    return -(-quantities // 3) * 3


@compiled_unless_short_log
def make_window_sum_workspace(q: int, window: int) -> Workspace:
    """Allocate the arrays for windows over q columns."""
    entries = q * (q + 1) // 2
    lanes = count_padded_lanes(q + entries)
    return Workspace(
        np.zeros((q, 2 * window)),
        np.empty(q),
        np.zeros((lanes, 2 * window)),
        np.empty((lanes, window)),
    )


def _fill_suffix_sums_vectorised(terms: Floats, count: int, sums: Floats) -> None:
    # added to 0, so that no zero is negative
    sums[:, :count] = 0.0 + np.cumsum(terms[: len(sums), :count][:, ::-1], axis=1)[:, ::-1]


@compiled_with_array_form(_fill_suffix_sums_vectorised)
def fill_suffix_sums(terms: Floats, count: int, sums: Floats) -> None:
    """Sums (lanes, ≥ count) of terms (lanes, ≥ count) from each term to the last of `count`."""
    for lane in range(0, sums.shape[0], 3):
        a, b, c = terms[lane, :count], terms[lane + 1, :count], terms[lane + 2, :count]
        x, y, z = sums[lane, :count], sums[lane + 1, :count], sums[lane + 2, :count]
        s = t = u = 0.0
        for back in range(count):
            k = count - 1 - back
            s += a[k]
            t += b[k]
            u += c[k]
            x[k] = s
            y[k] = t
            z[k] = u


def _add_prefix_sums_vectorised(
    terms: Floats, start: int, skip: int, count: int, sums: Floats
) -> None:
    end = max(start + skip + count - 1, start)
    added = np.hstack([np.zeros((len(sums), 1)), terms[: len(sums), start:end]])
    sums[:, :count] += np.cumsum(added, axis=1)[:, skip:]


@compiled_with_array_form(_add_prefix_sums_vectorised)
def add_prefix_sums(
    terms: Floats, start_sample: int, skipped_terms: int, count: int, sums: Floats
) -> None:
    """Add the `skipped_terms` + m terms from `start_sample` on to each sums[:, m], m < count."""
    for lane in range(0, sums.shape[0], 3):
        s = t = u = 0.0
        for k in range(start_sample, start_sample + skipped_terms):
            s += terms[lane, k]
            t += terms[lane + 1, k]
            u += terms[lane + 2, k]
        start = start_sample + skipped_terms
        a, b, c = terms[lane, start:], terms[lane + 1, start:], terms[lane + 2, start:]
        x, y, z = sums[lane], sums[lane + 1], sums[lane + 2]
        for k in range(count):
            x[k] += s
            y[k] += t
            z[k] += u
            s += a[k]
            t += b[k]
            u += c[k]


def _fill_sample_products_vectorised(z: Floats, count: int, products: Floats) -> None:
    i, j = np.triu_indices(len(z))
    products[: i.size, :count] = z[i, :count] * z[j, :count]


def _fill_centred_terms_vectorised(z: Floats, centre: Floats, count: int, terms: Floats) -> None:
    q = len(z)
    terms[:q, :count] = z[:, :count] - centre[:, None]
    _fill_sample_products_vectorised(terms[:q], count, terms[q:])


@compiled_with_array_form(_fill_centred_terms_vectorised)
def fill_centred_terms(z: Floats, centre: Floats, count: int, terms: Floats) -> None:
    """Deviations of `count` samples from the centre, and their products."""
    q = z.shape[0]
    for i in range(q):
        deviation, x = terms[i], z[i]
        for k in range(count):
            deviation[k] = x[k] - centre[i]
    fill_sample_products(terms[:q], count, terms[q:])


@compiled_with_array_form(_fill_sample_products_vectorised)
def fill_sample_products(z: Floats, count: int, products: Floats) -> None:
    """Products of the q rows of z at each of `count` samples, packed (entries, ≥ count)."""
    q = z.shape[0]
    for i in range(q):
        for j in range(i, q):
            product, x, y = products[find_packed_index(i, j, q)], z[i], z[j]
            for k in range(count):
                product[k] = x[k] * y[k]


def _convert_centred_moments_vectorised(
    moments: Floats, centre: Floats, window: int, first_window: int, end_window: int, out: Floats
) -> None:
    q, m = centre.size, end_window - first_window
    i, j = np.triu_indices(q)
    left, right = centre[i, None], centre[j, None]
    x, y, central = moments[i, :m], moments[j, :m], moments[q : q + i.size, :m]
    out[: i.size, first_window:end_window] = central + right * x + left * (window * right + y)


@compiled_with_array_form(_convert_centred_moments_vectorised)
def convert_centred_moments_to_products(
    moments: Floats, centre: Floats, window: int, first_window: int, end_window: int, out: Floats
) -> None:
    """Σ z_i z_j of windows row … end - 1, from their centred moments, into out (entries, rows)."""
    q = centre.size
    for i in range(q):
        for j in range(i, q):
            total, central = (
                out[find_packed_index(i, j, q), first_window:end_window],
                moments[q + find_packed_index(i, j, q)],
            )
            x, y = moments[i], moments[j]
            left, right = centre[i], centre[j]
            for k in range(end_window - first_window):
                total[k] = central[k] + right * x[k] + left * (window * right + y[k])


@compiled_unless_short_log
def copy_window_columns_to_buffer(A: Floats, first: int, rows: int, buffer: Floats) -> None:
    """Copy `rows` samples of A (n, p) into the buffer (≥ p, ≥ rows), a row per column."""
    samples = A[first : first + rows]
    for c in range(A.shape[1]):
        out = buffer[c]
        for k in range(rows):
            out[k] = samples[k, c]


@compiled_unless_short_log
def copy_force_samples(f: Floats, start: int, count: int, out: Floats) -> None:
    """Copy `count` samples from `start` on; a slice assignment would take longer to compile."""
    for k in range(count):
        out[k] = f[start + k]


@compiled_unless_short_log
def find_begins_of_block_pairs(window: int, window_ends: Ints) -> Ints:
    """First row of each pair of blocks, and the end of the last, (pairs + 1,)."""
    starts = np.empty(window_ends.size + 1, np.int64)
    pairs = 0
    beyond = -1
    for row in range(window_ends.size):
        if window_ends[row] >= beyond:
            beyond = (window_ends[row] - window + 1) // window * window + 2 * window - 1
            starts[pairs] = row
            pairs += 1
    starts[pairs] = window_ends.size
    return starts[: pairs + 1]


@compiled_unless_short_log
def store_sums_of_requested_rows(
    sums: Floats, window_ends: Ints, first_row: int, end_row: int
) -> None:
    """Move the sums of the requested windows to the front of `sums` (lanes, windows), in place."""
    if end_row - first_row < window_ends[end_row - 1] - window_ends[first_row] + 1:
        for lane in range(sums.shape[0]):
            kept = sums[lane]
            for m in range(end_row - first_row):
                kept[m] = kept[window_ends[first_row + m] - window_ends[first_row]]


@compiled_unless_short_log
def sum_moments_of_block_pair(
    A: Floats,
    f: Floats,
    window: int,
    window_ends: Ints,
    first_row: int,
    end_row: int,
    workspace: Workspace,
) -> None:
    """Compute the moments of the windows of some rows, which begin in one block, in `workspace`."""
    p = A.shape[1]
    start = window_ends[first_row] - window + 1
    samples = window_ends[end_row - 1] + 1 - start
    copy_window_columns_to_buffer(A, start, samples, workspace.z)
    copy_force_samples(f, start, samples, workspace.z[p])
    # what is left of the first block: its last sample is in every window
    left = window - start % window
    for c in range(p + 1):
        workspace.centre[c] = workspace.z[c, left - 1]
    fill_centred_terms(workspace.z, workspace.centre, samples, workspace.terms)
    fill_suffix_sums(workspace.terms, left, workspace.moments)
    add_prefix_sums(workspace.terms, left, window - left, samples - window + 1, workspace.moments)
    store_sums_of_requested_rows(workspace.moments, window_ends, first_row, end_row)


@compiled_unless_short_log
def sum_window_products(A: Floats, f: Floats, window: int, window_ends: Ints) -> Floats:
    """Sum the products of the columns of [A f] over windows.

    Args:
        A: (n, p) regressor.
        f: (n,) force.
        window: samples in a window.
        window_ends: (rows,) last samples of windows, ascending.

    Returns:
        (entries, rows) packed.
    """
    q = A.shape[1] + 1
    work = make_window_sum_workspace(q, window)
    out = np.empty((q * (q + 1) // 2, window_ends.size))
    pairs = find_begins_of_block_pairs(window, window_ends)
    for number in range(pairs.size - 1):
        row: int = pairs[number]
        end: int = pairs[number + 1]
        sum_moments_of_block_pair(A, f, window, window_ends, row, end, work)
        convert_centred_moments_to_products(work.moments, work.centre, window, row, end, out)
    return out
