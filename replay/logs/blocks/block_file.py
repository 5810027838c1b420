"""Common code of containers in one file of blocks: ROS 1 bags and MCAP files."""

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analysis.model.loss import Loss
from replay.logs.blocks.block import Block
from replay.logs.blocks.block_groups import RecordFinders
from replay.logs.blocks.block_messages import BlockStore
from replay.logs.storage import BatchGroup, Connection, FileBytes


class BlockFile(ABC):
    """A container with a store of blocks, which the subclass for each format fills."""

    def __init__(self, path: Path) -> None:
        self.files: tuple[Path, ...] = (path,)
        self._file = FileBytes(path)
        try:
            self._store = self._make_store()
            self.connections: tuple[Connection, ...] = self._read_connections_or_scan()
            self._topics = {c.id: c.topic for c in self.connections}
            self._store.sort_blocks_and_note_losses(self._topics)
        except BaseException:
            self._file.close()
            raise

    @abstractmethod
    def _read_connections_or_scan(self) -> tuple[Connection, ...]:
        """Fill the store from an index, or by scanning the file.

        Raises:
            LogError: the file's content does not match its suffix.
        """

    @staticmethod
    @abstractmethod
    def _import_record_finders() -> RecordFinders:
        """Import the functions that find records of the format in bytes."""

    @abstractmethod
    def _process_non_message_record(self, opcode: int, content: bytes, offset: int) -> None:
        """Process a record other than a message; see `block_messages.Describe`."""

    def _make_store(self) -> BlockStore:
        return BlockStore(self._file, self._import_record_finders, self._process_non_message_record)

    def _make_second_pass_store(self) -> BlockStore:
        """Make a store for a second pass over the file, which shares the notes of damage."""
        store = self._make_store()
        store.damage = self._store.damage
        return store

    def _note_blocks_missed_by_first_pass(
        self, chunks: Iterable[Block], unchunked_store: BlockStore
    ) -> None:
        """Note chunks, and messages outside chunks, that the first pass missed, as damage."""
        found = [chunk.record_offset for chunk in chunks]
        self._store.note_blocks_missing_from_store(
            [*found, *unchunked_store.offsets_of_blocks_with_messages]
        )

    @property
    def losses(self) -> Sequence[Loss]:
        """Damage found so far."""
        return self._store.damage.list_losses(self._topics)

    def log_times(self, connection_id: int) -> NDArray[np.int64]:
        """Log times of a connection, from the index or from the scan at opening."""
        return self._store.log_times(connection_id)

    def message_count(self, connection_id: int) -> int:
        """Number of log times of a connection."""
        return self._store.count_messages_of_connection(connection_id)

    def iter_batch_groups(
        self, connection_ids: Collection[int], start_ns: int | None, end_ns: int | None
    ) -> Iterator[BatchGroup]:
        """Read messages in file order; damaged chunks are skipped."""
        return self._store.iter_batch_groups(connection_ids, start_ns, end_ns)

    def log_time_lower_bound_ns(self) -> int:
        """Lower bound of all log times, by the index."""
        return self._store.log_time_lower_bound_ns

    @abstractmethod
    def check_whole_file_and_count_valid_crcs(self) -> int:
        """See `Container.check_whole_file_and_count_valid_crcs`."""

    def close(self) -> None:
        """Release the file."""
        self._file.close()
