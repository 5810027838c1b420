"""Files that follow one another as one growing log: a rotating recorder, a rosbag2 directory."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from analysis.model.loss import Loss
from replay.logs.messages.raw_batch import RawBatch
from replay.logs.storage import Connection, Tail


class TailParts:
    """Growing files in their order. The next one is read when nothing is left in the one before."""

    def __init__(
        self,
        files: Callable[[], Sequence[Path]],
        open_tail: Callable[[Path], Tail],
        is_closed: Callable[[], bool],
    ) -> None:
        """Begin before the first file.

        Args:
            files: those that there are now, in their order; more may come.
            open_tail: opens one.
            is_closed: whether no other file will come.
        """
        self.connections: dict[int, Connection] = {}
        self.is_finished = False
        self.paths: list[Path] = []
        self._files, self._open_tail, self._is_closed = files, open_tail, is_closed
        self._tail: Tail | None = None
        self._losses: list[Loss] = []
        #: numbers of connections here, by file and number there
        self._numbers: dict[tuple[int, int], int] = {}

    @property
    def losses(self) -> Sequence[Loss]:
        """What was found damaged so far."""
        return [*self._losses, *(self._tail.losses if self._tail else ())]

    def poll(self) -> list[RawBatch]:
        """See `Tail.poll`."""
        # before the files are read: what is written afterwards belongs to the next call
        closed, files = self._is_closed(), self._files()
        batches = self._poll_part() if self._tail else []
        while not batches:
            following = [path for path in files if not _is_among(path, self.paths)]
            if not following:
                self.is_finished = self._tail is not None and (closed or self._tail.is_finished)
                break
            self._open(following[0])
            batches = self._poll_part()
        return batches

    def end(self) -> None:
        """See `Tail.end`."""
        if self._tail is not None:
            self._tail.end()

    def close(self) -> None:
        """Release the file."""
        if self._tail is not None:
            self._tail.close()

    def _open(self, path: Path) -> None:
        if self._tail is not None:
            self._tail.end()
            self._losses += self._tail.losses
            self._tail.close()
        self.paths.append(path)
        self._tail = self._open_tail(path)

    def _poll_part(self) -> list[RawBatch]:
        assert self._tail is not None
        batches = self._tail.poll()
        part = len(self.paths)
        for key, connection in self._tail.connections.items():
            number = self._numbers.setdefault((part, key), len(self._numbers))
            self.connections.setdefault(number, replace(connection, id=number))
        return [
            RawBatch(
                self._numbers[part, batch.connection_id],
                batch.data,
                batch.offsets,
                batch.lengths,
                batch.log_times,
                is_part=True,
            )
            for batch in batches
            if (part, batch.connection_id) in self._numbers
        ]


def _is_among(path: Path, taken: Sequence[Path]) -> bool:
    """Whether a file was taken already, by this name or as `.active`, which a recorder drops."""
    return path in taken or path.with_name(f"{path.name}.active") in taken
