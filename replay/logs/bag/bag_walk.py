"""Walk through a ROS 1 bag without an index, from its start to its end, over what is damaged."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from replay.logs.bag.bag_index import chunk_block
from replay.logs.bag.bag_records import (
    BAG_HEADER,
    CHUNK_INFO,
    CONNECTION,
    INDEX_DATA,
    MESSAGE,
    read_record,
)
from replay.logs.blocks import Block, BlockStore, Describe, LooseRecords, resync

#: By a field that it must have: a chunk whose op is damaged must not be passed over in silence.
_KNOWN: Final = {
    BAG_HEADER: b"index_pos",
    INDEX_DATA: b"conn",
    CHUNK_INFO: b"chunk_pos",
    CONNECTION: b"conn",
}


@dataclass(slots=True)
class BagWalk:
    """Tells of connections that stand outside chunks, and yields the chunks."""

    store: BlockStore
    #: where the last whole record ends
    whole: int
    describe: Describe

    def chunks(self) -> Iterator[Block]:
        """Every chunk, the one that the end of the file tears among them."""
        file = self.store.file
        stretches = LooseRecords(self.store)
        at = self.whole
        while at < file.size:
            record = read_record(file, at)
            block = chunk_block(file, at, record)
            end = at
            if block is not None:
                yield block
                if block.is_torn:
                    return
                end = block.offset + block.stored_bytes
            elif record is not None and record.op == MESSAGE:
                end = stretches.add(at, record.end - at)
            elif record is not None and _KNOWN.get(record.op) in record.fields:
                end = record.end if record.end <= file.size else at
                if record.op == CONNECTION:
                    self.describe(CONNECTION, file.read(at, end - at), at)
            if end == at:
                found = resync(file, at, self.store.grammar.find)
                if found is None:
                    return
                self.store.damage.skip(at, found)
                end = found
            self.whole = at = end
