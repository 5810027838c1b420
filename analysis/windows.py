"""Which windows hold a flagged row, and which rows lie inside a flagged window."""

import numpy as np
from numpy.typing import NDArray

Bools = NDArray[np.bool_]


def windows_with(flag: Bools, window: int) -> Bools:
    """Whether any of the `window` rows that end at each row is flagged (fewer at the start)."""
    count = np.concatenate([[0], np.cumsum(flag)])
    start = np.maximum(np.arange(flag.size) + 1 - window, 0)
    return count[1:] > count[start]


def samples_of(accepted: Bools, window: int) -> Bools:
    """Whether each row lies inside at least one accepted window."""
    # the windows that hold row k end at k … k + window - 1
    return windows_with(accepted[::-1], window)[::-1]
