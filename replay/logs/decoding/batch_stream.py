"""Feed batches to decoders: small batches are joined, large ones split.

Recorders write messages slightly out of order. Sorting a whole log would copy every column; here,
only rows of batches that overlap in time are sorted, and all others stay where they were decoded.
"""

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Final

import numpy as np
import polars as pl

from replay.logs.decoding.decoder import (
    DecodedBatch,
    Decoder,
    DecodeTally,
    Submit,
    run_work_immediately,
)
from replay.logs.decoding.gather_values import concatenate_byte_ranges
from replay.logs.messages.raw_batch import BATCH_BYTES, BATCH_ROWS, RawBatch

#: Number of messages below which the overhead of a batch exceeds the cost of joining it to others.
_FEW_ROWS: Final = 2048
#: Threads that decode: half of the cores, while the other half decompresses.
_WORKERS: Final = max(1, min(4, (os.cpu_count() or 1) // 2))


class TopicStream:
    """Batches of one topic, decoded and sorted by log time."""

    def __init__(self, decoder: Decoder, schema: pl.Schema) -> None:
        self.tally = DecodeTally()
        self._decoder = decoder
        self._empty = pl.DataFrame(schema=schema)
        self._frames = [self._empty]
        #: small batches kept until together they are worth the overhead of one
        self._few: list[RawBatch] = []
        self._rows = self._bytes = 0
        self._begun: list[Callable[[], DecodedBatch]] = []
        #: log time of the last message in ns, by connection: a slab holds several connections
        self._last: dict[int, int] = {}

    def submit_batch(self, batch: RawBatch, submit: Submit) -> None:
        """Start decoding the next messages; their memory may be reused after `finish_decoding`."""
        self._note_decreasing_times(batch)
        for part in batch.split_to_bounded_batches():
            if part.message_count < _FEW_ROWS:
                self._few.append(_copy_batch(part))
                self._rows += part.message_count
                self._bytes += self._few[-1].data.size
                if self._rows < BATCH_ROWS and self._bytes < BATCH_BYTES:
                    continue
            self._submit_small_batches_as_one(submit)
            if part.message_count >= _FEW_ROWS:
                self._submit_batch_of_any_size(part, submit)

    def finish_decoding(self) -> None:
        """Wait until the messages submitted so far are decoded."""
        for finish in self._begun:
            decoded = finish()
            self.tally.rows += decoded.frame.height
            self.tally.undecodable += decoded.undecodable
            self.tally.first_fault = self.tally.first_fault or decoded.first_fault
            if decoded.frame.height:
                self._frames.append(decoded.frame)
        self._begun.clear()

    def take_rows_before(self, later_log_time_ns: int) -> pl.DataFrame:
        """Remove and return the decoded rows whose order is final; call `finish_decoding` before.

        Args:
            later_log_time_ns: lower bound of the log times of later messages.
        """
        if not self.tally.rows:  # the first rows are not held back until they fill a batch
            self._submit_small_batches_as_one(run_work_immediately)
            self.finish_decoding()
        waiting = [int(batch.log_times.min()) for batch in self._few]
        frame = merge_sorted_frames(self._frames)
        if not frame.height:
            return frame
        ready = count_rows_until(frame, min([later_log_time_ns, *waiting]))
        if ready == frame.height:
            self._frames = [self._empty]
            return frame
        # slicing by brackets is slower than the search
        self._frames = [frame.slice(ready)]
        return frame.slice(0, ready)

    def drain_all_rows(self) -> pl.DataFrame:
        """Decode what is left, and return all remaining rows."""
        self._submit_small_batches_as_one(run_work_immediately)
        self.finish_decoding()
        frame = merge_sorted_frames(self._frames)
        self._frames.clear()
        return frame

    def _note_decreasing_times(self, batch: RawBatch) -> None:
        """Keep the largest decrease of log time in the tally, before the rows are sorted."""
        if batch.message_count:
            times = batch.log_times
            before = self._last.get(batch.connection_id, int(times[0]))
            back = (times[:-1] - times[1:]).max(initial=before - times[0])
            self.tally.back_ns = max(self.tally.back_ns, int(back))
            self._last[batch.connection_id] = int(times[-1])

    def _submit_small_batches_as_one(self, submit: Submit) -> None:
        """Start decoding the small batches kept so far, as one."""
        if self._few:
            self._submit_batch_of_any_size(_join_batches(self._few), submit)
            self._few, self._rows, self._bytes = [], 0, 0

    def _submit_batch_of_any_size(self, batch: RawBatch, submit: Submit) -> None:
        self._begun.append(self._decoder.begin_decoding(sort_batch_by_log_time(batch), submit))


def feed_batches_to_streams(
    batch_groups: Iterable[list[RawBatch]], stream_by_connection: Mapping[int, TopicStream]
) -> None:
    """Feed messages to streams; compiled work runs in other threads.

    Args:
        batch_groups: groups of batches in shared memory, which is reused for the next group.
        stream_by_connection: streams by connection; connections may share one.
    """
    with ThreadPoolExecutor(_WORKERS, thread_name_prefix="payscope-decode") as pool:
        for group in batch_groups:
            for batch in group:
                stream_by_connection[batch.connection_id].submit_batch(
                    batch, lambda work: pool.submit(work).result
                )
            for stream in dict.fromkeys(
                stream_by_connection[batch.connection_id] for batch in group
            ):
                stream.finish_decoding()


def iter_decoded_rows_of_streams(
    batch_groups: Iterable[tuple[list[RawBatch], int]],
    stream_by_connection: Mapping[int, TopicStream],
) -> Iterator[tuple[TopicStream, pl.DataFrame]]:
    """Decode like `feed_batches_to_streams`, and yield the rows whose order is final.

    Args:
        batch_groups: lists of batches, each with the lower bound of later log times.
        stream_by_connection: streams by connection; connections may share one.
    """
    distinct = list(dict.fromkeys(stream_by_connection.values()))
    with ThreadPoolExecutor(_WORKERS, thread_name_prefix="payscope-decode") as pool:
        for batches, floor_ns in batch_groups:
            for batch in batches:
                stream_by_connection[batch.connection_id].submit_batch(
                    batch, lambda work: pool.submit(work).result
                )
            for stream in distinct:
                stream.finish_decoding()
            for stream in distinct:
                ready = stream.take_rows_before(floor_ns)
                if ready.height:
                    yield stream, ready
    for stream in distinct:
        rest = stream.drain_all_rows()
        if rest.height:
            yield stream, rest


def _copy_batch(batch: RawBatch) -> RawBatch:
    """Copy the messages, since the container may reuse the memory."""
    data = concatenate_byte_ranges(batch.data, batch.offsets, batch.lengths)
    offsets = np.cumsum(batch.lengths) - batch.lengths
    return RawBatch(
        batch.connection_id, data, offsets, batch.lengths.copy(), batch.log_times.copy()
    )


def _join_batches(batches: list[RawBatch]) -> RawBatch:
    lengths = np.concatenate([batch.lengths for batch in batches])
    return RawBatch(
        batches[0].connection_id,
        np.concatenate([batch.data for batch in batches]),
        np.cumsum(lengths) - lengths,
        lengths,
        np.concatenate([batch.log_times for batch in batches]),
    )


TIME = "log_time_ns"


def sort_batch_by_log_time(batch: RawBatch) -> RawBatch:
    """Sort messages by log time without moving their bytes."""
    times = batch.log_times
    if (times[1:] >= times[:-1]).all():
        return batch
    return batch.select_messages(np.argsort(times, kind="stable"))


def merge_sorted_frames(frames: Iterable[pl.DataFrame]) -> pl.DataFrame:
    """Merge sorted frames; among rows of equal time those of earlier frames come first.

    Args:
        frames: at least one frame, all of one schema.
    """
    found = list(frames)
    placed: list[pl.DataFrame] = []
    for frame in filter(len, found):
        placed += merge_overlapping_rows(placed.pop(), frame) if placed else [frame]
    placed = placed or found[:1]
    whole = pl.concat(placed, rechunk=False) if len(placed) > 1 else placed[0]
    # a frame may begin before the frames preceding the last one
    return whole if whole[TIME].is_sorted() else whole.sort(TIME, maintain_order=True)


def count_rows_until(frame: pl.DataFrame, last_log_time_ns: int) -> int:
    """Number of rows of a sorted frame up to `last_log_time_ns`."""
    # the search of a polars series goes through its engine, which takes longer than all the rest
    return int(np.searchsorted(frame[TIME].to_numpy(), last_log_time_ns, side="right"))


def merge_overlapping_rows(first: pl.DataFrame, second: pl.DataFrame) -> list[pl.DataFrame]:
    """Split two sorted frames into consecutive parts, merging the rows that overlap in time."""
    start, end = second[TIME][0], first[TIME][-1]
    if start >= end:
        return [first, second]
    head = first[TIME].search_sorted(start, side="right")
    tail = second[TIME].search_sorted(end, side="left")
    between = pl.concat([first[head:], second[:tail]]).sort(TIME, maintain_order=True)
    return [part for part in (first[:head], between, second[tail:]) if part.height]
