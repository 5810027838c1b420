"""Rows into the order of their log times, where they are nearly in it.

Recorders write messages a little out of order. Sorting a whole log for that would copy every
column; here only the rows that meet others are moved, and all else stays where it was decoded.
"""

from collections.abc import Iterable

import numpy as np
import polars as pl

from replay.messages.batch import RawBatch

TIME = "log_time_ns"


def sorted_batch(batch: RawBatch) -> RawBatch:
    """The same messages by their log times; the bytes stay where they are."""
    times = batch.log_times
    if (times[1:] >= times[:-1]).all():
        return batch
    return batch.select(np.argsort(times, kind="stable"))


def joined_frames(frames: Iterable[pl.DataFrame]) -> pl.DataFrame:
    """One frame of several that are each in order; of rows at one time the earlier frame's first.

    Args:
        frames: of one schema, at least one.
    """
    found = list(frames)
    placed: list[pl.DataFrame] = []
    for frame in filter(len, found):
        placed += _meeting(placed.pop(), frame) if placed else [frame]
    whole = pl.concat(placed or found[:1], rechunk=False)
    # a frame that begins before those in front of the last
    return whole if whole[TIME].is_sorted() else whole.sort(TIME, maintain_order=True)


def _meeting(first: pl.DataFrame, second: pl.DataFrame) -> list[pl.DataFrame]:
    """Two frames in parts that follow each other: where their times overlap the rows are merged."""
    begin, end = second[TIME][0], first[TIME][-1]
    if begin >= end:
        return [first, second]
    head = first[TIME].search_sorted(begin, side="right")
    tail = second[TIME].search_sorted(end, side="left")
    between = pl.concat([first[head:], second[:tail]]).sort(TIME, maintain_order=True)
    return [part for part in (first[:head], between, second[tail:]) if part.height]
