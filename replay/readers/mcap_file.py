"""The container of an MCAP file: by its index where that is whole, else from start to end."""

import struct
import zlib
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Final

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, ChunkIndex, DataEnd, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.summary import Summary
from numpy.typing import NDArray
from rosbags.typesys.msg import normalize_msgtype
from zstandard import ZstdError

from estimators.errors import LogError
from replay.decoding.batch import RawBatch, StoredMessage, join_messages
from replay.readers.container import BROKEN_BYTES, Connection, LossList, no_times

_MAGIC: Final = b"\x89MCAP0\r\n"
#: opcode, length, start of the summary, start of its offsets, CRC of the summary
_FOOTER: Final = struct.Struct("<BQQQI")
_DAMAGE: Final = (McapError, ZstdError, *BROKEN_BYTES)
_INT64_MAX: Final = 2**63 - 1


class McapFile:
    """An MCAP file.

    The index is used only if it accounts for every message: chunks without a message index,
    messages outside chunks, channels that the summary does not repeat, or a missing footer are
    all found in files of the field, and then the file is read from start to end.
    """

    def __init__(self, path: Path) -> None:
        self.files: tuple[Path, ...] = (path,)
        self.losses = LossList()
        self._path = path
        self._size = path.stat().st_size
        self._file = path.open("rb")
        try:
            if self._file.read(len(_MAGIC)) != _MAGIC:
                raise LogError(f"{path}: not an MCAP file; it does not start with the MCAP magic")
            self._open()
        except BaseException:
            self._file.close()
            raise

    def _open(self) -> None:
        summary = self._summary() or Summary()
        channels, schemas = dict(summary.channels), dict(summary.schemas)
        times = self._indexed_times(summary)
        #: None where the file is read from start to end
        self._chunks: list[ChunkIndex] | None = None
        if times is None:
            times = self._scanned_times(channels, schemas)
        else:
            self._chunks = sorted(summary.chunk_indexes, key=lambda c: c.chunk_start_offset)
        self._times = times
        self.connections: tuple[Connection, ...] = tuple(
            _connection(channel, schemas.get(channel.schema_id)) for channel in channels.values()
        )

    def _scanned_times(
        self, channels: dict[int, Channel], schemas: dict[int, Schema]
    ) -> dict[int, NDArray[np.int64]]:
        """Go through the file; add the channels and schemas that the summary does not have."""
        times: dict[int, list[int]] = {}
        for record in self._records(self._scan()):
            if isinstance(record, Channel):
                channels.setdefault(record.id, record)
            elif isinstance(record, Schema):
                schemas.setdefault(record.id, record)
            elif isinstance(record, Message):
                times.setdefault(record.channel_id, []).append(min(record.log_time, _INT64_MAX))
        return {key: np.array(values, np.int64) for key, values in times.items()}

    def _summary(self) -> Summary | None:
        """The summary section; None where there is none, or it is damaged."""
        try:
            self._file.seek(0)
            summary = SeekingReader(self._file, record_size_limit=self._size).get_summary()
            self._file.seek(self._size - _FOOTER.size - len(_MAGIC))
            _, _, start, _, crc = _FOOTER.unpack(self._file.read(_FOOTER.size))
            if crc:  # 0 says that the writer computed none
                self._file.seek(start)
                covered = self._size - len(_MAGIC) - 4 - start
                if zlib.crc32(self._file.read(max(covered, 0))) != crc:
                    return None
        except _DAMAGE:
            return None
        return summary

    def _indexed_times(self, summary: Summary) -> dict[int, NDArray[np.int64]] | None:
        """Log times a channel from the message indexes; None unless they account for all."""
        found: dict[int, list[NDArray[np.int64]]] = {key: [] for key in summary.channels}
        try:
            for chunk in summary.chunk_indexes:
                if not chunk.message_index_offsets:
                    return None
                for key, offset in chunk.message_index_offsets.items():
                    found[key].append(self._message_index(key, offset))
        except _DAMAGE:
            return None
        times = {key: np.concatenate([no_times(), *parts]) for key, parts in found.items()}
        described = all(c.schema_id in {0, *summary.schemas} for c in summary.channels.values())
        count = sum(part.size for part in times.values())
        statistics = summary.statistics
        whole = count > 0 if statistics is None else statistics.message_count == count
        return times if described and whole else None

    def _message_index(self, channel_id: int, offset: int) -> NDArray[np.int64]:
        self._file.seek(offset)
        opcode, _, key, length = struct.unpack("<BQHI", self._file.read(15))
        entries = self._file.read(min(length, self._size))
        if opcode != Opcode.MESSAGE_INDEX or key != channel_id or len(entries) != length:
            raise McapError(f"no message index of channel {channel_id} at byte {offset}")
        times = np.frombuffer(entries, "<u8").reshape(-1, 2)[:, 0]
        return np.minimum(times, _INT64_MAX).astype(np.int64)

    def log_times(self, connection_id: int) -> NDArray[np.int64]:
        """The log times of a channel, from the index or from the scan at opening."""
        return self._times.get(connection_id, no_times())

    def batches(
        self, connection_ids: Collection[int], start_ns: int | None, end_ns: int | None
    ) -> Iterator[RawBatch]:
        """The messages in batches; see `Container.batches`."""
        return join_messages(self._messages(connection_ids, start_ns, end_ns))

    def _messages(
        self, connection_ids: Collection[int], start_ns: int | None, end_ns: int | None
    ) -> Iterator[StoredMessage]:
        """Messages in file order; a damaged chunk costs that chunk."""
        wanted = frozenset(connection_ids)
        first = 0 if start_ns is None else start_ns
        last = 2**64 - 1 if end_ns is None else end_ns
        if self._chunks is None:
            stored = self._scan()
        else:
            stored = self._load(
                chunk
                for chunk in self._chunks
                if not wanted.isdisjoint(chunk.message_index_offsets)
                and chunk.message_end_time >= first
                and chunk.message_start_time <= last
            )
        for record in self._records(stored):
            if (
                isinstance(record, Message)
                and record.channel_id in wanted
                and first <= record.log_time <= last
            ):
                yield StoredMessage(record.log_time, record.data)

    def _load(self, chunks: Iterator[ChunkIndex]) -> Iterator[McapRecord]:
        for chunk in chunks:
            try:
                self._file.seek(chunk.chunk_start_offset)
                opcode, length = struct.unpack("<BQ", self._file.read(9))
                if opcode != Opcode.CHUNK or length + 9 != chunk.chunk_length:
                    raise McapError("the index points beside it")
                yield Chunk.read(ReadDataStream(self._file))
            except _DAMAGE as error:
                self._lose_chunk(chunk, error)

    def _scan(self) -> Iterator[McapRecord]:
        """Top-level records from the start of the file to its end, or to where it is torn.

        A tear in the summary, behind the end of the data, costs nothing.
        """
        self._file.seek(0)
        reader = StreamReader(self._file, emit_chunks=True, record_size_limit=self._size)
        whole, data_ended = len(_MAGIC), False
        try:
            for record in reader.records:
                yield record
                whole = self._file.tell()
                if isinstance(record, DataEnd | Chunk | Message):
                    data_ended = isinstance(record, DataEnd)
        except _DAMAGE:
            if data_ended:
                return
            self.losses.note(
                self._path,
                f"breaks off after byte {whole} of {self._size}, without a footer: "
                f"what stands before is read, {self._size - whole} bytes are lost",
            )

    def _records(self, stored: Iterator[McapRecord]) -> Iterator[McapRecord]:
        """Open the chunks."""
        for record in stored:
            if isinstance(record, Chunk):
                try:
                    inside = breakup_chunk(record, validate_crc=True)
                except _DAMAGE as error:
                    self._lose_chunk(record, error)
                else:
                    yield from inside
            else:
                yield record

    def _lose_chunk(self, chunk: Chunk | ChunkIndex, error: BaseException) -> None:
        seconds = (chunk.message_end_time - chunk.message_start_time) / 1e9
        self.losses.note(
            self._path,
            f"the chunk from log time {chunk.message_start_time} ns, {seconds:.3f} s long, is "
            f"damaged and not read: {' '.join(str(error).split()) or type(error).__name__}",
        )

    def close(self) -> None:
        """Release the file."""
        self._file.close()


def _connection(channel: Channel, schema: Schema | None) -> Connection:
    if schema is None:
        return Connection(channel.id, channel.topic, "", channel.message_encoding, "", "")
    name = schema.name
    return Connection(
        channel.id,
        channel.topic,
        # ROS 1 leaves out the /msg/ that ROS 2 has; a service's event has /srv/ in its place
        normalize_msgtype(name) if schema.encoding == "ros1msg" else name,
        channel.message_encoding,
        schema.data.decode(errors="replace"),
        schema.encoding,
    )
