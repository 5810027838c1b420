"""Windows and runs of flagged rows."""

import numpy as np

from estimators.arrays import Bools, Ints


def flag_windows_with_flagged_rows(is_flagged: Bools, window: int) -> Bools:
    """Whether any of the `window` rows that end at each row is flagged, (rows,)."""
    count = np.cumsum(is_flagged)
    has_flag = count > 0
    has_flag[window:] = count[window:] > count[: max(count.size - window, 0)]
    return has_flag


def flag_rows_near_flagged_rows(is_flagged: Bools, after: int, before: int | None = None) -> Bools:
    """Whether each row is near a flagged one, (rows,).

    Args:
        is_flagged: (rows,) flags.
        after: number of rows from each flagged row on, itself included.
        before: number of rows up to each flagged row, itself included; None for `after`.
    """
    before = after if before is None else before
    later = flag_windows_with_flagged_rows(is_flagged, after)
    return later | flag_windows_with_flagged_rows(is_flagged[::-1], before)[::-1]


def mark_samples_in_accepted_windows(accepted: Bools, window: int) -> Bools:
    """Whether each row lies inside at least one accepted window, (rows,)."""
    # the windows that contain row k end at k … k + window - 1
    return flag_windows_with_flagged_rows(accepted[::-1], window)[::-1]


def find_flagged_runs(is_flagged: Bools) -> tuple[Ints, Ints]:
    """First and last sample of each run of flagged samples, (runs,) each."""
    edges = np.diff(np.concatenate([[0], is_flagged.astype(np.int8), [0]]))
    return np.flatnonzero(edges > 0), np.flatnonzero(edges < 0) - 1


def list_whole_blocks_of_runs(is_flagged: Bools, block_rows: int) -> list[slice]:
    """Successive blocks of `block_rows` samples that fit into the runs of flagged samples."""
    return [
        slice(start, start + block_rows)
        for first, last in zip(*find_flagged_runs(is_flagged), strict=True)
        for start in range(first, last + 2 - block_rows, block_rows)
    ]
