"""Container of a ROS 1 bag (version 2.0), read by its index or, if damaged, from the start."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from rosbags.typesys.msg import normalize_msgtype

from estimators.errors import LogError
from replay.logs.bag.bag_index import (
    BagIndex,
    make_block_of_chunk_record,
    read_bag_index,
    read_indexed_log_times,
)
from replay.logs.bag.bag_records import (
    BAG_HEADER,
    CHUNK_INFO,
    CONNECTION,
    INDEX_DATA,
    MAGIC,
    MESSAGE,
    VERSION,
    BagRecord,
    parse_header_fields,
    read_bag_record,
)
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
from replay.logs.messages.broken_bytes import KIND_BYTES, describe_file_of_other_format
from replay.logs.storage import Connection

#: Field that each kind of record must have, so that a chunk with a damaged op is not ignored.
_KNOWN: Final = {
    BAG_HEADER: b"index_pos",
    INDEX_DATA: b"conn",
    CHUNK_INFO: b"chunk_pos",
    CONNECTION: b"conn",
}


class BagFile(BlockFile):
    """A ROS 1 bag. A bag without an index (the recorder crashed) is scanned when opened."""

    def _read_connections_or_scan(self) -> tuple[Connection, ...]:
        path = self._file.path
        head = self._file.read_bytes(0, len(MAGIC + VERSION))
        if not head.startswith(MAGIC):
            start = self._file.read_bytes(0, KIND_BYTES)
            why = describe_file_of_other_format(start, "it does not start with '#ROSBAG V2.0'")
            raise LogError(f"{path}: not a ROS 1 bag; {why}")
        if not head.endswith(VERSION):
            version = head.removeprefix(MAGIC).split(b"\n")[0].decode(errors="replace")
            raise LogError(
                f"{path}: is a bag of version {version}, but only 2.0 can be read; convert it with "
                f"'rosbag fix {path.name}'"
            )
        self._connections: dict[int, Connection] = {}
        self._connections_at: dict[int, int] = {}
        header = read_bag_record(self._file, len(head))
        index = self._read_index_named_in_header(header)
        if index is not None:
            self._load_connections_and_chunks_of_index(index)
        else:
            self._read_whole_file(len(head), header)
        return tuple(self._connections.values())

    @staticmethod
    def _import_record_finders() -> RecordFinders:
        from replay.logs.bag.bag_grammar import RECORD_FINDERS

        return RECORD_FINDERS

    def check_whole_file_and_count_valid_crcs(self) -> int:
        """Read the file from start to end; a bag has no CRCs."""
        walk = BagWalk(
            self._make_second_pass_store(), len(MAGIC + VERSION), self._process_non_message_record
        )
        self._note_blocks_missed_by_first_pass(walk.iter_chunks_of_file(), walk.store)
        return self._store.valid_crc_count

    def _read_index_named_in_header(self, header: BagRecord | None) -> BagIndex | None:
        names = (b"index_pos", b"conn_count", b"chunk_count")
        if header is None or header.opcode != BAG_HEADER or not header.fields.keys() >= set(names):
            return None
        position, connections, chunks = (header.decode_unsigned_field(name) for name in names)
        if not header.end_offset <= position <= self._file.size or (
            position == self._file.size
        ) != (connections == chunks == 0):
            return None
        return read_bag_index(self._file, position, connections, chunks)

    def _load_connections_and_chunks_of_index(self, index: BagIndex) -> None:
        """Add connections and chunks from the index."""
        for record, data in index.connections:
            self._store_connection_or_note_damage(record.fields, data, -1)
        unknown: list[Block] = []
        for offset in sorted(index.chunks):
            counts = index.chunks[offset]
            block = make_block_of_chunk_record(
                self._file, offset, read_bag_record(self._file, offset)
            )
            # the index follows all chunks, so that the end of the file cannot truncate a chunk
            if block is None or (block.is_truncated and counts):
                lost = Block(offset, 0, 0, "", 0, counts=counts)
                self._store.damage.note_lost_block(
                    lost, "it is not at the position that the index gives"
                )
                continue
            times = read_indexed_log_times(self._file, block, counts)
            if times is None:
                unknown.append(block)
            else:
                self._store.add_block_with_times(block, times)
        if unknown:
            self._store.add_unindexed_blocks(unknown)

    def _read_whole_file(self, begin_offset: int, header: BagRecord | None) -> None:
        """Read the file from start to end."""
        damage = self._store.damage
        walk = BagWalk(self._store, begin_offset, self._process_non_message_record)
        self._store.add_unindexed_blocks(walk.iter_chunks_of_file())
        position = b"" if header is None else header.fields.get(b"index_pos", b"")
        unfinished = position == bytes(8)
        why = "the recorder did not finish it" if unfinished else "the index is damaged"
        torn = make_incomplete_end_clause(
            self._file.size - walk.end, self._store.truncated_message_count
        )
        damage.add_damage_sentence(
            f"{why}: scanned from start to end, all whole messages are read"
            f"{make_last_log_time_clause(self._store.last_ns)}{torn}"
        )

    def _process_non_message_record(self, opcode: int, content: bytes, offset: int) -> None:
        """Process a connection record from its header and data."""
        del opcode
        size = int.from_bytes(content[:4], "little")
        self._store_connection_or_note_damage(
            parse_header_fields(content[4 : 4 + size]) or {}, content[8 + size :], offset
        )

    def _store_connection_or_note_damage(
        self, header_fields: dict[bytes, bytes], data: bytes, offset: int
    ) -> None:
        connection = parse_connection_record(header_fields, data)
        if connection is None:
            self._store.damage.add_damage_sentence("the record of a connection is damaged")
        elif offset < self._connections_at.get(connection.id, self._file.size):
            self._connections_at[connection.id] = offset
            self._connections[connection.id] = connection


def parse_connection_record(header_fields: dict[bytes, bytes], data: bytes) -> Connection | None:
    """Make a connection from a record's header fields and data; None if damaged."""
    inner = parse_header_fields(data) or {}
    key, topic = (
        header_fields.get(b"conn", b""),
        header_fields.get(b"topic", inner.get(b"topic", b"")),
    )
    if len(key) != 4 or b"type" not in inner:
        return None
    return Connection(
        int.from_bytes(key, "little"),
        topic.decode(errors="replace"),
        normalize_msgtype(inner[b"type"].decode(errors="replace")),
        "ros1",
        inner.get(b"message_definition", b"").decode(errors="replace"),
        "ros1msg",
    )


@dataclass(slots=True)
class BagWalk:
    """Walk over the records of a file, which processes connections and yields the chunks."""

    store: BlockStore
    #: offset at which the last complete record ends
    end: int
    describe: Describe

    def iter_chunks_of_file(self) -> Iterator[Block]:
        """Yield every chunk, including one cut off by the end of the file."""
        file = self.store.file
        stretches = UnchunkedRecords(self.store)
        at = self.end
        while at < file.size:
            record = read_bag_record(file, at)
            block = make_block_of_chunk_record(file, at, record)
            end = at
            if block is not None:
                yield block
                if block.is_truncated:
                    return
                end = block.offset + block.stored_bytes
            elif record is not None and record.opcode == MESSAGE:
                end = stretches.scan_records_up_to_next_chunk(at, record.end_offset - at)
            elif record is not None and _KNOWN.get(record.opcode) in record.fields:
                end = record.end_offset if record.end_offset <= file.size else at
                if record.opcode == CONNECTION:
                    self.describe(CONNECTION, file.read_bytes(at, end - at), at)
            if end == at:
                found = find_records_after_damage(file, at, self.store.record_finders.find)
                if found is None:
                    return
                self.store.damage.note_unreadable_bytes(at, found)
                end = found
            self.end = at = end
