"""Messages that stand outside chunks, or in one whose beginning is damaged."""

from typing import Final

import numpy as np

from replay.readers.containers.block import LARGEST_BYTES, Block
from replay.readers.containers.block_store import BlockStore
from replay.readers.containers.read_ahead import SLAB_BYTES
from replay.readers.containers.records import Rows

_SMALLEST_WINDOW: Final = 65_536


class Stretches:
    """Takes what stands between chunks into a store, as blocks of bounded size."""

    def __init__(self, store: BlockStore) -> None:
        self._store = store
        # grows while records go on, since where they do not most of a large read is for nothing
        self._window = _SMALLEST_WINDOW

    def add(self, at: int, record_bytes: int) -> int:
        """Add records from `at` on, and say where they end: at a chunk, or what is none.

        Args:
            at: where the first record begins.
            record_bytes: what that record says it has.
        """
        size = max(self._window, min(record_bytes, LARGEST_BYTES))
        data = np.frombuffer(self._store.file.read(at, size), np.uint8)
        grammar = self._store.grammar
        _, stop = grammar.scan(data, 0, data.size, np.empty((4, 0), np.int64), 0)
        self._window = min(2 * size, SLAB_BYTES) if stop > size // 2 else _SMALLEST_WINDOW
        if stop:
            rows = Rows(grammar, data, 0)
            rows.scan(0, stop)
            self._store.add_rows(Block(at, at, stop, "", stop), data, rows.found)
        return at + stop
