"""Report damaged blocks of a file, and gaps between blocks."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Final

from estimators.errors import format_count
from replay.logs.blocks.block import Block
from replay.logs.storage import FileDamage

#: Most damaged blocks that are reported in a sentence each; more are summed up in one.
_MOST_SINGLE: Final = 20


class BlockDamage(FileDamage):
    """Damage of a file of blocks: sentences, lost blocks, and bytes without readable records."""

    def __init__(self, source: str) -> None:
        super().__init__(source)
        #: block and reason, by the offset of its record
        self._blocks: dict[int, tuple[Block, str]] = {}
        #: end of each stretch without records, by its start
        self._gaps: dict[int, int] = {}

    def note_lost_block(self, block: Block, reason: str) -> None:
        """Note that a block is not used."""
        self._blocks[block.record_offset] = (block, reason)

    def note_unreadable_bytes(self, start: int, end: int) -> None:
        """Note that the bytes between two offsets contain no readable records."""
        self._gaps[start] = end

    def is_block_lost(self, offset: int) -> bool:
        """Whether the block at this offset is damaged and was skipped."""
        return offset in self._blocks

    @property
    def lost_message_count(self) -> int | None:
        """Number of messages in the lost blocks; None if that of a block is unknown."""
        counts = [sum(block.counts.values()) for block, _ in self._blocks.values()]
        return sum(counts) if all(counts) else None

    def __bool__(self) -> bool:
        return bool(self._blocks or self._gaps) or super().__bool__()

    def _iter_located_damage(
        self, topic_of_connection: Mapping[int, str]
    ) -> Iterator[tuple[str, str]]:
        for what in (
            *self._iter_lost_block_sentences(topic_of_connection),
            *self._iter_unreadable_span_sentences(),
        ):
            yield "", what

    def _iter_lost_block_sentences(self, topic_of_connection: Mapping[int, str]) -> Iterable[str]:
        damaged = [self._blocks[offset] for offset in sorted(self._blocks)]
        if len(damaged) > _MOST_SINGLE:
            blocks = [block for block, _ in damaged]
            yield (
                f"{len(damaged):,} chunks ({sum(b.stored_bytes for b in blocks):,} bytes) are "
                f"damaged and were not read, the first at byte {blocks[0].record_offset}: "
                f"{damaged[0][1]}; {describe_block_contents(blocks, topic_of_connection)}"
            )
            return
        for block, why in damaged:
            yield (
                f"the chunk at byte {block.record_offset} ({block.stored_bytes:,} bytes) is "
                f"damaged and was not read: {why}; "
                f"{describe_block_contents([block], topic_of_connection)}"
            )

    def _iter_unreadable_span_sentences(self) -> Iterable[str]:
        if self._gaps:
            size = sum(end - start for start, end in self._gaps.items())
            yield (
                f"{size:,} bytes cannot be read, in {len(self._gaps)} "
                f"{'place' if len(self._gaps) == 1 else 'places, the first'} at byte "
                f"{min(self._gaps)}; the records after it are read"
            )


def format_log_time(log_time_ns: int) -> str:
    """Format a log time as `info` does, to the ns so that it can be searched for."""
    return f"{log_time_ns // 10**9}.{log_time_ns % 10**9:09} s"


def make_last_log_time_clause(last_ns: int | None) -> str:
    """Clause that states the log time of the last message that was read."""
    return "" if last_ns is None else f", the last at log time {format_log_time(last_ns)}"


def make_incomplete_end_clause(truncated_bytes: int, truncated_message_count: int) -> str:
    """Clause that describes the bytes after the last complete record.

    Args:
        truncated_bytes: number of bytes.
        truncated_message_count: number of messages read from a truncated chunk there.
    """
    if truncated_message_count:
        return (
            f"; the last {truncated_bytes:,} bytes are an incomplete chunk, "
            f"from which {format_count(truncated_message_count, 'message')} could be read"
        )
    return (
        f"; {truncated_bytes:,} bytes at the end are lost or of a torn record"
        if truncated_bytes
        else ""
    )


def describe_block_contents(blocks: list[Block], topic_of_connection: Mapping[int, str]) -> str:
    """Describe the messages in damaged blocks, as far as an index gives them."""
    counts: dict[str, int] = {}
    for block in blocks:
        for key, count in block.counts.items():
            topic = topic_of_connection.get(key, f"connection {key}")
            counts[topic] = counts.get(topic, 0) + count
    listed = ", ".join(f"{count:,} of {topic}" for topic, count in sorted(counts.items()))
    timed = [block for block in blocks if block.last_ns >= block.first_ns]
    if not timed:
        return f"lost: {listed}" if listed else "the number of messages in it is unknown"
    first, last = min(b.first_ns for b in timed), max(b.last_ns for b in timed)
    span = f"from log time {format_log_time(first)} for {(last - first) / 1e9:.3f} s"
    return (
        f"lost {span}: {listed}" if listed else f"it held messages {span}; their number is unknown"
    )
