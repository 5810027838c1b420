"""Common code of growing bags and MCAP files, which are read up to the last complete record."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from analysis.model.loss import Loss
from replay.logs.blocks.block import Block, DamagedBlockError, unpack_block_into
from replay.logs.blocks.block_groups import MessageRowIndex, RecordFinders
from replay.logs.messages.raw_batch import RawBatch
from replay.logs.storage import (
    KEY,
    LARGEST_BYTES,
    LENGTH,
    OFFSET,
    TIME,
    Connection,
    FileBytes,
    LossList,
    group_rows_by_connection,
)

#: Bytes of records outside chunks that are read at once.
_LOOSE_BYTES: Final = 4 * 2**20
#: Bytes of messages at which a poll ends, with the chunk that exceeds them.
_POLL_BYTES: Final = 16 * 2**20


class _CompleteRecords(NamedTuple):
    """Messages of complete records, and offset of the first incomplete one."""

    batches: list[RawBatch]
    incomplete_offset: int


class GrowingBlockFile(ABC):
    """A growing file of blocks, read up to its last complete record."""

    def __init__(self, path: Path) -> None:
        self.connections: dict[int, Connection] = {}
        self.is_finished = False
        self.read_error = ""
        self._file = FileBytes(path)
        self._losses = LossList()
        #: offset of the first record not read yet; 0 before the file's header is read
        self._at = 0
        #: whether the last poll ended at an incomplete record
        self._is_truncated = False

    @staticmethod
    @abstractmethod
    def _import_record_finders() -> RecordFinders:
        """Import the functions that find records of the format in bytes."""

    @abstractmethod
    def _process_non_message_record(self, opcode: int, content: bytes) -> None:
        """Process a record other than a message."""

    @abstractmethod
    def _read_next_record_batches(self) -> list[RawBatch] | None:
        """Process the record at `_at` and advance; return its messages, None if incomplete."""

    @property
    def losses(self) -> Sequence[Loss]:
        """Damage found so far."""
        return [*self._losses]

    def poll(self) -> list[RawBatch]:
        """See `Tail.poll`."""
        self._file.update_size()
        batches: list[RawBatch] = []
        self._is_truncated = False
        while not self.is_finished and sum(batch.data.size for batch in batches) < _POLL_BYTES:
            found = self._read_next_record_batches()
            if found is None:
                self._is_truncated = self._at < self._file.size
                break
            batches += found
        return batches

    def finish_and_note_incomplete_end(self) -> None:
        """See `Tail.finish_and_note_incomplete_end`."""
        if self._is_truncated:
            rest = self._file.size - self._at
            what = f"it ends inside a record or chunk: its last {rest:,} bytes are not read"
            self._losses.add_loss(self._file.path, what)

    def close(self) -> None:
        """Release the file."""
        self._file.close()

    def _unpack_messages_of_chunk(self, block: Block) -> list[RawBatch]:
        """Unpack the messages of a complete chunk; a damaged chunk becomes a loss."""
        try:
            if block.max_unpacked_bytes > LARGEST_BYTES:
                raise DamagedBlockError(
                    f"it declares {block.max_unpacked_bytes:,} bytes, more than the limit of "
                    f"{LARGEST_BYTES:,}"
                )
            data = np.empty(block.max_unpacked_bytes, np.uint8)
            data = data[: unpack_block_into(block, self._file, data)]
        except DamagedBlockError as error:
            what = f"the chunk at byte {block.record_offset} cannot be read: {error}"
            self._losses.add_loss(self._file.path, what)
            return []
        batches, _ = self._split_complete_records(data)
        return batches

    def _take_unchunked_messages(self, first_record_bytes: int) -> list[RawBatch]:
        """Read messages outside chunks from `_at` on, of which the first is complete."""
        data = self._file.read_byte_array(self._at, max(first_record_bytes, _LOOSE_BYTES))
        batches, whole = self._split_complete_records(data)
        self._at += max(whole, first_record_bytes)
        return batches

    def _split_complete_records(self, data: NDArray[np.uint8]) -> _CompleteRecords:
        """Find messages in bytes (n,), and the offset of the first incomplete record."""
        finders = self._import_record_finders()
        _, whole = finders.scan(data, 0, data.size, np.empty((4, 0), np.int64), 0)
        index = MessageRowIndex(finders, data, 0)
        index.add_rows_of_span(0, whole)
        rows = index.indexed_rows
        for key, _, offset, length in rows[:, rows[KEY] < 0].T.tolist():
            self._process_non_message_record(-1 - key, data[offset : offset + length].tobytes())
        return _CompleteRecords(
            [
                RawBatch(key, data, rows[OFFSET, at], rows[LENGTH, at], rows[TIME, at])
                for key, at in group_rows_by_connection(rows[KEY])
            ],
            whole,
        )
