"""The container of an MCAP file: by its index where that is whole, else from start to end."""

from collections.abc import Collection, Iterator, Sequence
from io import BytesIO
from pathlib import Path

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.records import Channel, Schema
from numpy.typing import NDArray
from rosbags.typesys.msg import normalize_msgtype

from analysis.run import Loss
from estimators.errors import LogError
from replay.decoding.batch import RawBatch
from replay.readers.container import BROKEN_BYTES, Connection
from replay.readers.containers.block import Block
from replay.readers.containers.block_store import BlockStore
from replay.readers.containers.file_bytes import FileBytes
from replay.readers.containers.mcap_index import (
    Summary,
    chunk_block,
    damaged_block,
    indexed_times,
)
from replay.readers.containers.mcap_records import CHANNEL, MAGIC
from replay.readers.containers.mcap_walk import Walk
from replay.readers.containers.records import Grammar


def _grammar() -> Grammar:
    from replay.readers.containers.mcap_grammar import GRAMMAR

    return GRAMMAR


class McapFile:
    """An MCAP file.

    The index is used only if it accounts for every message: chunks without a message index,
    messages outside chunks, channels that the summary does not repeat, or a missing footer are
    all found in files of the field. What it does not account for is surveyed at opening.
    """

    def __init__(self, path: Path) -> None:
        self.files: tuple[Path, ...] = (path,)
        self._file = FileBytes(path)
        try:
            if self._file.read(0, len(MAGIC)) != MAGIC:
                raise LogError(f"{path}: not an MCAP file; it does not start with the MCAP magic")
            self._open()
        except BaseException:
            self._file.close()
            raise

    def _open(self) -> None:
        summary = Summary(self._file)
        self._channels, self._schemas = dict(summary.channels), dict(summary.schemas)
        self._channels_at = dict.fromkeys(self._channels, -1)
        self._schemas_at = dict.fromkeys(self._schemas, -1)
        self._store = BlockStore(self._file, _grammar, self._describe)
        self._take_index(summary)
        said = summary.message_count
        if self._store.message_count != said and not self._store.damage:
            indexed = self._store
            if said is not None or not indexed.message_count:
                self._store = BlockStore(self._file, _grammar, self._describe)
                counted = self._walk()
                said = counted if said is None else said
        found = self._store.message_count
        if said not in (None, found) and not self._store.damage:
            self._store.damage.note(f"its statistics count {said:,} messages, {found:,} are there")
        self.connections: tuple[Connection, ...] = tuple(
            _connection(channel, self._schemas.get(channel.schema_id))
            for channel in self._channels.values()
        )
        self._topics = {c.id: c.topic for c in self.connections}
        self._store.finish(self._topics)

    def _take_index(self, summary: Summary) -> None:
        described = all(c.schema_id in {0, *summary.schemas} for c in summary.channels.values())
        unknown: list[Block] = []
        chunks = {chunk.chunk_start_offset: chunk for chunk in summary.chunks}
        for offset in sorted(chunks):
            block = chunk_block(self._file, offset)
            times = indexed_times(self._file, chunks[offset])
            # the index stands behind all chunks, so that the end of the file tears none of them
            if block is None or block.is_torn:
                lost = damaged_block(chunks[offset])
                self._store.lose(lost, times or {}, "it is not where the index says")
            elif times is None or not described or not self._channels.keys() >= times.keys():
                unknown.append(block)
            else:
                self._store.add(block, times)
        if unknown:
            self._store.survey(unknown)

    def _walk(self) -> int | None:
        """Go through the file, from start to end, and give what its statistics count."""
        walk = Walk(self._store, self._describe)
        self._store.survey(walk.chunks())
        if walk.data_crc and not self._store.damage:
            self._check_data(walk)
        if walk.has_footer or walk.data_ended:  # behind the data there is only an index
            return walk.message_count
        size, last_ns = self._file.size, self._store.last_ns
        until = "" if last_ns is None else f", the last at log time {last_ns} ns"
        self._store.damage.note(
            f"breaks off after byte {walk.whole} of {size}, without a footer: every whole message "
            f"is read{until}; {size - walk.whole:,} bytes are lost or of a torn record"
        )
        return walk.message_count

    def _check_data(self, walk: Walk) -> None:
        """Messages outside chunks have no CRC but that of all data together."""
        if self._file.crc32(walk.data_bytes) != walk.data_crc:
            self._store.damage.note(
                f"the CRC of its data is wrong: some of their {walk.data_bytes:,} bytes are not as "
                "they were recorded, and nothing tells which"
            )

    def _describe(self, opcode: int, content: bytes, at: int) -> None:
        """Keep a channel or a schema, the first of each number; the summary's counts as first."""
        stream = ReadDataStream(BytesIO(content))
        try:
            if opcode == CHANNEL:
                channel = Channel.read(stream)
                if at < self._channels_at.get(channel.id, self._file.size):
                    self._channels[channel.id], self._channels_at[channel.id] = channel, at
            else:
                schema = Schema.read(stream)
                if at < self._schemas_at.get(schema.id, self._file.size):
                    self._schemas[schema.id], self._schemas_at[schema.id] = schema, at
        except (McapError, *BROKEN_BYTES) as error:
            kind = "channel" if opcode == CHANNEL else "schema"
            self._store.damage.note(f"the record of a {kind} is damaged: {error}")

    @property
    def losses(self) -> Sequence[Loss]:
        """What was found damaged so far."""
        return self._store.damage.losses(self._topics)

    def log_times(self, connection_id: int) -> NDArray[np.int64]:
        """The log times of a channel, from the index or from the survey at opening."""
        return self._store.log_times(connection_id)

    def batches(
        self, connection_ids: Collection[int], start_ns: int | None, end_ns: int | None
    ) -> Iterator[RawBatch]:
        """Messages in file order; a damaged chunk costs that chunk."""
        return self._store.batches(connection_ids, start_ns, end_ns)

    def close(self) -> None:
        """Release the file."""
        self._file.close()


def _connection(channel: Channel, schema: Schema | None) -> Connection:
    if schema is None:
        return Connection(channel.id, channel.topic, "", channel.message_encoding, "", "")
    name = schema.name
    # bytes that are no text come back by the same error handler
    errors = "surrogateescape" if schema.encoding == "protobuf" else "replace"
    return Connection(
        channel.id,
        channel.topic,
        # ROS 1 leaves out the /msg/ that ROS 2 has; a service's event has /srv/ in its place
        normalize_msgtype(name) if schema.encoding == "ros1msg" else name,
        channel.message_encoding,
        schema.data.decode(errors=errors),
        schema.encoding,
    )
