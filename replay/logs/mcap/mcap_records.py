"""Parse records of an MCAP file (mcap.dev/spec), and its index, which consists of records.

A record is opcode u8, length u64 and content, little-endian. The index is the summary at the end of
the file, and the message indexes after each chunk.
"""

import struct
import zlib
from collections.abc import Mapping
from io import BytesIO
from operator import itemgetter
from typing import Final, NamedTuple

import numpy as np
from mcap.exceptions import McapError
from mcap.records import Channel, ChunkIndex, MetadataIndex, Schema, Statistics
from mcap.stream_reader import StreamReader
from numpy.typing import NDArray

from replay.logs.blocks import Block
from replay.logs.messages.broken_bytes import BROKEN_BYTES
from replay.logs.storage import FileBytes

MAGIC: Final = b"\x89MCAP0\r\n"
RECORD_HEAD: Final = struct.Struct("<BQ")

#: Opcodes of records (MCAP specification).
FOOTER: Final = 0x02
SCHEMA: Final = 0x03
CHANNEL: Final = 0x04
MESSAGE: Final = 0x05
CHUNK: Final = 0x06
MESSAGE_INDEX: Final = 0x07
CHUNK_INDEX: Final = 0x08
STATISTICS: Final = 0x0B
METADATA: Final = 0x0C
DATA_END: Final = 0x0F

#: Bytes of the content of these records.
FOOTER_BYTES: Final = 8 + 8 + 4
DATA_END_BYTES: Final = 4

#: log times of first and last message, unpacked size, CRC, length of the compression's name
_CHUNK: Final = struct.Struct("<QQQII")
_STORED: Final = struct.Struct("<Q")
#: Most characters of a compression's name; the longest known one has four.
_LONGEST_NAME: Final = 32
#: Latest possible log time in ns.
_INT64_MAX: Final = 2**63 - 1
#: opcode, length, start of the summary, start of its offsets, CRC of the summary
_FOOTER: Final = struct.Struct("<BQQQI")
#: first and last log time of a chunk, its offset, its length, length of the offsets
_CHUNK_INDEX_HEAD: Final = struct.Struct("<QQQQI")
#: channel, offset of its message index
_INDEX_OFFSET: Final = struct.Struct("<HQ")
#: length of all message indexes, length of the compression's name
_CHUNK_INDEX_REST: Final = struct.Struct("<QI")
#: stored size, unpacked size
_SIZES: Final = struct.Struct("<QQ")
#: opcode, length, channel, length of the entries
_MESSAGE_INDEX: Final = struct.Struct("<BQHI")
#: bytes of log time and offset in the chunk
_ENTRY_BYTES: Final = 8 + 8


def read_chunk_header_as_block(
    file: FileBytes, offset: int, message_counts: Mapping[int, int] | None = None
) -> Block | None:
    """Describe the chunk whose record begins at `offset`; None if there is no chunk.

    A chunk that extends beyond the end of the file is truncated. `message_counts` are by channel.
    """
    head = file.read_bytes(offset, RECORD_HEAD.size + _CHUNK.size + _LONGEST_NAME + _STORED.size)
    try:
        opcode, length = RECORD_HEAD.unpack_from(head)
        first, last, unpacked, crc, size = _CHUNK.unpack_from(head, RECORD_HEAD.size)
        at = RECORD_HEAD.size + _CHUNK.size
        name = head[at : at + size].decode()
        (stored,) = _STORED.unpack_from(head, at + size)
    except (struct.error, UnicodeDecodeError):
        return None
    at += size + _STORED.size
    if opcode != CHUNK or at + stored != RECORD_HEAD.size + length:
        return None
    left = file.size - offset - at
    fits = last <= _INT64_MAX and first <= last
    return Block(
        offset,
        offset + at,
        min(stored, left),
        name,
        unpacked,
        crc,
        is_truncated=stored > left,
        counts=message_counts or {},
        first_ns=first if fits else 0,
        last_ns=last if fits else -1,
    )


class SummaryError(Exception):
    """Raised if the summary cannot be used; the text is the reason."""


class Summary:
    """Records of the summary; empty if it is missing or damaged."""

    def __init__(self, file: FileBytes) -> None:
        #: why it is not used; empty if it can be
        self.fault = ""
        self.channels: dict[int, Channel] = {}
        self.schemas: dict[int, Schema] = {}
        self.chunks: list[ChunkIndex] = []
        self.metadata: list[MetadataIndex] = []
        self.message_count: int | None = None
        #: whether it has a CRC that agrees
        self.is_sealed = False
        try:
            section = self._read_summary_section(file)
        except SummaryError as fault:
            self.fault = str(fault)
            return
        self.chunks, rest = split_chunk_indexes_from_summary(section)
        stream = BytesIO(rest + MAGIC)
        reader = StreamReader(stream, skip_magic=True, record_size_limit=len(section))
        try:
            records = list(reader.records) if rest else []
        except (McapError, *BROKEN_BYTES) as fault:
            self.chunks = []
            self.fault = f"its summary cannot be read ({' '.join(str(fault).split())})"
            return
        for record in records:
            if isinstance(record, Channel):
                self.channels[record.id] = record
            elif isinstance(record, Schema):
                self.schemas[record.id] = record
            elif isinstance(record, ChunkIndex):
                self.chunks.append(record)
            elif isinstance(record, MetadataIndex):
                self.metadata.append(record)
            elif isinstance(record, Statistics):
                self.message_count = record.message_count

    def _read_summary_section(self, file: FileBytes) -> bytes:
        """Read the bytes of the summary up to the closing magic; empty without a summary."""
        end = file.size - len(MAGIC)
        footer = file.read_bytes(end - _FOOTER.size, _FOOTER.size)
        if (
            len(footer) < _FOOTER.size
            or footer[0] != FOOTER
            or file.read_bytes(end, len(MAGIC)) != MAGIC
        ):
            raise SummaryError("does not end with a footer and the MCAP magic bytes")
        _, _, start, _, crc = _FOOTER.unpack(footer)
        if not start:
            return b""
        section = file.read_bytes(start, end - start)
        # 0: the writer computed none; it covers everything before itself
        if crc and zlib.crc32(section[:-4]) != crc:
            raise SummaryError("the CRC of its summary is wrong")
        self.is_sealed = crc != 0
        return section


class SplitSummary(NamedTuple):
    """Chunk indexes of a summary, and the bytes of its other records."""

    chunk_indexes: list[ChunkIndex]
    other_records: bytes


def split_chunk_indexes_from_summary(summary_section: bytes) -> SplitSummary:
    """Separate the chunk indexes of a summary from the bytes of all other records.

    A shift has thousands of chunk indexes, and the library takes 60 µs for each. If one is
    malformed, all are left to the library, which reports why.
    """
    chunks: list[ChunkIndex] = []
    others: list[bytes] = []
    at = 0
    try:
        while at < len(summary_section):
            opcode, length = RECORD_HEAD.unpack_from(summary_section, at)
            end = at + RECORD_HEAD.size + length
            if end > len(summary_section):
                return SplitSummary([], summary_section)
            if opcode == CHUNK_INDEX:
                chunks.append(_parse_chunk_index(summary_section[at + RECORD_HEAD.size : end]))
            else:
                others.append(summary_section[at:end])
            at = end
    except (struct.error, UnicodeDecodeError):
        return SplitSummary([], summary_section)
    return SplitSummary(chunks, b"".join(others))


def _parse_chunk_index(record_content: bytes) -> ChunkIndex:
    first, last, start, length, size = _CHUNK_INDEX_HEAD.unpack_from(record_content)
    at = _CHUNK_INDEX_HEAD.size
    offsets = dict(_INDEX_OFFSET.iter_unpack(record_content[at : at + size]))
    at += size
    index_length, name_size = _CHUNK_INDEX_REST.unpack_from(record_content, at)
    at += _CHUNK_INDEX_REST.size
    name = record_content[at : at + name_size].decode()
    stored, unpacked = _SIZES.unpack_from(record_content, at + name_size)
    return ChunkIndex(
        chunk_start_offset=start,
        chunk_length=length,
        compression=name,
        compressed_size=stored,
        uncompressed_size=unpacked,
        message_index_offsets=offsets,
        message_index_length=index_length,
        message_start_time=first,
        message_end_time=last,
    )


def make_block_of_misplaced_chunk(chunk: ChunkIndex) -> Block:
    """Describe a chunk that is not at its indexed offset, so that it can be noted as lost."""
    return Block(chunk.chunk_start_offset, 0, chunk.compressed_size, chunk.compression, 0)


def count_indexed_messages(chunk: ChunkIndex) -> dict[int, int]:
    """Count messages by channel, from only the offsets of a chunk's message indexes.

    Empty if the indexes do not directly follow the chunk and each other.
    """
    start = chunk.chunk_start_offset + chunk.chunk_length
    places = sorted(chunk.message_index_offsets.items(), key=itemgetter(1))
    ends = [*(offset for _, offset in places), start + chunk.message_index_length]
    if ends[0] != start:
        return {}
    counts: dict[int, int] = {}
    for (key, offset), end in zip(places, ends[1:], strict=True):
        count, rest = divmod(end - offset - _MESSAGE_INDEX.size, _ENTRY_BYTES)
        if rest or count < 0:
            return {}
        if count:
            counts[key] = count
    return counts


def read_indexed_times_of_chunk(
    file: FileBytes, chunk: ChunkIndex
) -> Mapping[int, NDArray[np.int64]] | None:
    """Read log times (as 64 bits) by channel from the message indexes of a chunk.

    None if the indexes are incomplete, overlap or are missing.
    """
    offsets = chunk.message_index_offsets
    start = chunk.chunk_start_offset + chunk.chunk_length
    if not offsets or min(offsets.values()) < start:
        return None
    section = file.read_byte_array(start, chunk.message_index_length)
    left = len(section)
    times: dict[int, NDArray[np.int64]] = {}
    for key, offset in offsets.items():
        at = offset - start
        if at + _MESSAGE_INDEX.size > len(section):
            return None
        opcode, _, channel, size = _MESSAGE_INDEX.unpack_from(section.data, at)
        at += _MESSAGE_INDEX.size
        left -= _MESSAGE_INDEX.size + size
        is_whole = left >= 0 and at + size <= len(section) and size % _ENTRY_BYTES == 0
        if opcode != MESSAGE_INDEX or channel != key or not is_whole:
            return None
        times[key] = np.frombuffer(section, "<i8", size // 8, at)[::2].astype(np.int64)
    return times
