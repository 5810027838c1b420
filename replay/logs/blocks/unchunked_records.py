"""Read records outside chunks, or in chunks with a damaged header, and resynchronise."""

from typing import Final

import numpy as np

from replay.logs.blocks.block import Block
from replay.logs.blocks.block_groups import UNPACKED_GROUP_BYTES, Find, MessageRowIndex
from replay.logs.blocks.block_messages import BlockStore
from replay.logs.storage import LARGEST_BYTES, FileBytes

#: Bytes of the first read; they grow for a longer record.
_SMALLEST_WINDOW: Final = 65_536


class UnchunkedRecords:
    """Scanner that adds records outside chunks to a store, as blocks of bounded size."""

    def __init__(self, store: BlockStore) -> None:
        self._store = store
        # grows while records continue: if they soon end, most of a large read is wasted
        self._window = _SMALLEST_WINDOW

    def scan_records_up_to_next_chunk(self, offset: int, first_record_bytes: int) -> int:
        """Add records from `offset` on; return their end, at a chunk or at invalid bytes.

        Args:
            offset: offset of the first record.
            first_record_bytes: declared size of that record.
        """
        size = max(self._window, min(first_record_bytes, LARGEST_BYTES))
        data = np.frombuffer(self._store.file.read_bytes(offset, size), np.uint8)
        finders = self._store.record_finders
        _, stop = finders.scan(data, 0, data.size, np.empty((4, 0), np.int64), 0)
        self._window = min(2 * size, UNPACKED_GROUP_BYTES) if stop > size // 2 else _SMALLEST_WINDOW
        if stop:
            rows = MessageRowIndex(finders, data, 0)
            rows.add_rows_of_span(0, stop)
            self._store.add_scanned_block(
                Block(offset, offset, stop, "", stop), data, rows.indexed_rows
            )
        return offset + stop


#: Bytes of the first read after damage, which mostly is short: many small faults must not cost a
#: large read each. Half of it, by which reads overlap, is enough for a few records.
_SHORTEST: Final = 16_384
_LONGEST: Final = 8 * 2**20


def find_records_after_damage(file: FileBytes, damage_offset: int, find_record: Find) -> int | None:
    """Find the offset after damage at which records continue; None if they do not."""
    at, size = damage_offset + 1, _SHORTEST
    while at < file.size:
        data = np.frombuffer(file.read_bytes(at, size), np.uint8)
        found = find_record(data, 0, data.size, file.size - at)
        if found >= 0:
            return at + found
        at += max(data.size - _SHORTEST // 2, _SHORTEST // 2)
        size = min(2 * size, _LONGEST)
    return None
