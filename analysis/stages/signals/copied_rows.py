"""Rows that a logger wrote twice: they repeat earlier ones to the last digit.

Noise does not repeat. A hash of each row's noisy readings, summed over a window of rows, is equal
at two places only if the same buffer was written twice. The hash of a row decides whether a window
begins at it, so that a copy has the same windows as its original wherever it begins.
"""

from collections.abc import Mapping
from typing import Final

import numpy as np
import numpy.typing as npt
import polars as pl

from analysis.model.physical_units import NS_PER_S
from analysis.model.windows import find_flagged_runs
from analysis.stages.signals.signal_limits import LIMITS
from estimators.arrays import Floats, Ints

Hashes = npt.NDArray[np.uint64]
#: First and last row of a copy, and the first row of its original.
Copy = tuple[int, int, int]

#: Columns of a topic that are no readings.
_STAMPS: Final = ("log_time_ns", "header_stamp_ns")
_ODD: Final = np.uint64(0x9E3779B97F4A7C15)
_SHIFT: Final = np.uint64(29)


def find_copied_rows_by_topic(raw_frames: Mapping[str, pl.DataFrame]) -> dict[str, list[Copy]]:
    """Find the rows of each topic that repeat earlier ones; topics without any are absent.

    Args:
        raw_frames: frames by topic, with log times.
    """
    found = {
        topic: find_copied_stretches(
            frame["log_time_ns"].to_numpy(), select_readings_with_noise(frame)
        )
        for topic, frame in raw_frames.items()
    }
    return {topic: copies for topic, copies in found.items() if copies}


def drop_copied_rows(
    raw_frames: Mapping[str, pl.DataFrame], copies_by_topic: Mapping[str, list[Copy]]
) -> dict[str, pl.DataFrame]:
    """Drop the rows of each topic that repeat earlier ones; the rows in their place are lost."""
    found = dict(raw_frames)
    for topic, copies in copies_by_topic.items():
        kept = np.ones(raw_frames[topic].height, np.bool_)
        for start, end, _ in copies:
            kept[start : end + 1] = False
        found[topic] = raw_frames[topic].filter(kept)
    return found


def list_copied_row_notes(copies_by_topic: Mapping[str, list[Copy]]) -> list[str]:
    """Notes on topics whose copied rows are left out."""
    return [
        f"{topic}: {sum(end - start + 1 for start, end, _ in copies):,} rows repeat earlier ones "
        "to the last digit and are left out, as rows that were not recorded"
        for topic, copies in copies_by_topic.items()
    ]


def find_copied_stretches(stamps_ns: Ints, columns: list[Floats]) -> list[Copy]:
    """Find the stretches of rows that equal earlier rows.

    Args:
        stamps_ns: (n,) stamps in ns.
        columns: (n,) noisy readings of each channel.

    Returns:
        First and last row of each copy, and the first row of its original.
    """
    if not columns or stamps_ns.size < 2 * LIMITS.copy_min_rows:
        return []
    rows = hash_rows(columns)
    found: list[Copy] = []
    for distance in _find_copy_distances(rows):
        starts, ends = find_flagged_runs(rows[distance:] == rows[:-distance])
        long = ends - starts + 1 >= LIMITS.copy_min_rows
        for start, end in zip(starts[long].tolist(), ends[long].tolist(), strict=True):
            first, last = start + distance, end + distance
            if (
                stamps_ns[last] - stamps_ns[first] < LIMITS.copy_min_s * NS_PER_S
                or stamps_ns[first] <= stamps_ns[end]
            ):
                continue
            readings = max(np.unique(x[first : last + 1]).size for x in columns)
            apart = all(last < b or first > e for b, e, _ in found)
            if readings >= LIMITS.copy_min_readings and apart:
                found.append((first, last, start))
    return sorted(found)


def select_readings_with_noise(frame: pl.DataFrame) -> list[Floats]:
    """Readings of the columns with noise, which differ between any two stretches."""
    found: list[Floats] = []
    for name in frame.columns:
        if name in _STAMPS or not frame.schema[name].is_numeric():
            continue
        x = frame[name].cast(pl.Float64).fill_null(np.nan).to_numpy()
        if _do_readings_turn_back_like_noise(x):
            found.append(x)
    return found


def _do_readings_turn_back_like_noise(readings: Floats) -> bool:
    """Whether readings reverse their change as often as noise does."""
    if readings.size > LIMITS.noise_blocks * LIMITS.noise_block_rows:
        blocks = readings[
            : readings.size // LIMITS.noise_block_rows * LIMITS.noise_block_rows
        ].reshape(-1, LIMITS.noise_block_rows)
        readings = blocks[:: -(-len(blocks) // LIMITS.noise_blocks)].ravel()
    step = np.sign(np.diff(readings))
    turns = step[1:] * step[:-1]
    return bool(
        (turns < 0.0).sum()
        > LIMITS.noise_turn_fraction * max(int((turns != 0.0).sum()), LIMITS.copy_min_rows)
    )


def hash_rows(columns: list[Floats]) -> Hashes:
    """Hash of each row, (n,)."""
    rows = np.zeros(columns[0].size, np.uint64)
    for x in columns:
        rows ^= np.ascontiguousarray(x).view(np.uint64)
        rows *= _ODD
        rows ^= rows >> _SHIFT
    rows *= _ODD
    rows ^= rows >> _SHIFT
    return rows


def _find_copy_distances(row_hashes: Hashes) -> list[int]:
    """Distances in rows between windows with equal hashes, the most frequent first."""
    differs = np.concatenate([[0], np.cumsum(row_hashes[1:] != row_hashes[:-1])])
    count = row_hashes.size - LIMITS.copy_window_rows + 1
    starts = np.flatnonzero(row_hashes[:count] % np.uint64(LIMITS.copy_window_spacing_rows) == 0)
    starts = starts[
        differs[starts + LIMITS.copy_window_rows - 1] - differs[starts]
        >= LIMITS.copy_window_min_changes
    ]
    windows = np.zeros(starts.size, np.uint64)
    for k in range(LIMITS.copy_window_rows):
        windows *= _ODD
        windows += row_hashes[starts + k]
    order = np.argsort(windows, kind="stable")
    same = windows[order[1:]] == windows[order[:-1]]
    distances = starts[order[1:][same]] - starts[order[:-1][same]]
    values, times = np.unique(distances, return_counts=True)
    return [
        int(each) for each in values[np.argsort(-times, kind="stable")][: LIMITS.copy_max_distances]
    ]
