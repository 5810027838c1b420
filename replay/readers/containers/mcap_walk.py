"""Walk through an MCAP file without an index, from its start to its end, over what is damaged."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from replay.readers.containers.block import LARGEST_BYTES, Block
from replay.readers.containers.block_store import BlockStore
from replay.readers.containers.mcap_index import chunk_block
from replay.readers.containers.mcap_records import (
    CHANNEL,
    CHUNK,
    DATA_END,
    FOOTER,
    GRAMMAR,
    MAGIC,
    MESSAGE,
    RECORD_HEAD,
    SCHEMA,
)
from replay.readers.containers.read_ahead import SLAB_BYTES
from replay.readers.containers.records import scan_rows
from replay.readers.containers.resume import resume

_HEAD: Final = RECORD_HEAD.size
_SMALLEST_WINDOW: Final = 65_536


@dataclass(slots=True)
class Walk:
    """Adds what stands outside chunks to a store, and yields the chunks."""

    store: BlockStore
    #: where the last whole record ends
    whole: int = len(MAGIC)
    data_ended: bool = False
    has_footer: bool = False
    _window: int = _SMALLEST_WINDOW

    def chunks(self) -> Iterator[Block]:
        """Every chunk, the one that the end of the file tears among them."""
        file = self.store.file
        at = len(MAGIC)
        while not self.has_footer and len(head := file.read(at, RECORD_HEAD.size)) == _HEAD:
            opcode, length = RECORD_HEAD.unpack(head)
            end = at + _HEAD + length
            block = chunk_block(file, at) if opcode == CHUNK else None
            if block is not None:
                yield block
                self.data_ended = False
            elif opcode in (SCHEMA, CHANNEL, MESSAGE):
                end = self._records(at, length)
            elif opcode in (0, CHUNK):
                end = at
            if end > file.size and (block is not None or self.data_ended):
                break
            if end == at or end > file.size:
                end = resume(file, at, GRAMMAR.find)
                if end is None:
                    break
                self.store.damage.skip(at, end)
            elif opcode in (DATA_END, FOOTER):
                self.data_ended = True
                self.has_footer = opcode == FOOTER
            self.whole = at = end

    def _records(self, at: int, length: int) -> int:
        """Add the records from `at` on, and say where they end: at a chunk, or what is none."""
        file = self.store.file
        size = max(self._window, min(_HEAD + length, LARGEST_BYTES))
        data = np.frombuffer(file.read(at, size), np.uint8)
        _, stop = GRAMMAR.scan(data, 0, data.size, np.empty((4, 0), np.int64), 0)
        self._window = min(2 * size, SLAB_BYTES) if stop > size // 2 else _SMALLEST_WINDOW
        if stop:
            rows, _ = scan_rows(GRAMMAR, data, [(0, stop)])
            self.store.add_rows(Block(at, at, stop, "", stop), data, rows)
            self.data_ended = False
        return at + stop
