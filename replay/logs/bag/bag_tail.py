"""Read a ROS 1 bag that is still being written (`.bag.active`, or under its final name)."""

from estimators.errors import LogError
from replay.logs.bag.bag_file import parse_connection_record
from replay.logs.bag.bag_index import make_block_of_chunk_record
from replay.logs.bag.bag_records import (
    BAG_HEADER,
    CHUNK,
    CONNECTION,
    MAGIC,
    MESSAGE,
    VERSION,
    parse_header_fields,
    read_bag_record,
)
from replay.logs.blocks import GrowingBlockFile, RecordFinders
from replay.logs.messages.raw_batch import RawBatch

_HEAD = MAGIC + VERSION


class BagTail(GrowingBlockFile):
    """A growing bag; it is finished when the recorder has written the position of its index.

    A chunk without a size is open: rosbag writes the size when the chunk is full.
    """

    @staticmethod
    def _import_record_finders() -> RecordFinders:
        from replay.logs.bag.bag_grammar import RECORD_FINDERS

        return RECORD_FINDERS

    def _read_next_record_batches(self) -> list[RawBatch] | None:
        file = self._file
        if self._at == 0:
            return self._read_first_line_if_complete()
        if 0 < self._read_index_offset() <= self._at:
            self.is_finished = True
            return []
        record = read_bag_record(file, self._at)
        if record is None or record.end_offset > file.size:
            return None
        if record.opcode == CHUNK:
            block = make_block_of_chunk_record(file, self._at, record)
            # nothing follows an empty chunk yet: it may have just been opened
            if (
                block is None
                or block.is_truncated
                or (record.end_offset == file.size and not block.max_unpacked_bytes)
            ):
                return None
            self._at = record.end_offset
            return self._unpack_messages_of_chunk(block)
        if record.opcode == MESSAGE:
            return self._take_unchunked_messages(record.end_offset - self._at)
        if record.opcode == CONNECTION:
            self._process_non_message_record(
                CONNECTION, file.read_bytes(self._at, record.end_offset - self._at)
            )
        self._at = record.end_offset
        return []

    def _read_first_line_if_complete(self) -> list[RawBatch] | None:
        """Check the first line of the file; None while it is incomplete."""
        head = self._file.read_bytes(0, len(_HEAD))
        if not _HEAD.startswith(head):
            raise LogError(
                f"{self._file.path}: not a ROS 1 bag of version 2.0; it does not start with "
                "'#ROSBAG V2.0'"
            )
        if len(head) == len(_HEAD):
            self._at = len(_HEAD)
            return []
        return None

    def _read_index_offset(self) -> int:
        """Read the offset of the index; 0 until the recorder has written it."""
        header = read_bag_record(self._file, len(_HEAD))
        if header is None or header.opcode != BAG_HEADER or b"index_pos" not in header.fields:
            return 0
        return header.decode_unsigned_field(b"index_pos")

    def _process_non_message_record(self, opcode: int, content: bytes) -> None:
        del opcode
        size = int.from_bytes(content[:4], "little")
        fields = parse_header_fields(content[4 : 4 + size]) or {}
        connection = parse_connection_record(fields, content[8 + size :])
        if connection is None:
            self._losses.add_loss(self._file.path, "the record of a connection is damaged")
        else:
            self.connections.setdefault(connection.id, connection)
