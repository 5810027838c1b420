"""Open logs that are still being recorded, by their suffix, or several files as one log."""

import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final, Protocol

import polars as pl

from analysis.model.loss import Loss
from estimators.errors import LogError
from replay.logs.log import TimeAxis
from replay.logs.log_limits import LIMITS
from replay.logs.messages.raw_batch import RawBatch
from replay.logs.storage import Connection, Tail

#: Suffix that rosbag appends to a bag until it is closed.
ACTIVE: Final = ".active"
#: Suffixes of growing logs of messages.
_LOGS: Final = (".bag", ".mcap", ".db3")
_TABLES: Final = (".csv", ".tsv", ".txt", ".dat", ".log", ".asc", ".prn")


class TailParts:
    """Growing files read in order; the next is begun when the previous is read to its end."""

    def __init__(
        self,
        files: Callable[[], Sequence[Path]],
        open_tail: Callable[[Path], Tail],
        is_closed: Callable[[], bool],
    ) -> None:
        """Begin before the first file.

        Args:
            files: returns the current files in order; more may appear.
            open_tail: opens a file.
            is_closed: returns whether no further file will appear.
        """
        self.connections: dict[int, Connection] = {}
        self.is_finished = False
        self.paths: list[Path] = []
        self._files, self._open_tail, self._is_closed = files, open_tail, is_closed
        self._tail: Tail | None = None
        self._losses: list[Loss] = []
        #: when polls began to fail to read the part, in s; None if the last poll read it
        self._unreadable_since_s: float | None = None
        #: number of each connection in this log, by index of its file and number in that file
        self._numbers: dict[tuple[int, int], int] = {}

    @property
    def losses(self) -> Sequence[Loss]:
        """Damage found so far."""
        return [*self._losses, *(self._tail.losses if self._tail else ())]

    @property
    def read_error(self) -> str:
        """See `Tail.read_error`."""
        return self._tail.read_error if self._tail else ""

    def poll(self) -> list[RawBatch]:
        """See `Tail.poll`."""
        # taken before the files are read: data written afterwards is left to the next call
        closed, files = self._is_closed(), self._files()
        batches = self._read_new_batches_of_part() if self._tail else []
        while not self._must_part_be_read_again() and not batches:
            following = [path for path in files if not _has_file_been_read(path, self.paths)]
            if not following:
                self.is_finished = self._tail is not None and (closed or self._tail.is_finished)
                break
            self._finish_part_and_open_next(following[0])
            batches = self._read_new_batches_of_part()
        return batches

    def finish_and_note_incomplete_end(self) -> None:
        """See `Tail.finish_and_note_incomplete_end`."""
        if self._tail is not None:
            self._tail.finish_and_note_incomplete_end()

    def close(self) -> None:
        """Release the file."""
        if self._tail is not None:
            self._tail.close()

    def _must_part_be_read_again(self) -> bool:
        """Whether the part is to be tried again, since its recorder may be locking it."""
        if not self.read_error:
            self._unreadable_since_s = None
            return False
        now_s = time.monotonic()
        if self._unreadable_since_s is None:
            self._unreadable_since_s = now_s
        return now_s - self._unreadable_since_s < LIMITS.unreadable_part_s

    def _finish_part_and_open_next(self, path: Path) -> None:
        if self._tail is not None:
            self._tail.finish_and_note_incomplete_end()
            self._losses += self._tail.losses
            self._tail.close()
        self.paths.append(path)
        self._tail, self._unreadable_since_s = self._open_tail(path), None

    def _read_new_batches_of_part(self) -> list[RawBatch]:
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


class GrowingLogFile(Protocol):
    """A growing log of messages, or a growing table."""

    @property
    def is_finished(self) -> bool:
        """Whether the recorder has closed the log and all rows were returned."""
        ...

    @property
    def topics(self) -> list[str]:
        """Topics found so far."""
        ...

    @property
    def losses(self) -> Sequence[Loss]:
        """Losses so far: data that could not be read."""
        ...

    def poll(self, *, is_log_complete: bool = False) -> dict[str, pl.DataFrame]:
        """New complete rows by topic; `is_log_complete` includes an unterminated last row."""
        ...

    def close(self) -> None:
        """Release the file."""
        ...


def open_growing_log(
    paths: Sequence[Path], fields: Mapping[str, Sequence[str]], time_axis: TimeAxis | None = None
) -> GrowingLogFile:
    """Open one or several logs that are still being recorded.

    Args:
        paths: `.bag` (or `.bag.active`), `.mcap`, `.db3`, one text table, or one folder of a
            recorder that starts new files, as rosbag2 does.
        fields: fields by topic, as in `Log.read_many`.
        time_axis: time column and format of a table.

    Raises:
        LogError: the file does not exist, or its format cannot be followed.
    """
    first = paths[0]
    for path in paths:
        if not path.exists():
            raise LogError(f"{path}: no such file or directory; start the recorder first")
    suffixes = {find_format_suffix(path) for path in paths if not path.is_dir()}
    if any(path.is_dir() for path in paths) and len(paths) > 1:
        raise LogError(
            f"{first}: a folder cannot be followed together with other paths; give one folder, or "
            "only files"
        )
    if suffixes & set(_TABLES):
        if len(paths) > 1:
            raise LogError(
                f"{first}: only one table can be followed at a time; give a single table"
            )
        from replay.logs.log_tails import TableTail

        return TableTail(first, time_axis, fields)
    unknown = suffixes - set(_LOGS)
    if unknown:
        raise LogError(
            f"{first}: a file of type '{unknown.pop()}' cannot be followed while it grows; "
            f"{', '.join((*_LOGS, *_TABLES))}, or a folder of them"
        )
    from replay.logs.log_tails import MessageTail
    from replay.logs.rosbag2 import METADATA

    if first.is_dir():
        parts = TailParts(
            lambda: _list_parts_of_split_log(first), _open_tail, (first / METADATA).exists
        )
    else:
        parts = TailParts(lambda: paths, _open_tail, lambda: False)
    return MessageTail(first, parts, fields)


def find_format_suffix(path: Path) -> str:
    """Suffix that identifies a growing file's format."""
    inner = path.with_suffix("") if path.suffix == ACTIVE else path
    return inner.suffix.lower()


def _open_tail(path: Path) -> Tail:
    # the libraries of a format are imported when a log of that format is followed
    suffix = find_format_suffix(path)
    if suffix == ".bag":
        from replay.logs.bag import BagTail

        return BagTail(path)
    if suffix == ".mcap":
        from replay.logs.mcap import McapTail

        return McapTail(path)
    from replay.logs.sqlite import Db3Tail

    return Db3Tail(path)


def _list_parts_of_split_log(folder: Path) -> list[Path]:
    """List the files of a split log, ordered by the numbers in their names."""
    found = [path for path in folder.iterdir() if find_format_suffix(path) in _LOGS]
    return sorted(
        found,
        key=lambda path: [
            _make_sort_key_of_name_part(part) for part in re.split(r"(\d+)", path.name)
        ],
    )


def _make_sort_key_of_name_part(name_part: str) -> tuple[int, str]:
    return (int(name_part), "") if name_part.isdigit() else (-1, name_part)


def _has_file_been_read(path: Path, read_files: Sequence[Path]) -> bool:
    """Whether a file was already read, under this name or with the suffix `.active`."""
    return path in read_files or path.with_name(f"{path.name}.active") in read_files
