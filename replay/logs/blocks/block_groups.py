"""Unpack groups of blocks in parallel, ahead of the consumer, and find their records.

Messages of a group are selected by connection and log time, and the messages of each chunk counted.
"""

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Ints
from estimators.interpreted import compiled
from replay.logs.blocks.block import Block, DamagedBlockError, unpack_block_into
from replay.logs.messages.raw_batch import RawBatch
from replay.logs.storage import KEY, LARGEST_BYTES, LENGTH, OFFSET, TIME, FileBytes

#: Number of rows found, and offset of the first incomplete record.
CountAndStop: TypeAlias = tuple[int, int]
#: (data, begin, end, rows, row) -> (rows found, offset of the first incomplete record):
#: scan [begin, end) of a group, and fill rows from `row` on, as many as there is room for.
Scan = Callable[
    [NDArray[np.uint8], int, int, NDArray[np.int64], int],
    CountAndStop,
]
#: (data, begin, end, limit) -> offset in [begin, end) at which records continue after damage, or
#: -1. Several must follow each other, the last of which may end at `limit`, at or after `end`.
Find = Callable[[NDArray[np.uint8], int, int, int], int]
#: Latest possible log time in ns.
_INT64_MAX: Final = 2**63 - 1


class RecordFinders(NamedTuple):
    """Functions that find the records of a format in bytes."""

    scan: Scan
    find: Find


@dataclass(frozen=True, slots=True)
class UnpackedBlockGroup:
    """Several unpacked blocks and their records."""

    data: NDArray[np.uint8]
    #: (4, n): connection, log time (as 64 bits), offset and length of the message in `data`
    rows: NDArray[np.int64]
    #: each block, its first row, the row after its last, and its number of bytes outside records
    parts: tuple[tuple[Block, int, int, int], ...]
    damaged: tuple[tuple[Block, str], ...]


class SpanRows(NamedTuple):
    """First and end row found in a span of bytes, and its number of bytes outside records."""

    first_row: int
    end_row: int
    unread_bytes: int


class _SpanScan(NamedTuple):
    """Number of rows found in a span of bytes, and its number of bytes outside records."""

    row_count: int
    unread_bytes: int


class MessageRowIndex:
    """Index of the rows of a group, made block by block while each is in the processor's cache."""

    def __init__(self, finders: RecordFinders, data: NDArray[np.uint8], expected: int) -> None:
        """Create an empty index.

        Args:
            finders: functions that find the records.
            data: (bytes,) bytes of the group.
            expected: expected number of records, if known; if there are more, a block is scanned
                twice.
        """
        self._finders, self._data = finders, data
        self._rows = np.empty((4, expected), np.int64)
        self._count = 0

    @property
    def indexed_rows(self) -> NDArray[np.int64]:
        """All rows so far; see `UnpackedBlockGroup.rows`."""
        return np.ascontiguousarray(self._rows[:, : self._count])

    def add_rows_of_span(self, begin_offset: int, end_offset: int) -> SpanRows:
        """Find and add the rows of a span of bytes."""
        first = self._count
        count, unread = self._scan_span_into_rows(begin_offset, end_offset)
        if first + count > self._rows.shape[1]:
            grown = np.empty((4, max(first + count, 2 * first)), np.int64)
            grown[:, :first] = self._rows[:, :first]
            self._rows = grown
            self._scan_span_into_rows(begin_offset, end_offset)
        self._count = first + count
        return SpanRows(first, self._count, unread)

    def _scan_span_into_rows(self, begin_offset: int, end_offset: int) -> _SpanScan:
        """Find the rows of a span, and store as many as there is room for."""
        row, unread, at = self._count, end_offset - begin_offset, begin_offset
        while 0 <= at < end_offset:
            count, stop = self._finders.scan(self._data, at, end_offset, self._rows, row)
            row += count
            unread -= stop - at
            at = (
                self._finders.find(self._data, stop + 1, end_offset, end_offset)
                if stop < end_offset
                else end_offset
            )
        return _SpanScan(row - self._count, unread)


#: Most unpacked bytes of a group of several blocks: the consumer has an overhead for each group.
UNPACKED_GROUP_BYTES: Final = 8 * 2**20
#: Bytes of the first group, which is small, so that the first rows come soon.
_FIRST_BYTES: Final = UNPACKED_GROUP_BYTES // 32
#: Largest ratio of the size of a group to the size of the previous one.
_GROWTH: Final = 4
#: Number of first, smaller groups, during which only one is prepared ahead.
_GROWING: Final = 3
_WORKERS: Final = min(4, os.cpu_count() or 1)
#: Most bytes of groups that wait; a block larger than a group is one by itself, and fewer wait.
_MOST_WAITING_BYTES: Final = (_WORKERS + 1) * UNPACKED_GROUP_BYTES


def iter_unpacked_block_groups(
    file: FileBytes, blocks: Iterable[Block], finders: RecordFinders
) -> Iterator[UnpackedBlockGroup]:
    """Yield groups of unpacked and scanned blocks, in order.

    A group's memory is reused once the next group is requested.
    """
    free: list[NDArray[np.uint8]] = []
    waiting: deque[tuple[Future[UnpackedBlockGroup], int]] = deque()
    prepared = 0
    pool = ThreadPoolExecutor(_WORKERS, thread_name_prefix="payscope-unpack")
    try:
        for group in _iter_groups_of_blocks(blocks):
            size = sum(_count_unpacked_bytes(block) for block in group)
            while waiting and (
                sum(each for _, each in waiting) + size > _MOST_WAITING_BYTES
                or (prepared < _GROWING and len(waiting) > 1)
            ):
                yield from _yield_and_reuse_oldest_group(waiting, free)
            prepared += 1
            recycled = free.pop() if free and size <= UNPACKED_GROUP_BYTES else None
            waiting.append(
                (pool.submit(unpack_and_scan_blocks, file, group, finders, recycled), size)
            )
        while waiting:
            yield from _yield_and_reuse_oldest_group(waiting, free)
    finally:
        pool.shutdown(cancel_futures=True)


def _yield_and_reuse_oldest_group(
    pending_groups: deque[tuple[Future[UnpackedBlockGroup], int]],
    free_buffers: list[NDArray[np.uint8]],
) -> Iterator[UnpackedBlockGroup]:
    """Yield the oldest group, and reuse its memory afterwards."""
    group = pending_groups.popleft()[0].result()
    yield group
    if group.data.size == UNPACKED_GROUP_BYTES:
        free_buffers.append(group.data)


def _count_unpacked_bytes(block: Block) -> int:
    # a block of implausible size takes no room; unpacking it raises the error
    return block.max_unpacked_bytes if block.max_unpacked_bytes <= LARGEST_BYTES else 0


def _iter_groups_of_blocks(blocks: Iterable[Block]) -> Iterator[list[Block]]:
    """Divide blocks into groups of bounded size; the first groups are smaller."""
    group: list[Block] = []
    size, most = 0, _FIRST_BYTES
    for block in blocks:
        if group and size + _count_unpacked_bytes(block) > most:
            yield group
            group, size, most = [], 0, min(_GROWTH * most, UNPACKED_GROUP_BYTES)
        group.append(block)
        size += _count_unpacked_bytes(block)
    if group:
        yield group


def unpack_and_scan_blocks(
    file: FileBytes,
    blocks: list[Block],
    finders: RecordFinders,
    recycled_buffer: NDArray[np.uint8] | None,
) -> UnpackedBlockGroup:
    """Unpack and scan the blocks of one group in a worker thread."""
    damaged: list[tuple[Block, str]] = []
    parts: list[tuple[Block, int, int, int]] = []
    try:
        size = max(UNPACKED_GROUP_BYTES, sum(map(_count_unpacked_bytes, blocks)))
        buffer = np.empty(size, np.uint8) if recycled_buffer is None else recycled_buffer
        rows = MessageRowIndex(finders, buffer, sum(sum(block.counts.values()) for block in blocks))
    except MemoryError:
        nothing = np.empty(0, np.uint8)
        lost = tuple((block, "not enough memory") for block in blocks)
        return UnpackedBlockGroup(
            nothing, MessageRowIndex(finders, nothing, 0).indexed_rows, (), lost
        )
    at = 0
    for block in blocks:
        try:
            size = unpack_block_into(block, file, buffer[at : at + block.max_unpacked_bytes])
            first, end, unread = rows.add_rows_of_span(at, at + size)
        except DamagedBlockError as error:
            damaged.append((block, str(error)))
        except (OSError, MemoryError) as error:
            damaged.append((block, str(error) or "not enough memory"))
        else:
            parts.append((block, first, end, unread))
            at += size
    return UnpackedBlockGroup(buffer, rows.indexed_rows, tuple(parts), tuple(damaged))


def select_messages_of_connections(
    data: NDArray[np.uint8], rows: Ints, connection_ids: Ints, first_ns: int, last_ns: int
) -> Iterator[RawBatch]:
    """Select messages of a group, as one batch per connection with messages.

    Args:
        data: (bytes,) bytes of the group.
        rows: (4, n) records of the group.
        connection_ids: (connections,) requested connections, ascending.
        first_ns: first log time in ns.
        last_ns: last log time in ns.
    """
    ends = np.zeros(connection_ids.size, np.int64)
    found = np.empty((3, rows.shape[1]), np.int64)
    group_messages_by_connection(
        rows, find_indices_of_values(rows[KEY], connection_ids), first_ns, last_ns, ends, found
    )
    start = 0
    for key, end in zip(connection_ids.tolist(), ends.tolist(), strict=True):
        if end > start:
            offsets, lengths, times = found[:, start:end]
            yield RawBatch(key, data, offsets, lengths, times)
        start = end


@compiled
def group_messages_by_connection(
    rows: Ints,
    connection_indices: Ints,
    first: int,
    last: int,
    group_ends: Ints,
    out_messages: Ints,
) -> None:
    """Store offset, length and time of each requested message, grouped by connection.

    Args:
        rows: (4, n) records.
        connection_indices: (n,) in: index of the requested connection of each message, or -1 if not
            requested; out: -1 also for messages outside the interval.
        first: first log time in ns.
        last: last log time in ns.
        group_ends: (connections,) in: zeros; out: end of each connection's messages in
            `out_messages`.
        out_messages: (3, n) output.
    """
    for row in range(rows.shape[1]):
        if not first <= rows[TIME, row] <= last:
            connection_indices[row] = -1
        elif connection_indices[row] >= 0:
            group_ends[connection_indices[row]] += 1
    start = 0
    for owner in range(group_ends.size):
        count = group_ends[owner]
        group_ends[owner] = start
        start += count
    for row in range(rows.shape[1]):
        owner = connection_indices[row]
        if owner >= 0:
            place = group_ends[owner]
            out_messages[0, place] = rows[OFFSET, row]
            out_messages[1, place] = rows[LENGTH, row]
            out_messages[2, place] = rows[TIME, row]
            group_ends[owner] = place + 1


def find_indices_of_values(values: Ints, sorted_keys: Ints) -> Ints:
    """Index of each of `values` (n,) in the ascending `sorted_keys`; -1 if absent."""
    places = np.empty(values.size, np.int64)
    _replace_values_by_indices(values, sorted_keys, places)
    return places


@compiled
def _replace_values_by_indices(
    values_to_indices: Ints, sorted_keys: Ints, index_of_key: Ints
) -> None:
    first = sorted_keys[0] if sorted_keys.size else 0
    for row in range(values_to_indices.size):
        key = values_to_indices[row]
        # recorders number connections consecutively
        near = key - first
        if 0 <= near < sorted_keys.size and sorted_keys[near] == key:
            index_of_key[row] = near
            continue
        low, high = 0, sorted_keys.size
        while low < high:
            middle = (low + high) // 2
            if sorted_keys[middle] < key:
                low = middle + 1
            else:
                high = middle
        index_of_key[row] = low if low < sorted_keys.size and sorted_keys[low] == key else -1


class ChunkStats(NamedTuple):
    """Message counts and log times of a block."""

    #: number of messages by requested connection, in order; then of all other connections
    counts: list[int]
    #: first and last log time in ns, except times after the year 2262
    first_ns: int
    last_ns: int
    #: number of messages after the year 2262
    late: int


def count_messages_of_chunks(group: UnpackedBlockGroup, sorted_ids: Ints) -> list[ChunkStats]:
    """Count the messages of each of `group.parts`; `sorted_ids` (connections,) are ascending."""
    bounds = np.array([part[1:3] for part in group.parts], np.int64).reshape(-1, 2)
    counts = np.zeros((len(bounds), sorted_ids.size + 1), np.int64)
    spans = np.tile(np.array([_INT64_MAX, -1, 0]), (len(bounds), 1))
    # the index -1, of connections that were not requested, is the last: that of all others
    _count_messages_per_block(
        group.rows,
        bounds,
        find_indices_of_values(group.rows[KEY], sorted_ids),
        counts,
        spans,
    )
    pairs = zip(counts.tolist(), spans.tolist(), strict=True)
    return [ChunkStats(held, *span) for held, span in pairs]


@compiled
def _count_messages_per_block(
    rows: Ints, row_bounds: Ints, connection_indices: Ints, out_counts: Ints, out_time_spans: Ints
) -> None:
    """Count messages and time span of each block, by connection."""
    for part in range(row_bounds.shape[0]):
        for row in range(row_bounds[part, 0], row_bounds[part, 1]):
            time = rows[TIME, row]
            if rows[KEY, row] < 0:
                continue
            out_counts[part, connection_indices[row]] += 1
            if time < 0:
                out_time_spans[part, 2] += 1
            else:
                out_time_spans[part, 0] = min(out_time_spans[part, 0], time)
                out_time_spans[part, 1] = max(out_time_spans[part, 1], time)
