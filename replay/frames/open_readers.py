"""Logs that polars still reads when the interpreter ends.

A query with a limit has its rows before the chunk that is being read is through. The thread of
polars that reads it may not come back to an interpreter that is gone: the process would abort.
"""

import atexit
import threading
from collections.abc import Iterator

import polars as pl

#: How long the end waits for a chunk that is being read, and for what polars does with it, in s.
_READS_S = 30.0
_CLOSES_S = 0.5


class OpenReaders:
    """Counts the readers of a process, and lets it end when none is at work."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._open, self._reading, self._ends = 0, 0, False
        atexit.register(self._wait)

    def read(self, batches: Iterator[pl.DataFrame]) -> Iterator[pl.DataFrame]:
        """The same batches, none any more once the interpreter ends."""
        self._count(opened=1)
        try:
            while not self._ends:
                self._count(reading=1)
                try:
                    batch = next(batches, None)
                finally:
                    self._count(reading=-1)
                if batch is None:
                    break
                yield batch
        finally:
            self._count(opened=-1)

    def _count(self, opened: int = 0, reading: int = 0) -> None:
        with self._changed:
            self._open += opened
            self._reading += reading
            self._changed.notify_all()

    def _wait(self) -> None:
        with self._changed:
            self._ends = True
            if self._changed.wait_for(lambda: not self._reading, _READS_S):
                # a reader that nobody asks for more is not closed, and does no harm
                self._changed.wait_for(lambda: not self._open, _CLOSES_S)


READERS = OpenReaders()
