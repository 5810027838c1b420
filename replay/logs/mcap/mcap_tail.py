"""Read an MCAP file that is still being written."""

from io import BytesIO
from pathlib import Path
from typing import Final

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.records import Channel, Schema

from estimators.errors import LogError
from replay.logs.blocks import GrowingBlockFile, RecordFinders
from replay.logs.mcap.mcap_file import make_connection_of_channel
from replay.logs.mcap.mcap_records import (
    CHANNEL,
    CHUNK,
    DATA_END,
    FOOTER,
    MAGIC,
    MESSAGE,
    RECORD_HEAD,
    SCHEMA,
    read_chunk_header_as_block,
)
from replay.logs.messages.broken_bytes import BROKEN_BYTES
from replay.logs.messages.raw_batch import RawBatch

_LOOSE: Final = (SCHEMA, CHANNEL, MESSAGE)


class McapTail(GrowingBlockFile):
    """A growing MCAP file; it is finished when its data section ends."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._schemas: dict[int, Schema] = {}

    @staticmethod
    def _import_record_finders() -> RecordFinders:
        from replay.logs.mcap.mcap_grammar import RECORD_FINDERS

        return RECORD_FINDERS

    def _read_next_record_batches(self) -> list[RawBatch] | None:
        file = self._file
        if self._at == 0:
            return self._read_magic_if_complete()
        head = file.read_bytes(self._at, RECORD_HEAD.size)
        if len(head) < RECORD_HEAD.size:
            return None
        opcode, length = RECORD_HEAD.unpack(head)
        if opcode == 0 or self._at + RECORD_HEAD.size + length > file.size:
            return None
        if opcode in (DATA_END, FOOTER):
            self.is_finished = True
            return []
        if opcode in _LOOSE:
            return self._take_unchunked_messages(RECORD_HEAD.size + length)
        block = read_chunk_header_as_block(file, self._at) if opcode == CHUNK else None
        self._at += RECORD_HEAD.size + length
        return [] if block is None else self._unpack_messages_of_chunk(block)

    def _read_magic_if_complete(self) -> list[RawBatch] | None:
        """Check the magic of the file; None while it is incomplete."""
        head = self._file.read_bytes(0, len(MAGIC))
        if not MAGIC.startswith(head):
            raise LogError(
                f"{self._file.path}: not an MCAP file; it does not start with the MCAP magic bytes"
            )
        if len(head) < len(MAGIC):
            return None
        self._at = len(MAGIC)
        return []

    def _process_non_message_record(self, opcode: int, content: bytes) -> None:
        stream = ReadDataStream(BytesIO(content))
        try:
            record = Channel.read(stream) if opcode == CHANNEL else Schema.read(stream)
        except (McapError, *BROKEN_BYTES) as error:
            kind = "channel" if opcode == CHANNEL else "schema"
            self._losses.add_loss(self._file.path, f"the record of a {kind} is damaged: {error}")
            return
        if isinstance(record, Schema):
            self._schemas.setdefault(record.id, record)
        elif record.id not in self.connections:
            schema = self._schemas.get(record.schema_id)
            self.connections[record.id] = make_connection_of_channel(record, schema)
