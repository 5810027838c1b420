"""Part messages by the connection that they belong to."""

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

#: Recorders number connections from 0 on, and counting small numbers needs no sorting.
_SMALL: Final = 2**16


def by_connection(keys: NDArray[np.int64]) -> Iterator[tuple[int, NDArray[np.intp]]]:
    """Which of `keys` (n,) are which connection, in their order; negative ones are none."""
    order = np.argsort(keys, kind="stable")
    ordered = keys[order]
    bounds = [*np.flatnonzero(np.diff(ordered)) + 1, ordered.size]
    begin = int(np.searchsorted(ordered, 0))
    for end in bounds:
        if end > begin:
            yield int(ordered[begin]), order[begin:end]
            begin = end


def count_by_connection(keys: NDArray[np.int64]) -> dict[int, int]:
    """How many of `keys` (n,) are of which connection."""
    if keys.max(initial=0) >= _SMALL:
        return {key: at.size for key, at in by_connection(keys)}
    counts = np.bincount(keys[keys >= 0])
    return {int(key): int(counts[key]) for key in np.flatnonzero(counts)}
