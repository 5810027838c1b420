"""The container of a ROS 1 bag (version 2.0), read through its index by rosbags."""

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag1 import Reader, ReaderError

from estimators.errors import LogError
from replay.decoding.batch import RawBatch, StoredMessage, join_messages
from replay.readers.container import BROKEN_BYTES, Connection, LossList, no_times

_MAGIC: Final = b"#ROSBAG V"


class BagFile:
    """A ROS 1 bag. One without an index (the recorder crashed) is refused with the remedy."""

    def __init__(self, path: Path) -> None:
        with path.open("rb") as file:
            if file.read(len(_MAGIC)) != _MAGIC:
                raise LogError(f"{path}: not a ROS 1 bag; it does not start with '#ROSBAG V2.0'")
        self.files: tuple[Path, ...] = (path,)
        self.losses = LossList()
        self._reader = Reader(path)
        try:
            self._reader.open()
        except (ReaderError, *BROKEN_BYTES) as error:
            # rosbags ends its sentence in the bare tuple of an inner error
            fault = str(error).partition(": (")[0]
            raise LogError(
                f"{path}: the bag cannot be opened: {fault}; 'rosbag reindex {path.name}' may help"
            ) from error
        self.connections: tuple[Connection, ...] = tuple(
            Connection(c.id, c.topic, c.msgtype, "ros1", c.msgdef.data, "ros1msg")
            for c in self._reader.connections
        )

    def log_times(self, connection_id: int) -> NDArray[np.int64]:
        """The log times of a connection, from the index."""
        index = self._reader.indexes.get(connection_id)
        return np.fromiter((entry.time for entry in index), np.int64) if index else no_times()

    def batches(
        self, connection_ids: Collection[int], start_ns: int | None, end_ns: int | None
    ) -> Iterator[RawBatch]:
        """The messages in batches; see `Container.batches`."""
        return join_messages(self._messages(connection_ids, start_ns, end_ns))

    def _messages(
        self, connection_ids: Collection[int], start_ns: int | None, end_ns: int | None
    ) -> Iterator[StoredMessage]:
        """Messages in log-time order; rosbags stops at the first damaged chunk."""
        chosen = [c for c in self._reader.connections if c.id in connection_ids]
        if not chosen:  # rosbags takes none for all
            return
        stop = None if end_ns is None else end_ns + 1
        last = None
        try:
            for _, time, data in self._reader.messages(chosen, start_ns, stop):
                yield StoredMessage(time, data)
                last = time
        except (ReaderError, *BROKEN_BYTES) as error:
            after = "from the first message on" if last is None else f"after log time {last} ns"
            topics = ", ".join(dict.fromkeys(c.topic for c in chosen))
            self.losses.note(
                self.files[0], f"a chunk is damaged ({error}): nothing is read {after}", topics
            )

    def close(self) -> None:
        """Release the file."""
        self._reader.close()
