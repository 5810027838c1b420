"""Read the index of a ROS 1 bag: connections and chunks at its end, times after each chunk."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from replay.logs.bag.bag_records import (
    CHUNK,
    CHUNK_INFO,
    CONNECTION,
    INDEX_DATA,
    BagRecord,
    read_bag_record,
)
from replay.logs.blocks import Block
from replay.logs.storage import FileBytes, ReadBuffer

#: seconds, nanoseconds, offset in the chunk
_ENTRY: Final = np.dtype([("s", "<u4"), ("ns", "<u4"), ("offset", "<u4")])
#: Bytes allowed for the header of a record, a little more than recorders write.
_HEADER_BYTES: Final = 256
#: Most bytes of an index that are read at once; the rest of a larger one is read by record.
_MOST_INDEX_BYTES: Final = 64 * 2**20
_COUNT: Final = np.dtype([("connection", "<u4"), ("messages", "<u4")])


@dataclass(frozen=True, slots=True)
class BagIndex:
    """Index at the end of a bag."""

    #: the records of connections: header and data
    connections: tuple[tuple[BagRecord, bytes], ...]
    #: number of messages by connection, by the offset of the chunk's record
    chunks: dict[int, dict[int, int]]


def read_bag_index(
    file: FileBytes, index_offset: int, connection_count: int, chunk_count: int
) -> BagIndex | None:
    """Read the index at `index_offset`; None if it is incomplete."""
    described: list[tuple[BagRecord, bytes]] = []
    counts: dict[int, dict[int, int]] = {}
    at = index_offset
    window = ReadBuffer(file, index_offset, min(file.size - index_offset, _MOST_INDEX_BYTES))
    while at < file.size:
        record = read_bag_record(window, at)
        if record is None or record.end_offset > file.size:
            return None
        data = window.read_bytes(record.data_offset, record.data_bytes)
        if record.opcode == CONNECTION:
            described.append((record, data))
        elif record.opcode == CHUNK_INFO and b"chunk_pos" in record.fields and len(data) % 8 == 0:
            pairs = np.frombuffer(data, _COUNT).tolist()
            counts[record.decode_unsigned_field(b"chunk_pos")] = dict(pairs)
        else:
            return None
        at = record.end_offset
    if len(described) != connection_count or len(counts) != chunk_count:
        return None
    return BagIndex(tuple(described), counts)


def make_block_of_chunk_record(
    file: FileBytes, offset: int, record: BagRecord | None
) -> Block | None:
    """Describe the chunk whose record begins at `offset`; None if there is no chunk.

    A chunk that extends beyond the end of the file is truncated. So is a chunk of size 0 that is
    not empty, since the recorder writes the size when the chunk is full.
    """
    if record is None or record.opcode != CHUNK:
        return None
    compression = record.fields.get(b"compression", b"none").decode(errors="replace")
    unpacked = record.decode_unsigned_field(b"size") if b"size" in record.fields else 0
    left = file.size - record.data_offset
    behind = (
        read_bag_record(file, record.end_offset) if record.data_bytes == unpacked == 0 else None
    )
    is_open = record.data_bytes == unpacked == 0 and (
        behind is None or behind.opcode not in (CHUNK, INDEX_DATA)
    )
    return Block(
        offset,
        record.data_offset,
        left if is_open else min(record.data_bytes, left),
        "" if compression == "none" else compression,
        unpacked,
        is_truncated=is_open or record.data_bytes > left,
    )


def read_indexed_log_times(
    file: FileBytes, block: Block, message_counts: dict[int, int]
) -> dict[int, NDArray[np.int64]] | None:
    """Read log times in ns by connection from the index after a chunk; None if incomplete."""
    times: dict[int, NDArray[np.int64]] = {}
    at = block.offset + block.stored_bytes
    expected = _ENTRY.itemsize * sum(message_counts.values()) + _HEADER_BYTES * (
        len(message_counts) + 1
    )
    window = ReadBuffer(file, at, min(expected, _MOST_INDEX_BYTES))
    for _ in message_counts:
        record = read_bag_record(window, at)
        if record is None or record.opcode != INDEX_DATA or b"conn" not in record.fields:
            return None
        data = window.read_bytes(record.data_offset, record.data_bytes)
        if len(data) % _ENTRY.itemsize:
            return None
        entries = np.frombuffer(data, _ENTRY)
        stamps = entries["s"].astype(np.int64) * 10**9 + entries["ns"]
        times[record.decode_unsigned_field(b"conn")] = stamps
        at = record.end_offset
    whole = {key: stamps.size for key, stamps in times.items()} == message_counts
    return times if whole else None
