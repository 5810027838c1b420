"""Walk through an MCAP file without an index, from its start to its end, over what is damaged."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from replay.logs.blocks import Block, BlockStore, Describe, LooseRecords, resync
from replay.logs.mcap.mcap_records import (
    CHANNEL,
    CHUNK,
    DATA_END,
    DATA_END_BYTES,
    FOOTER,
    FOOTER_BYTES,
    MAGIC,
    MESSAGE,
    RECORD_HEAD,
    SCHEMA,
    STATISTICS,
    chunk_block,
)

_HEAD: Final = RECORD_HEAD.size
#: A chunk whose opcode is damaged must not end the file.
_LENGTHS: Final = {FOOTER: FOOTER_BYTES, DATA_END: DATA_END_BYTES}


@dataclass(slots=True)
class McapWalk:
    """Adds what stands outside chunks to a store, and yields the chunks."""

    store: BlockStore
    describe: Describe
    #: where the last whole record ends
    whole: int = len(MAGIC)
    data_ended: bool = False
    has_footer: bool = False
    #: where the record begins that ends the data; 0 where there is none
    data_end: int = 0
    #: as the statistics say
    message_count: int | None = None

    def chunks(self) -> Iterator[Block]:
        """Every chunk, the one that the end of the file tears among them."""
        file = self.store.file
        stretches = LooseRecords(self.store)
        at = len(MAGIC)
        while not self.has_footer and len(head := file.read(at, RECORD_HEAD.size)) == _HEAD:
            opcode, length = RECORD_HEAD.unpack(head)
            end = at + _HEAD + length
            block = chunk_block(file, at) if opcode == CHUNK else None
            if block is not None:
                yield block
                self.data_ended = False
            elif opcode in (SCHEMA, CHANNEL, MESSAGE) and not self.data_ended:
                end = stretches.add(at, _HEAD + length)
            elif opcode in (0, CHUNK) or length != _LENGTHS.get(opcode, length):
                end = at
            if end > file.size and (block is not None or self.data_ended):
                break
            if end == at or end > file.size:
                end = resync(file, at, self.store.grammar.find)
                if end is None:
                    break
                self.store.damage.skip(at, end)
            elif opcode in (DATA_END, FOOTER):
                self.data_ended = True
                self.data_end = at if opcode == DATA_END else self.data_end
                self.has_footer = opcode == FOOTER
            elif opcode in (SCHEMA, CHANNEL) and self.data_ended:
                self.describe(opcode, file.read(at + _HEAD, length), at)
            elif opcode == STATISTICS:
                self.message_count = int.from_bytes(file.read(at + _HEAD, 8), "little")
            self.whole = at = end
