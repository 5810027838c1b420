"""What every log shares: how it is opened and left, and that one topic is read as several are."""

import weakref
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

import polars as pl

from estimators.errors import LogError
from replay.readers.protocol import Checked


def _nothing_stays_open() -> None:
    pass


class BaseLog(ABC):
    """The part of a `Log` that does not depend on where its messages come from."""

    def __init__(self, path: Path, close: Callable[[], None] = _nothing_stays_open) -> None:
        """Begin open.

        Args:
            path: what was opened.
            close: releases it; no method of the log itself, which would keep it for ever.
        """
        self.path = path
        # closes also where nobody does: `run(open_log(path), machine)` is meant to be written
        self._close = weakref.finalize(self, close)

    def read(
        self,
        topic: str,
        fields: Sequence[str],
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> pl.DataFrame:
        """Read fields of one topic; see `Log.read`."""
        return self.read_many({topic: fields}, start_ns, end_ns)[topic]

    def read_many(
        self,
        fields: Mapping[str, Sequence[str]],
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> dict[str, pl.DataFrame]:
        """Read fields of several topics in one pass; see `Log.read_many`."""
        self._check_open()
        return self._read_many(fields, start_ns, end_ns)

    @abstractmethod
    def _read_many(
        self, fields: Mapping[str, Sequence[str]], start_ns: int | None, end_ns: int | None
    ) -> dict[str, pl.DataFrame]:
        """What `read_many` gives of an open log."""

    @abstractmethod
    def check(self) -> Checked:
        """Read everything; see `Log.check`."""

    def _check_open(self) -> None:
        if not self._close.alive:
            raise LogError(f"{self.path}: the log was closed; open it again")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._close()
