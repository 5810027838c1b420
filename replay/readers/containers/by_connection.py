"""Part messages by the connection that they belong to."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray


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
