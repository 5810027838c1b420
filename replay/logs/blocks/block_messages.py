"""Read the messages of a file of blocks: connection, log time and bytes of each."""

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import cached_property
from threading import Lock
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from replay.logs.blocks.block import Block
from replay.logs.blocks.block_damage import BlockDamage
from replay.logs.blocks.block_groups import (
    ChunkStats,
    RecordFinders,
    UnpackedBlockGroup,
    count_messages_of_chunks,
    iter_unpacked_block_groups,
    select_messages_of_connections,
)
from replay.logs.storage import (
    END_NS,
    KEY,
    TIME,
    BatchGroup,
    FileBytes,
    group_rows_by_connection,
    make_empty_log_times,
)

#: Latest possible log time in ns.
_INT64_MAX: Final = 2**63 - 1

#: Function that reads the log times (as 64 bits) of a block by connection from its index; None if
#: the index is incomplete.
ReadTimes = Callable[[], Mapping[int, NDArray[np.int64]] | None]
#: (opcode, bytes, offset): process a record that is not a message. Records arrive in any order; of
#: several about the same thing, the first in the file counts, since repetitions may be damaged.
Describe = Callable[[int, bytes, int], None]


class BlockStore:
    """Blocks in file order, with the log times of their messages."""

    def __init__(
        self,
        file: FileBytes,
        load_finders: Callable[[], RecordFinders],
        describe: Describe,
    ) -> None:
        """Create an empty store.

        Args:
            file: file that contains the blocks.
            load_finders: function that loads the compiled record finders, not needed with an index.
            describe: called with each record that is not a message.
        """
        self.file = file
        self.damage = BlockDamage(file.path.name)
        self._load_finders = load_finders
        self._process_non_message_record = describe
        self._blocks: list[Block] = []
        self._times: dict[int, list[NDArray[np.int64]]] = {}
        self._late: dict[int, int] = {}
        self._counts: Counter[int] = Counter()
        #: blocks whose log times are in an index, from which they are read when requested
        self._unread: list[tuple[Block, ReadTimes]] = []
        self._reading = Lock()
        #: offsets of the blocks whose CRCs agree
        self._sealed: set[int] = set()
        self._topics: Mapping[int, str] = {}

    @cached_property
    def record_finders(self) -> RecordFinders:
        """Functions that find records in bytes."""
        return self._load_finders()

    @property
    def message_count(self) -> int:
        """Number of messages in all blocks."""
        return self._counts.total()

    @property
    def truncated_message_count(self) -> int:
        """Number of messages in the block cut off by the end of the file."""
        return sum(sum(block.counts.values()) for block in self._blocks if block.is_truncated)

    @property
    def valid_crc_count(self) -> int:
        """Number of CRCs that were compared and agree."""
        return len(self._sealed)

    @property
    def last_ns(self) -> int | None:
        """Latest log time; None without messages."""
        return max((b.last_ns for b in self._blocks if b.counts), default=None)

    @property
    def log_time_lower_bound_ns(self) -> int:
        """Lower bound of all log times."""
        return min((b.first_ns for b in self._blocks if b.counts), default=END_NS)

    @property
    def offsets_of_blocks_with_messages(self) -> Iterator[int]:
        """Offsets of the blocks that contain messages."""
        return (block.record_offset for block in self._blocks if block.counts)

    def note_blocks_missing_from_store(self, offsets: Iterable[int]) -> None:
        """Note as damage the blocks at these offsets that the store lacks."""
        known = {block.record_offset for block in self._blocks}
        for offset in offsets:
            if offset not in known and not self.damage.is_block_lost(offset):
                self.damage.add_damage_sentence(
                    f"the index omits the records at byte {offset}: not read"
                )

    def add_block_with_times(
        self, block: Block, log_times: Mapping[int, NDArray[np.int64]]
    ) -> None:
        """Add a block with the log times (64 bits) of its messages, by connection."""
        described, usable = complete_block_by_log_times(block, log_times)
        self._blocks.append(described)
        self._counts.update(described.counts)
        for key, values in usable.items():
            self._late[key] = self._late.get(key, 0) + log_times[key].size - values.size
            self._times.setdefault(key, []).append(values)

    def add_block_with_unread_times(self, block: Block, read_times: ReadTimes) -> None:
        """Add a block with known counts and time span, whose log times are read when requested."""
        self._blocks.append(block)
        self._counts.update(block.counts)
        self._unread.append((block, read_times))

    def note_lost_block(
        self, block: Block, log_times: Mapping[int, NDArray[np.int64]], reason: str
    ) -> None:
        """Note that a block with known messages cannot be read."""
        described, _ = complete_block_by_log_times(block, log_times)
        self.damage.note_lost_block(described, reason)

    def add_unindexed_blocks(self, blocks: Iterable[Block]) -> None:
        """Add blocks without an index, by unpacking them to find their messages."""
        for group in iter_unpacked_block_groups(self.file, blocks, self.record_finders):
            for block, why in group.damaged:
                self.damage.note_lost_block(block, why)
            for block, first, last, unread in group.parts:
                self.add_scanned_block(block, group.data, group.rows[:, first:last])
                self._note_unread_bytes(block, unread)
                self._note_verified_block(block)

    def add_scanned_block(
        self, block: Block, data: NDArray[np.uint8], rows: NDArray[np.int64]
    ) -> None:
        """Add a block with the rows (4, n) found by scanning it."""
        for key, _, offset, length in rows[:, rows[KEY] < 0].T.tolist():
            content = data[offset : offset + length].tobytes()
            self._process_non_message_record(-1 - key, content, block.record_offset)
        self.add_block_with_times(
            block, {key: rows[TIME, at] for key, at in group_rows_by_connection(rows[KEY])}
        )

    def sort_blocks_and_note_losses(self, topics: Mapping[int, str]) -> None:
        """Sort the blocks by offset once all are added, and note messages that cannot be used.

        Args:
            topics: topic of each described connection.
        """
        self._topics = topics
        self._blocks.sort(key=lambda block: block.record_offset)
        for key, parts in self._times.items():
            if key not in topics:
                count = sum(times.size for times in parts)
                self.damage.add_damage_sentence(
                    f"{count:,} messages of connection {key}, which has no definition: not read"
                )
            elif self._late[key]:
                self.damage.add_damage_sentence(
                    f"{self._late[key]:,} messages have log times beyond the year 2262: not used",
                    topics[key],
                )

    def log_times(self, connection_id: int) -> NDArray[np.int64]:
        """Log times of a connection, (n,) in ns, in any order."""
        self._load_times_of_indexed_blocks()
        return np.concatenate([make_empty_log_times(), *self._times.get(connection_id, [])])

    def count_messages_of_connection(self, connection_id: int) -> int:
        """Number of messages of a connection with usable log times."""
        return self._counts[connection_id] - self._late.get(connection_id, 0)

    def _load_times_of_indexed_blocks(self) -> None:
        """Read the log times of indexed blocks; unpack those with an incomplete index."""
        with self._reading:
            found: dict[int, list[NDArray[np.int64]]] = {}
            unknown: list[Block] = []
            for block, read_times in self._unread:
                times = read_times()
                if times is None or not do_indexed_times_match_block(block, times):
                    unknown.append(block)
                    continue
                for key, values in times.items():
                    found.setdefault(key, []).append(values)
            if unknown:
                unpacked = BlockStore(
                    self.file, self._load_finders, self._process_non_message_record
                )
                unpacked.damage = self.damage
                unpacked.add_unindexed_blocks(unknown)
                for key, parts in unpacked._times.items():
                    found.setdefault(key, []).extend(parts)
            for key, parts in found.items():
                self._times.setdefault(key, []).extend(parts)
            self._unread = []

    def iter_batch_groups(
        self, connection_ids: Collection[int], start_ns: int | None, end_ns: int | None
    ) -> Iterator[BatchGroup]:
        """See `Container.iter_batch_groups`."""
        wanted = frozenset(connection_ids)
        first = 0 if start_ns is None else max(start_ns, 0)
        last = _INT64_MAX if end_ns is None else end_ns
        touched = [
            block
            for block in self._blocks
            if not wanted.isdisjoint(block.counts)
            and block.first_ns <= last
            and block.last_ns >= first
        ]
        chosen = np.array(sorted(wanted), np.int64)
        starts = np.array([*(block.first_ns for block in touched), END_NS], np.int64)
        floors = np.minimum.accumulate(starts[::-1])[::-1]
        done = 0
        for group in iter_unpacked_block_groups(self.file, touched, self.record_finders):
            self._compare_blocks_with_index(group)
            done += len(group.parts) + len(group.damaged)
            found = list(
                select_messages_of_connections(group.data, group.rows, chosen, first, last)
            )
            yield BatchGroup(found, int(floors[done]))

    def _compare_blocks_with_index(self, group: UnpackedBlockGroup) -> None:
        """Note as damage where the blocks of a group differ from their index."""
        for block, why in group.damaged:
            self.damage.note_lost_block(block, why)
        blocks = [block for block, *_ in group.parts]
        keys = sorted({*self._topics, *(key for block in blocks for key in block.counts)})
        topics = [*(self._topics.get(key, "") for key in keys), ""]
        found = count_messages_of_chunks(group, np.array(keys, np.int64))
        for (block, _, _, unread), held in zip(group.parts, found, strict=True):
            self._note_unread_bytes(block, unread)
            self._note_verified_block(block)
            said = [*(block.counts.get(key, 0) for key in keys), 0]
            if held.counts != said:
                self._note_message_counts_unlike_index(block, held.counts, said, topics)
            self._note_times_outside_index(block, held)

    def _note_message_counts_unlike_index(
        self, block: Block, decoded_counts: list[int], indexed_counts: list[int], topics: list[str]
    ) -> None:
        for held, counted, topic in zip(decoded_counts, indexed_counts, topics, strict=True):
            if held != counted:
                self.damage.add_damage_sentence(
                    f"the chunk at byte {block.record_offset} holds {held:,} whole messages "
                    f"where its index counts {counted:,}",
                    topic,
                )

    def _note_times_outside_index(self, block: Block, chunk_stats: ChunkStats) -> None:
        """Note a block with messages outside its indexed times, which time ranges would miss."""
        # messages beyond the year 2262 may be noted already
        unknown = chunk_stats.late > 0 and not any(self._late.values())
        in_time = chunk_stats.first_ns <= chunk_stats.last_ns
        if unknown or (
            in_time
            and (chunk_stats.first_ns < block.first_ns or chunk_stats.last_ns > block.last_ns)
        ):
            self.damage.add_damage_sentence(
                f"the chunk at byte {block.record_offset} holds messages outside the times "
                "that its index gives"
            )

    def _note_verified_block(self, block: Block) -> None:
        """Note a block whose CRC was compared and agrees."""
        if block.crc and not block.is_truncated:
            self._sealed.add(block.record_offset)

    def _note_unread_bytes(self, block: Block, unread_byte_count: int) -> None:
        if unread_byte_count and not block.is_truncated:
            self.damage.add_damage_sentence(
                f"{unread_byte_count:,} of {block.max_unpacked_bytes:,} bytes in the chunk at byte "
                f"{block.record_offset} form no complete record and were not read"
            )


class TimedBlock(NamedTuple):
    """A block with its counts, and its usable log times by connection."""

    block: Block
    log_times: Mapping[int, NDArray[np.int64]]


def complete_block_by_log_times(
    block: Block, log_times: Mapping[int, NDArray[np.int64]]
) -> TimedBlock:
    """Fill in the counts and time span of a block, and select its usable log times.

    Times beyond the year 2262 are unusable: as signed 64-bit integers, they are negative.
    """
    everything = np.concatenate([make_empty_log_times(), *log_times.values()])
    counts = _count_messages_by_connection(log_times)
    first, last = (everything.min(), everything.max()) if everything.size else (0, -1)
    if first < 0:
        log_times = {key: values[values >= 0] for key, values in log_times.items()}
        everything = everything[everything >= 0]
        first, last = (everything.min(), everything.max()) if everything.size else (0, -1)
    return TimedBlock(
        replace(block, counts=counts, first_ns=int(first), last_ns=int(last)), log_times
    )


def do_indexed_times_match_block(block: Block, log_times: Mapping[int, NDArray[np.int64]]) -> bool:
    """Whether an index has the block's message counts, and times within the block's time span."""
    whole = np.concatenate([make_empty_log_times(), *log_times.values()])
    in_span = block.first_ns <= whole.min() and whole.max() <= block.last_ns if whole.size else True
    return bool(in_span) and _count_messages_by_connection(log_times) == block.counts


def _count_messages_by_connection(log_times: Mapping[int, NDArray[np.int64]]) -> dict[int, int]:
    return {key: values.size for key, values in log_times.items() if values.size}
