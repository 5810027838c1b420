"""Write simulated logs as MCAP files (https://mcap.dev/spec), chunk by chunk."""

import zlib
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import BinaryIO, Final, NamedTuple

import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from analysis.simulation import SimulatedLog
from estimators.arrays import Ints
from replay.logs.writers.recorded_order import (
    FullChunk,
    RecordedTopic,
    iter_records_in_time_order,
    split_into_chunks,
)
from replay.logs.writers.ros_messages import TOPICS, make_recorded_topics
from replay.logs.writers.serialise_messages import Envelope

_MAGIC: Final = b"\x89MCAP0\r\n"
#: Bytes of a chunk.
_CHUNK_BYTES: Final = 1 << 20
#: Chunks that are compressed at the same time, and most chunks that wait.
_PACKERS: Final = 2
_MOST_WAITING: Final = 2 * _PACKERS
#: Bytes before a message's data: channel, sequence, log and publish time.
_MESSAGE_HEAD: Final = 22
_INDEX_ROW: Final = np.dtype([("time", "<u8"), ("offset", "<u8")])


def write_mcap(log: SimulatedLog, path: Path) -> None:
    """Write `log` as an MCAP file at `path`, which must not exist."""
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    numbers = {name: number for number, name in enumerate(log.topics, 1)}
    channels: list[SchemaAndChannel] = []
    for name, number in numbers.items():
        topic = TOPICS[name]
        definition, _ = store.generate_msgdef(topic.msgtype, ros_version=2)
        channels.append(make_schema_and_channel(number, topic.name, topic.msgtype, definition))
    with path.open("xb") as file:
        made = McapColumnWriter(file, channels)
        made.write_all_messages(
            make_recorded_topics(log, store, numbers, make_mcap_message_envelope, ros1=False)
        )
        machine_id = log.scenario.log.machine_id
        made.write_summary_and_close(
            [Metadata("machine", {"id": machine_id})] if machine_id else ()
        )


def make_mcap_message_envelope(channel: int, times: Ints) -> Envelope:
    """Make the envelope of a channel's messages, recorded at times (n,) in ns."""

    def record_head(size: int) -> list[bytes | tuple[str, Ints]]:
        head = bytes([Opcode.MESSAGE]) + (size + _MESSAGE_HEAD).to_bytes(8, "little")
        # no sequence number; published when recorded
        return [head + channel.to_bytes(2, "little") + bytes(4), ("<u8", times), ("<u8", times)]

    return record_head


class SchemaAndChannel(NamedTuple):
    """A channel and its schema."""

    schema: Schema
    channel: Channel


def make_schema_and_channel(
    channel_id: int,
    topic: str,
    msgtype: str,
    definition: str,
    metadata: Mapping[str, str] = MappingProxyType({}),
) -> SchemaAndChannel:
    """Make a channel of CDR messages and its schema, both with the same id."""
    return SchemaAndChannel(
        Schema(id=channel_id, data=definition.encode(), encoding="ros2msg", name=msgtype),
        Channel(
            id=channel_id,
            topic=topic,
            message_encoding="cdr",
            metadata=dict(metadata),
            schema_id=channel_id,
        ),
    )


class _PackedChunk(NamedTuple):
    data: bytes
    crc: int


def _make_empty_statistics() -> Statistics:
    return Statistics(
        attachment_count=0,
        channel_count=0,
        channel_message_counts={},
        chunk_count=0,
        message_count=0,
        message_end_time=0,
        message_start_time=0,
        metadata_count=0,
        schema_count=0,
    )


@dataclass(eq=False)
class McapColumnWriter:
    """Writer of one MCAP file, in the form that the library's own writer gives it.

    Attributes:
        file: empty file opened for writing.
        channels: channels of the file, by topic.
        packed: whether chunks are compressed with zstd and have a CRC.
        statistics: statistics of the messages written so far.
    """

    file: BinaryIO
    channels: Sequence[SchemaAndChannel]
    packed: bool = True
    statistics: Statistics = field(init=False, default_factory=_make_empty_statistics)
    _indexes: list[ChunkIndex] = field(init=False, default_factory=list[ChunkIndex])

    def write_all_messages(self, topics: Sequence[RecordedTopic]) -> None:
        """Write all messages of the file; call it only once."""
        self.statistics.schema_count = self.statistics.channel_count = len(self.channels)
        self.file.write(_MAGIC)
        self._write_record(Header("ros2", "payscope"))
        preamble = b"".join(
            _serialise_mcap_record(record) for each in self.channels for record in each
        )
        for chunk, done in self._iter_chunks_compressed_ahead(
            split_into_chunks(iter_records_in_time_order(topics), preamble, _CHUNK_BYTES)
        ):
            counts = self._write_chunk_and_count_messages(chunk, done.result())
            _add_chunk_to_statistics(self.statistics, counts, chunk)

    def write_summary_and_close(self, metadata: Sequence[Metadata] = ()) -> None:
        """Write the metadata records, the end of the data, the summary and the footer."""
        indexes = [self._write_metadata_record(each) for each in metadata]
        self.statistics.metadata_count = len(indexes)
        self._write_record(DataEnd(0))
        schemas, channels = zip(*self.channels, strict=True)
        self._write_summary([schemas, channels, [self.statistics], self._indexes, [], indexes])

    def _write_record(self, record: McapRecord) -> None:
        self.file.write(_serialise_mcap_record(record))

    def _iter_chunks_compressed_ahead(
        self, full_chunks: Iterator[FullChunk]
    ) -> Iterator[tuple[FullChunk, "Future[_PackedChunk]"]]:
        """Yield full chunks in order, while the next ones are compressed in other threads."""
        waiting: deque[tuple[FullChunk, Future[_PackedChunk]]] = deque()
        with ThreadPoolExecutor(_PACKERS) as pool:
            for chunk in full_chunks:
                waiting.append((chunk, pool.submit(self._compress_chunk, chunk)))
                if len(waiting) > _MOST_WAITING:
                    yield waiting.popleft()
            while waiting:
                yield waiting.popleft()

    def _compress_chunk(self, chunk: FullChunk) -> _PackedChunk:
        if not self.packed:
            return _PackedChunk(chunk.data.tobytes(), 0)
        import zstandard

        return _PackedChunk(zstandard.compress(chunk.data.data), zlib.crc32(chunk.data.data))

    def _write_chunk_and_count_messages(
        self, chunk: FullChunk, packed: _PackedChunk
    ) -> dict[int, int]:
        """Write a chunk, and return its number of messages by channel."""
        compression = "zstd" if self.packed else ""
        start, end = int(chunk.log_times.min()), int(chunk.log_times.max())
        at = self.file.tell()
        self._write_record(
            Chunk(
                compression=compression,
                data=packed.data,
                message_start_time=start,
                message_end_time=end,
                uncompressed_crc=packed.crc,
                uncompressed_size=chunk.data.size,
            )
        )
        ends_at = self.file.tell()
        offsets: dict[int, int] = {}
        counts: dict[int, int] = {}
        for number, mine in chunk.split_by_connection().items():
            offsets[number] = self.file.tell()
            counts[number] = mine.log_times.size
            rows = np.empty(mine.log_times.size, _INDEX_ROW)
            rows["time"], rows["offset"] = mine.log_times, mine.offsets
            head = bytes([Opcode.MESSAGE_INDEX]) + (6 + rows.nbytes).to_bytes(8, "little")
            sizes = number.to_bytes(2, "little") + rows.nbytes.to_bytes(4, "little")
            self.file.write(head + sizes + rows.tobytes())
        self._indexes.append(
            ChunkIndex(
                chunk_length=ends_at - at,
                chunk_start_offset=at,
                compression=compression,
                compressed_size=len(packed.data),
                message_end_time=end,
                message_index_length=self.file.tell() - ends_at,
                message_index_offsets=offsets,
                message_start_time=start,
                uncompressed_size=chunk.data.size,
            )
        )
        return counts

    def _write_metadata_record(self, metadata: Metadata) -> MetadataIndex:
        at = self.file.tell()
        self._write_record(metadata)
        return MetadataIndex(offset=at, length=self.file.tell() - at, name=metadata.name)

    def _write_summary(self, summary_groups: Sequence[Sequence[McapRecord]]) -> None:
        """Write the summary: definitions, statistics, indexes, and offsets of the groups."""
        starts = self.file.tell()
        data = b""
        offsets: list[SummaryOffset] = []
        for kind, records in zip(_GROUPS, summary_groups, strict=True):
            made = b"".join(map(_serialise_mcap_record, records))
            offsets.append(
                SummaryOffset(
                    group_opcode=kind, group_start=starts + len(data), group_length=len(made)
                )
            )
            data += made
        offsets_at = starts + len(data)
        data += b"".join(map(_serialise_mcap_record, offsets))
        footer = Footer(summary_start=starts, summary_offset_start=offsets_at, summary_crc=0)
        # covers all but the CRC itself, which ends the footer
        footer.summary_crc = zlib.crc32(_serialise_mcap_record(footer)[:-4], zlib.crc32(data))
        self.file.write(data + _serialise_mcap_record(footer) + _MAGIC)


_GROUPS: Final = (
    Opcode.SCHEMA,
    Opcode.CHANNEL,
    Opcode.STATISTICS,
    Opcode.CHUNK_INDEX,
    Opcode.ATTACHMENT_INDEX,
    Opcode.METADATA_INDEX,
)


def _serialise_mcap_record(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()


def _add_chunk_to_statistics(
    statistics: Statistics, messages: Mapping[int, int], chunk: FullChunk
) -> None:
    start, end = int(chunk.log_times.min()), int(chunk.log_times.max())
    if statistics.message_count:
        start = min(start, statistics.message_start_time)
    statistics.message_start_time = start
    statistics.message_end_time = max(end, statistics.message_end_time)
    statistics.message_count += chunk.log_times.size
    statistics.chunk_count += 1
    counts = statistics.channel_message_counts
    for number, count in messages.items():
        counts[number] = counts.get(number, 0) + count
