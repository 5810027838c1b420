"""Trailing means inside groups: shorter at the start of a group, never across it."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.interpreted import compiled_with_array_form


def iter_group_runs(group: Ints) -> Iterator[tuple[int, int]]:
    """Yield the first sample of each run of one group, and the sample after its last."""
    starts = np.flatnonzero(np.diff(group)) + 1
    bounds = [0, *starts.tolist(), group.size] if group.size else []
    return pairwise(bounds)


def _average_groups_vectorised(
    columns: Floats, group: Ints, samples: int, rows: Ints, mean: Floats
) -> Ints:
    count = np.empty(rows.size, np.int64)
    for first, end in iter_group_runs(group):
        own = slice(*np.searchsorted(rows, (first, end)))
        after = rows[own] + 1 - first
        before = np.maximum(after - samples, 0)
        zero = np.zeros((1, len(columns)))
        total = np.cumsum(np.vstack([zero, columns[:, first:end].T]), axis=0)
        count[own] = after - before
        mean[own] = (total[after] - total[before]) / count[own, None]
    return count


@compiled_with_array_form(_average_groups_vectorised)
def fill_trailing_group_means(
    columns: Floats, group: Ints, samples: int, requested_rows: Ints, mean: Floats
) -> Ints:
    """Average each requested sample and up to `samples` - 1 before it in the same group.

    Args:
        columns: (p, n) values; ignored where the group is negative.
        group: (n,) group of each sample, negative for none.
        samples: largest number of samples in a mean.
        requested_rows: (m,) samples whose means are requested, ascending; all in groups.
        mean: (m, p) array to fill with the means; for a shift it has hundreds of megabytes.

    Returns:
        (m,) number of samples in each mean.
    """
    p, n = columns.shape
    count = np.empty(requested_rows.size, np.int64)
    # cumulative sums of the group only, so that rounding does not accumulate over the log; a ring
    # buffer of those that a mean still needs
    kept = samples + 1
    total = np.zeros((kept, p))
    start, at, now = 0, 0, 0
    for k in range(n):
        if group[k] < 0:
            start = k + 1
            continue
        if k == start or group[k] != group[k - 1]:
            start, now = k, 0
            total[0] = 0.0
        before, now = now, now + 1 if now + 1 < kept else 0
        for j in range(p):
            total[now, j] = total[before, j] + columns[j, k]
        if at < requested_rows.size and requested_rows[at] == k:
            held = min(samples, k + 1 - start)
            count[at] = held
            first = now - held if now >= held else now - held + kept
            for j in range(p):
                mean[at, j] = (total[now, j] - total[first, j]) / held
            at += 1
    return count
