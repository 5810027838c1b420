"""Shared code of recursive estimators: the order of samples, and discounted sums.

Sliding windows share samples, so each sample is fed once, over the union of the accepted windows:
first the whole first window, then after each accepted window the samples that it adds.
"""

from collections.abc import Iterator

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.interpreted import compiled_unless_short_log
from estimators.numerics.rolling import (
    copy_force_samples,
    copy_window_columns_to_buffer,
    count_padded_lanes,
    fill_sample_products,
)
from estimators.numerics.small_systems import find_packed_index
from estimators.threads import CHUNK

#: Consecutive samples that are processed together, so that their sums stay in the fastest cache.
_AT_ONCE = 512


@compiled_unless_short_log
def list_samples_fed_after_first_window(window_ends: Ints, window: int) -> tuple[Ints, Ints]:
    """Samples fed after the first window, (fed,), and their number up to each row, (rows,)."""
    rows = window_ends.size
    seen = np.zeros(rows, np.int64)
    for row in range(1, rows):
        new = min(window_ends[row] - window_ends[row - 1], window)
        seen[row] = seen[row - 1] + new
    fed = np.empty(seen[rows - 1], np.int64)
    for row in range(1, rows):
        for i in range(seen[row - 1], seen[row]):
            fed[i] = window_ends[row] + 1 - (seen[row] - i)
    return fed, seen


def iter_sample_chunks(fed_count: Ints) -> Iterator[tuple[slice, slice, Ints]]:
    """Split the samples fed after the first window into chunks.

    Args:
        fed_count: (rows,) number of samples fed up to each row.

    Yields:
        The samples of a chunk, the rows that end in it, and the sample of each row from its start.
    """
    for start in range(0, int(fed_count[-1]), CHUNK):
        end = min(start + CHUNK, int(fed_count[-1]))
        rows = slice(*np.searchsorted(fed_count, [start, end], side="right"))
        yield slice(start, end), rows, fed_count[rows] - 1 - start


@compiled_unless_short_log
def find_end_of_consecutive_samples(fed_samples: Ints, start: int) -> int:
    """End of the run of consecutive samples from index `start` on, of at most `_AT_ONCE`."""
    end = start + 1
    while (
        end < fed_samples.size
        and end - start < _AT_ONCE
        and fed_samples[end] == fed_samples[end - 1] + 1
    ):
        end += 1
    return end


@compiled_unless_short_log
def accumulate_discounted_sums(
    terms: Floats, start: int, end: int, forgetting: float, initial_sums: Floats, sums: Floats
) -> None:
    """Compute s ← λ s + term into sums (lanes, ≥ end) from `start` on; terms start at 0.

    `initial_sums` (lanes,) holds s before and after.
    """
    count = end - start
    for lane in range(0, initial_sums.size, 3):
        a, b, c = terms[lane, :count], terms[lane + 1, :count], terms[lane + 2, :count]
        x, y, z = sums[lane, start:end], sums[lane + 1, start:end], sums[lane + 2, start:end]
        s, t, u = initial_sums[lane], initial_sums[lane + 1], initial_sums[lane + 2]
        for k in range(count):
            s = forgetting * s + a[k]
            t = forgetting * t + b[k]
            u = forgetting * u + c[k]
            x[k] = s
            y[k] = t
            z[k] = u
        initial_sums[lane], initial_sums[lane + 1], initial_sums[lane + 2] = s, t, u


def pad_entries_to_lanes(entries: Floats) -> Floats:
    """Pad a packed matrix (entries,) with zeros to the lanes of a discounted sum."""
    past = np.zeros(count_padded_lanes(entries.size))
    past[: entries.size] = entries
    return past


@compiled_unless_short_log
def accumulate_discounted_meats(
    A: Floats,
    first_window: Floats,
    fed_samples: Ints,
    fed_count: Ints,
    first_window_end: int,
    forgetting: float,
    sum_decay: float,
    correlation: Floats,
    initial_meats: Floats,
) -> Floats:
    """Discounted Aᵀ R A of the past at each row: the covariance of the errors of Aᵀf.

    Args:
        A: (n, p) regressor.
        first_window: (window, p) regressor of the first window, which enters undiscounted.
        fed_samples: (fed,) samples fed after the first window.
        fed_count: (rows,) number of samples fed up to each row.
        first_window_end: last sample of the first window.
        forgetting: λ, weight of a sample relative to the next.
        sum_decay: decay of the sum per sample: λ², or λ for the weights' own sum.
        correlation: (lags,) residual autocorrelation, 1 first.
        initial_meats: (lanes,) packed sum of the first window; it is overwritten.

    Returns:
        (rows, entries) packed.
    """
    p = A.shape[1]
    entries = p * (p + 1) // 2
    lags = correlation.size
    fading = np.empty(lags)
    fading[0] = 1.0
    for lag in range(1, lags):
        fading[lag] = fading[lag - 1] * forgetting
    out = np.empty((fed_count.size, entries))
    for entry in range(entries):
        out[0, entry] = initial_meats[entry]
    z, near = np.empty((p, _AT_ONCE)), np.empty((p, _AT_ONCE))
    terms, sums = np.zeros((initial_meats.size, _AT_ONCE)), np.empty((initial_meats.size, _AT_ONCE))
    row = 1
    stretch = start = 0
    while start < fed_samples.size:
        if start > 0 and fed_samples[start] != fed_samples[start - 1] + 1:
            stretch = start
        end = find_end_of_consecutive_samples(fed_samples, start)
        count = end - start
        copy_window_columns_to_buffer(A, fed_samples[start], count, z)
        for c in range(p):
            total = near[c]
            for k in range(count):
                total[k] = 0.5 * z[c, k]
            for lag in range(1, min(lags, end - stretch)):
                skip = max(0, stretch + lag - start)
                r = correlation[lag] * fading[lag]
                before = A[fed_samples[start] + skip - lag : fed_samples[end - 1] - lag + 1]
                later = total[skip:]
                for k in range(count - skip):
                    later[k] += r * before[k, c]
        # near the start of a stretch, add earlier stretches and the first window
        for k in range(max(0, min(count, stretch + lags - start))):
            for back in range(start + k - stretch + 1, lags):
                i = start + k - back
                sample = fed_samples[i] if i >= 0 else first_window_end + 1 + i
                if fed_samples[start + k] - sample >= lags or i < -first_window.shape[0]:
                    break
                r = correlation[fed_samples[start + k] - sample] * fading[min(back, start + k + 1)]
                for c in range(p):
                    near[c, k] += r * (A[sample, c] if i >= 0 else first_window[i, c])
        for i in range(p):
            for j in range(i, p):
                term, x, y, u, v = terms[find_packed_index(i, j, p)], z[i], z[j], near[i], near[j]
                for k in range(count):
                    term[k] = x[k] * v[k] + u[k] * y[k]
        # a literal 0 would be compiled as a separate form
        accumulate_discounted_sums(terms, end - end, count, sum_decay, initial_meats, sums)
        while row < fed_count.size and fed_count[row] <= end:
            for entry in range(entries):
                out[row, entry] = sums[entry, fed_count[row] - 1 - start]
            row += 1
        start = end
    return out


@compiled_unless_short_log
def accumulate_discounted_products(
    A: Floats, f: Floats, fed_samples: Ints, forgetting: float, running_products: Floats
) -> Floats:
    """Discounted products (lanes, fed) of the columns of [A f] after each sample fed.

    Args:
        A: (n, p) regressor.
        f: (n,) force.
        fed_samples: (fed,) the samples, ascending.
        forgetting: λ.
        running_products: (lanes,) packed sums before and after.
    """
    q = A.shape[1] + 1
    z, terms = np.empty((q, _AT_ONCE)), np.zeros((running_products.size, _AT_ONCE))
    sums = np.empty((running_products.size, fed_samples.size))
    start = 0
    while start < fed_samples.size:
        end = find_end_of_consecutive_samples(fed_samples, start)
        count = end - start
        copy_window_columns_to_buffer(A, fed_samples[start], count, z)
        copy_force_samples(f, fed_samples[start], count, z[q - 1])
        fill_sample_products(z, count, terms)
        accumulate_discounted_sums(terms, start, end, forgetting, running_products, sums)
        start = end
    return sums


@compiled_unless_short_log
def count_discounted_samples(new_samples: int, forgetting: float, initial_count: float) -> Floats:
    """Discounted number of samples after each of `new_samples` further ones."""
    out = np.empty(new_samples)
    for k in range(new_samples):
        initial_count = forgetting * initial_count + 1.0
        out[k] = initial_count
    return out
