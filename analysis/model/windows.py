"""Windows and runs of flagged rows."""

import numpy as np

from estimators.arrays import Bools, Ints


def flag_windows(flag: Bools, window: int) -> Bools:
    """Whether any of the `window` rows that end at each row is flagged, (rows,)."""
    count = np.concatenate([[0], np.cumsum(flag)])
    start = np.maximum(np.arange(flag.size) + 1 - window, 0)
    return count[1:] > count[start]


def mark_samples_in_windows(accepted: Bools, window: int) -> Bools:
    """Whether each row lies inside at least one accepted window, (rows,)."""
    # the windows that hold row k end at k … k + window - 1
    return flag_windows(accepted[::-1], window)[::-1]


def find_flagged_runs(flag: Bools) -> tuple[Ints, Ints]:
    """First and last sample of each run of flagged samples, (runs,) each."""
    edges = np.diff(np.concatenate([[0], flag.astype(np.int8), [0]]))
    return np.flatnonzero(edges > 0), np.flatnonzero(edges < 0) - 1
