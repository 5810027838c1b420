"""Trailing means inside groups: shorter at the start of a group, never across it."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.interpreted import compiled_with_array_form


def find_runs(group: Ints) -> Iterator[tuple[int, int]]:
    """First and end sample of each run of one group (n,)."""
    begins = np.flatnonzero(np.diff(group)) + 1
    bounds = [0, *begins.tolist(), group.size] if group.size else []
    return pairwise(bounds)


def _average_by_arrays(
    columns: Floats, group: Ints, samples: int, rows: Ints
) -> tuple[Floats, Ints]:
    mean, count = np.empty((rows.size, len(columns))), np.empty(rows.size, np.int64)
    for first, end in find_runs(group):
        own = slice(*np.searchsorted(rows, (first, end)))
        after = rows[own] + 1 - first
        before = np.maximum(after - samples, 0)
        zero = np.zeros((1, len(columns)))
        total = np.cumsum(np.vstack([zero, columns[:, first:end].T]), axis=0)
        count[own] = after - before
        mean[own] = (total[after] - total[before]) / count[own, None]
    return mean, count


@compiled_with_array_form(_average_by_arrays)
def trailing_group_means(
    columns: Floats, group: Ints, samples: int, rows: Ints
) -> tuple[Floats, Ints]:
    """Mean of each requested sample and up to `samples` - 1 before it in the same group.

    Args:
        columns: (p, n) values; ignored where the group is negative.
        group: (n,) group of each sample, negative for none.
        samples: maximum samples in a mean.
        rows: (m,) samples whose means are requested, ascending; all in groups.

    Returns:
        (m, p) means, and (m,) number of samples in each.
    """
    p, n = columns.shape
    mean, count = np.empty((rows.size, p)), np.empty(rows.size, np.int64)
    longest, begin = 0, 0
    for k in range(n):
        if group[k] < 0 or (k > 0 and group[k] != group[k - 1]):
            begin = k
        longest = max(longest, k + 1 - begin)
    # of the group so far, so that rounding does not add up over the log
    total = np.zeros((longest + 1, p))
    begin, at = 0, 0
    for k in range(n):
        if group[k] < 0:
            begin = k + 1
            continue
        if k > 0 and group[k] != group[k - 1]:
            begin = k
        i = k - begin
        for j in range(p):
            total[i + 1, j] = total[i, j] + columns[j, k]
        if at < rows.size and rows[at] == k:
            first = max(0, i + 1 - samples)
            count[at] = i + 1 - first
            for j in range(p):
                mean[at, j] = (total[i + 1, j] - total[first, j]) / count[at]
            at += 1
    return mean, count
