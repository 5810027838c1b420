"""Arrange messages of several topics in recorded order, in blocks of bytes."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from estimators.arrays import Bytes, Ints
from estimators.compiled import compiled_without_refcounts
from replay.logs.decoding.unaligned import copy
from replay.logs.writers.serialise_messages import SameLayout

#: Messages of a block, so few that their bytes stay in the processor's cache.
BLOCK_ROWS: Final = 16_384


@dataclass(frozen=True, eq=False)
class RecordedTopic:
    """Messages of one topic.

    Attributes:
        connection: number of the topic in the container.
        log_time_ns: (n,) log times, ascending.
        records: function that returns the messages `[first, last)`, grouped by layout.
    """

    connection: int
    log_time_ns: Ints
    records: Callable[[int, int], list[SameLayout]]


class RecordBlock(NamedTuple):
    """Consecutive records: their bytes, and the offset (n,) at which each ends."""

    data: Bytes
    connections: Ints
    log_times: Ints
    ends: Ints


@compiled_without_refcounts
def _scatter_rows(rows: Bytes, row_bytes: int, target_offsets: Ints, target: Bytes) -> None:
    """Copy rows of equal size to given offsets in the target."""
    for number in range(target_offsets.size):
        copy(rows, number * row_bytes, target, target_offsets[number], row_bytes)


def iter_records_in_time_order(topics: Sequence[RecordedTopic]) -> Iterator[RecordBlock]:
    """Yield all messages in order of log time; ties are in the order of the topics."""
    times = np.concatenate([np.empty(0, np.int64), *(topic.log_time_ns for topic in topics)])
    sizes = [topic.log_time_ns.size for topic in topics]
    kinds = np.repeat(np.arange(len(topics)), sizes)
    order = np.argsort(times, kind="stable")
    times, kinds = times[order], kinds[order]
    done = [0] * len(topics)
    for start in range(0, times.size, BLOCK_ROWS):
        here = slice(start, start + BLOCK_ROWS)
        yield make_next_record_block(topics, times[here], kinds[here], done)


def make_next_record_block(
    topics: Sequence[RecordedTopic], times: Ints, topic_ids: Ints, messages_done: list[int]
) -> RecordBlock:
    """Make the next block; `messages_done` counts the preceding messages of each topic."""
    lengths = np.empty(times.size, np.int64)
    made: list[tuple[Bytes, Ints]] = []
    for number, topic in enumerate(topics):
        places = np.flatnonzero(topic_ids == number)
        if not places.size:
            continue
        first, messages_done[number] = messages_done[number], messages_done[number] + places.size
        for same in topic.records(first, messages_done[number]):
            chosen = places if same.chosen is None else places[same.chosen]
            lengths[chosen] = same.rows.shape[1]
            made.append((same.rows, chosen))
    ends = np.cumsum(lengths)
    data = np.empty(int(ends[-1]), np.uint8)
    starts = ends - lengths
    for rows, chosen in made:
        _scatter_rows(rows.reshape(-1), rows.shape[1], starts[chosen], data)
    numbers = np.array([topic.connection for topic in topics], np.int64)
    return RecordBlock(data, numbers[topic_ids], times, ends)


class FullChunk(NamedTuple):
    """Chunk of a container: its bytes, and the offset (n,) at which each message begins."""

    data: Bytes
    connections: Ints
    log_times: Ints
    offsets: Ints

    def split_by_connection(self) -> "Mapping[int, FullChunk]":
        """Messages by connection, in the order of the connections' first messages."""
        numbers, first = np.unique(self.connections, return_index=True)
        found: dict[int, FullChunk] = {}
        for number in numbers[np.argsort(first)].tolist():
            mine = self.connections == number
            found[number] = self._replace(
                connections=self.connections[mine],
                log_times=self.log_times[mine],
                offsets=self.offsets[mine],
            )
        return found


def split_into_chunks(
    blocks: Iterator[RecordBlock], preamble: bytes, chunk_bytes: int
) -> Iterator[FullChunk]:
    """Split records into chunks, each ending with the record that exceeds `chunk_bytes`.

    Args:
        blocks: the records.
        preamble: bytes before the first record.
        chunk_bytes: size of a chunk in bytes.
    """
    pieces: list[RecordBlock] = []
    lead = np.frombuffer(preamble, np.uint8)
    size = lead.size
    for block in blocks:
        begin = 0
        while begin < block.ends.size:
            start = int(block.ends[begin - 1]) if begin else 0
            full = int(np.searchsorted(block.ends, start + chunk_bytes - size, side="right"))
            end = min(full + 1, block.ends.size)
            piece = RecordBlock(
                block.data[start : block.ends[end - 1]],
                block.connections[begin:end],
                block.log_times[begin:end],
                block.ends[begin:end] - start,
            )
            pieces.append(piece)
            size += piece.data.size
            begin = end
            if size > chunk_bytes:
                yield _join_into_full_chunk(lead, pieces)
                pieces, lead, size = [], lead[:0], 0
    if pieces:
        yield _join_into_full_chunk(lead, pieces)


def _join_into_full_chunk(preamble: Bytes, pieces: Sequence[RecordBlock]) -> FullChunk:
    data = np.concatenate([preamble, *(piece.data for piece in pieces)])
    offsets: list[Ints] = []
    at = preamble.size
    for piece in pieces:
        offsets.append(np.concatenate([[0], piece.ends[:-1]]) + at)
        at += piece.data.size
    return FullChunk(
        data,
        np.concatenate([piece.connections for piece in pieces]),
        np.concatenate([piece.log_times for piece in pieces]),
        np.concatenate(offsets),
    )
