"""Container of an MCAP file, read by its index or, if incomplete, from start to end."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Final, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.records import Channel, ChunkIndex, Metadata, Schema
from rosbags.typesys.msg import normalize_msgtype

from estimators.errors import LogError
from replay.logs.blocks import (
    Block,
    BlockFile,
    BlockStore,
    Describe,
    RecordFinders,
    UnchunkedRecords,
    find_records_after_damage,
    make_incomplete_end_clause,
    make_last_log_time_clause,
)
from replay.logs.mcap.mcap_records import (
    CHANNEL,
    CHUNK,
    DATA_END,
    DATA_END_BYTES,
    FOOTER,
    FOOTER_BYTES,
    MAGIC,
    MESSAGE,
    METADATA,
    RECORD_HEAD,
    SCHEMA,
    STATISTICS,
    Summary,
    count_indexed_messages,
    make_block_of_misplaced_chunk,
    read_chunk_header_as_block,
    read_indexed_times_of_chunk,
)
from replay.logs.messages.broken_bytes import (
    BROKEN_BYTES,
    KIND_BYTES,
    describe_file_of_other_format,
)
from replay.logs.storage import Connection, FileBytes

#: Most bytes of a metadata record that are read; one that identifies a machine is short.
_LARGEST_BYTES: Final = 2**20
_HEAD: Final = RECORD_HEAD.size
#: Length of the records that end data and file, so that a chunk with a damaged opcode does not.
_LENGTHS: Final = {FOOTER: FOOTER_BYTES, DATA_END: DATA_END_BYTES}


@dataclass(slots=True)
class McapWalk:
    """Walk over a file, which stores records outside chunks, and yields the chunks."""

    store: BlockStore
    describe: Describe
    #: offset at which the last complete record ends
    end: int = len(MAGIC)
    data_ended: bool = False
    has_footer: bool = False
    #: offset of the record that ends the data; 0 if there is none
    data_end: int = 0
    #: number of messages in the statistics record; None without one
    message_count: int | None = None

    def iter_chunks_of_file(self) -> Iterator[Block]:
        """Yield every chunk, including one cut off by the end of the file."""
        file = self.store.file
        stretches = UnchunkedRecords(self.store)
        at = len(MAGIC)
        while not self.has_footer and len(head := file.read_bytes(at, RECORD_HEAD.size)) == _HEAD:
            opcode, length = RECORD_HEAD.unpack(head)
            end = at + _HEAD + length
            block = read_chunk_header_as_block(file, at) if opcode == CHUNK else None
            if block is not None:
                yield block
                self.data_ended = False
            elif opcode in (SCHEMA, CHANNEL, MESSAGE) and not self.data_ended:
                end = stretches.scan_records_up_to_next_chunk(at, _HEAD + length)
            elif opcode in (0, CHUNK) or length != _LENGTHS.get(opcode, length):
                end = at
            if end > file.size and (block is not None or self.data_ended):
                break
            if end == at or end > file.size:
                end = find_records_after_damage(file, at, self.store.record_finders.find)
                if end is None:
                    break
                self.store.damage.note_unreadable_bytes(at, end)
            elif opcode in (DATA_END, FOOTER):
                self.data_ended = True
                self.data_end = at if opcode == DATA_END else self.data_end
                self.has_footer = opcode == FOOTER
            elif opcode in (SCHEMA, CHANNEL) and self.data_ended:
                self.describe(opcode, file.read_bytes(at + _HEAD, length), at)
            elif opcode == STATISTICS:
                self.message_count = int.from_bytes(file.read_bytes(at + _HEAD, 8), "little")
            self.end = at = end


class McapFile(BlockFile):
    """An MCAP file.

    The index is used only if it accounts for every message: chunks without a message index,
    messages outside chunks, channels missing from the summary and missing footers all occur in the
    field. Otherwise, the file is scanned at opening.
    """

    def _read_connections_or_scan(self) -> tuple[Connection, ...]:
        if self._file.read_bytes(0, len(MAGIC)) != MAGIC:
            start = self._file.read_bytes(0, KIND_BYTES)
            why = describe_file_of_other_format(
                start, "it does not start with the MCAP magic bytes"
            )
            raise LogError(f"{self._file.path}: not an MCAP file; {why}")
        summary = Summary(self._file)
        self._channels, self._schemas = dict(summary.channels), dict(summary.schemas)
        self._channels_at = dict.fromkeys(self._channels, -1)
        self._schemas_at = dict.fromkeys(self._schemas, -1)
        self._is_sealed = summary.is_sealed
        self._load_chunks_of_summary_index(summary)
        said = summary.message_count
        indexed, lost = self._store.message_count, self._store.damage.lost_message_count
        is_enough = indexed > 0 if said is None else lost is None or indexed + lost == said
        walk = None
        if not is_enough:
            self._store = self._make_store()
            walk = self._read_whole_file()
            said = walk.message_count if said is None else said
        found = self._store.message_count
        # the messages of damaged chunks, if all their numbers are known
        lost_messages = self._store.damage.lost_message_count or 0
        if said not in (None, found + lost_messages):
            self._store.damage.add_damage_sentence(
                f"its statistics count {said:,} messages, but {found:,} were found"
            )
        if walk is not None:
            self._note_missing_end(walk, summary.fault)
        return tuple(
            make_connection_of_channel(channel, self._schemas.get(channel.schema_id))
            for channel in self._channels.values()
        )

    @staticmethod
    def _import_record_finders() -> RecordFinders:
        from replay.logs.mcap.mcap_grammar import RECORD_FINDERS

        return RECORD_FINDERS

    def check_whole_file_and_count_valid_crcs(self) -> int:
        """Read the file from start to end, and compare the CRCs of data and summary."""
        walk = McapWalk(self._make_second_pass_store(), self._process_non_message_record)
        self._note_blocks_missed_by_first_pass(walk.iter_chunks_of_file(), walk.store)
        if not (walk.data_end and walk.has_footer) and not self._store.damage:
            self._store.damage.add_damage_sentence(
                "reading its records in order finds no end of data or no footer"
            )
        return (
            self._store.valid_crc_count + self._is_sealed + self._is_data_crc_valid(walk.data_end)
        )

    def _is_data_crc_valid(self, end_offset: int) -> bool:
        """Check the CRC of the data up to `end_offset`; whether there is one and it agrees."""
        said = (
            int.from_bytes(self._file.read_bytes(end_offset + RECORD_HEAD.size, 4), "little")
            if end_offset
            else 0
        )
        if not said:  # 0: the writer computed none
            return False
        agrees = self._file.compute_crc32_before_offset(end_offset) == said
        if not agrees:
            self._store.damage.add_damage_sentence(
                f"the CRC of its data is wrong: some of the {end_offset:,} bytes differ from those "
                "recorded, and it is not known which"
            )
        return agrees

    def _load_chunks_of_summary_index(self, summary: Summary) -> None:
        described = all(c.schema_id in {0, *summary.schemas} for c in summary.channels.values())
        unknown: list[Block] = []
        chunks = {chunk.chunk_start_offset: chunk for chunk in summary.chunks}
        for offset in sorted(chunks):
            chunk = chunks[offset]
            counts = count_indexed_messages(chunk)
            block = read_chunk_header_as_block(self._file, offset, counts)
            read_times = partial(read_indexed_times_of_chunk, self._file, chunk)
            is_described = described and self._channels.keys() >= counts.keys()
            # the index follows all chunks, so that the end of the file cannot truncate a chunk
            if block is None or block.is_truncated:
                lost = make_block_of_misplaced_chunk(chunk)
                self._store.note_lost_block(
                    lost, read_times() or {}, "it is not at the position that the index gives"
                )
            elif counts and is_described and _does_chunk_match_indexed_times(chunk, block):
                self._store.add_block_with_unread_times(block, read_times)
            else:
                unknown.append(block)
        if unknown:
            self._store.add_unindexed_blocks(unknown)

    def _read_whole_file(self) -> McapWalk:
        """Read the file from start to end."""
        walk = McapWalk(self._store, self._process_non_message_record)
        self._store.add_unindexed_blocks(walk.iter_chunks_of_file())
        if not self._store.damage:
            # the only CRC of messages outside chunks is that of the whole data section
            self._is_data_crc_valid(walk.data_end)
        return walk

    def _note_missing_end(self, file_walk: McapWalk, index_fault: str) -> None:
        """Note what is missing after the data; `index_fault` says why the index is unusable."""
        if file_walk.has_footer or file_walk.data_ended:  # only the index follows the data
            if index_fault:
                self._store.damage.add_damage_sentence(
                    f"{index_fault}: torn or damaged after the data, which is complete and was "
                    "scanned from start to end"
                )
            return
        size = self._file.size
        torn = make_incomplete_end_clause(size - file_walk.end, self._store.truncated_message_count)
        self._store.damage.add_damage_sentence(
            f"breaks off after byte {file_walk.end} of {size}, without a footer: all whole "
            f"messages are read{make_last_log_time_clause(self._store.last_ns)}{torn}"
        )

    def _process_non_message_record(self, opcode: int, content: bytes, offset: int) -> None:
        """Keep the channel or schema of each id that is first in the file."""
        stream = ReadDataStream(BytesIO(content))
        try:
            record = Channel.read(stream) if opcode == CHANNEL else Schema.read(stream)
        except (McapError, *BROKEN_BYTES) as error:
            kind = "channel" if opcode == CHANNEL else "schema"
            self._store.damage.add_damage_sentence(f"the record of a {kind} is damaged: {error}")
            return
        if isinstance(record, Channel):
            if offset < self._channels_at.get(record.id, self._file.size):
                self._channels[record.id], self._channels_at[record.id] = record, offset
        elif offset < self._schemas_at.get(record.id, self._file.size):
            self._schemas[record.id], self._schemas_at[record.id] = record, offset


def _does_chunk_match_indexed_times(chunk: ChunkIndex, block: Block) -> bool:
    indexed = chunk.message_start_time, chunk.message_end_time
    return (block.first_ns, block.last_ns) == indexed


def make_connection_of_channel(channel: Channel, schema: Schema | None) -> Connection:
    """Make a connection from a channel and its schema, which is None if the channel has none."""
    if schema is None:
        return Connection(channel.id, channel.topic, "", channel.message_encoding, "", "")
    name = schema.name
    # bytes that are not text are restored by the same error handler
    errors = "surrogateescape" if schema.encoding == "protobuf" else "replace"
    return Connection(
        channel.id,
        channel.topic,
        # ROS 1 omits the /msg/ of ROS 2; the event of a service has /srv/ instead
        normalize_msgtype(name) if schema.encoding == "ros1msg" else name,
        channel.message_encoding,
        schema.data.decode(errors=errors),
        schema.encoding,
    )


class MetadataRecord(NamedTuple):
    """Name and values of a metadata record of MCAP."""

    name: str
    values: Mapping[str, str]


def read_metadata_records(path: Path) -> list[MetadataRecord]:
    """Read the metadata records that the summary lists; empty if it is damaged.

    A truncated file has no summary, and is not searched for metadata records.
    """
    file = FileBytes(path)
    try:
        found: list[MetadataRecord] = []
        for index in Summary(file).metadata:
            data = file.read_bytes(index.offset, min(index.length, _LARGEST_BYTES))
            if len(data) < RECORD_HEAD.size or data[0] != METADATA:
                continue
            try:
                record = Metadata.read(ReadDataStream(BytesIO(data[RECORD_HEAD.size :])))
            except (McapError, *BROKEN_BYTES):
                continue
            found.append(MetadataRecord(record.name, record.metadata))
        return found
    finally:
        file.close()
