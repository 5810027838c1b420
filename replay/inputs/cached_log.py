"""Logs derived from another log: cached reads, or a part of it."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import polars as pl

from analysis.model.loss import Loss
from replay.logs import Log, LogCheck


class DerivedLog(Log):
    """A log that reads from another one, which stays open when this one is closed."""

    def __init__(self, log: Log) -> None:
        """Wrap an open log."""
        super().__init__(log.path, log.format)
        self._log = log

    @property
    def files(self) -> tuple[Path, ...]:
        """No files, since a derived log is not evidence and is not hashed."""
        return ()

    def topics(self) -> pl.DataFrame:
        """Topics of the log."""
        return self._log.topics()

    def check(self) -> LogCheck:
        """Check the log."""
        return self._log.check()

    def notes(self) -> tuple[str, ...]:
        """Notes on what was recognised in the log."""
        return self._log.notes()

    def units(self, topic: str) -> Mapping[str, str]:
        """Units that the log states."""
        return self._log.units(topic)

    def losses(self) -> tuple[Loss, ...]:
        """Losses of the log."""
        return self._log.losses()


class CachedLog(DerivedLog):
    """Another log whose decoded topics are cached."""

    def __init__(self, log: Log) -> None:
        super().__init__(log)
        self._topics: pl.DataFrame | None = None
        self._kept: dict[tuple[str, tuple[str, ...], int | None, int | None], pl.DataFrame] = {}

    def topics(self) -> pl.DataFrame:
        """Topics of the log, listed once."""
        if self._topics is None:
            self._topics = super().topics()
        return self._topics

    def _read_many(
        self, fields: Mapping[str, Sequence[str]], start_ns: int | None, end_ns: int | None
    ) -> dict[str, pl.DataFrame]:
        """Read topics in one pass, except those in the cache."""
        wanted = {topic: (topic, tuple(names), start_ns, end_ns) for topic, names in fields.items()}
        new = {topic: fields[topic] for topic, key in wanted.items() if key not in self._kept}
        for topic, frame in self._log.read_many(new, start_ns, end_ns).items() if new else ():
            self._kept[wanted[topic]] = frame
        return {topic: self._kept[key] for topic, key in wanted.items()}

    def machine_ids(self) -> tuple[str, ...]:
        """Serial numbers of machines in the log."""
        return self._log.machine_ids()

    def expect(self, fields: Mapping[str, Sequence[str]]) -> None:
        """Announce the fields that will be read, unless they are cached."""
        if not self._kept:
            self._log.expect(fields)


class LogPart(DerivedLog):
    """Part of another log between two log times."""

    def __init__(self, log: Log, start_ns: int | None, end_ns: int | None) -> None:
        """Select a part of a log.

        Args:
            log: the open log.
            start_ns: first log time, inclusive; None for the begin.
            end_ns: last log time, inclusive; None for the end.
        """
        super().__init__(log)
        self._span = start_ns, end_ns

    def _read_many(
        self, fields: Mapping[str, Sequence[str]], start_ns: int | None, end_ns: int | None
    ) -> dict[str, pl.DataFrame]:
        """Read the log, which may be cached, and keep the part."""
        first, last = self._span
        bounds = [
            *(pl.col("log_time_ns") >= each for each in (first, start_ns) if each is not None),
            *(pl.col("log_time_ns") <= each for each in (last, end_ns) if each is not None),
        ]
        whole = self._log.read_many(fields)
        return {topic: frame.filter(*bounds) for topic, frame in whole.items()}
