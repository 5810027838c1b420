"""A log whose topics are decoded once, however often it is replayed."""

from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

import polars as pl

from analysis.run import Loss
from replay.readers.protocol import Log


class ReadOnce:
    """Another log, with what was read of it kept; leaving this one leaves that one open."""

    def __init__(self, log: Log) -> None:
        self._log = log
        self._topics: pl.DataFrame | None = None
        self._kept: dict[tuple[str, tuple[str, ...], int | None, int | None], pl.DataFrame] = {}

    @property
    def path(self) -> Path:
        """The log's path."""
        return self._log.path

    @property
    def files(self) -> tuple[Path, ...]:
        """None: who replays a log many times has no use for many proofs of what was read."""
        return ()

    def topics(self) -> pl.DataFrame:
        """The log's topics."""
        if self._topics is None:
            self._topics = self._log.topics()
        return self._topics

    def read(
        self,
        topic: str,
        fields: Sequence[str],
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> pl.DataFrame:
        """What the log reads, decoded the first time alone."""
        wanted = (topic, tuple(fields), start_ns, end_ns)
        if wanted not in self._kept:
            self._kept[wanted] = self._log.read(topic, fields, start_ns, end_ns)
        return self._kept[wanted]

    def losses(self) -> tuple[Loss, ...]:
        """The log's losses."""
        return self._log.losses()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        pass
