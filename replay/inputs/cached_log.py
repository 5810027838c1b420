"""Logs made of another one: decoded once however often they are replayed, or a stretch of it."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import polars as pl

from analysis.model.loss import Loss
from replay.logs import Log, LogCheck


class DerivedLog(Log):
    """Another log, read through; leaving this one leaves that one open."""

    def __init__(self, log: Log) -> None:
        """Take a log that is open."""
        super().__init__(log.path, log.format)
        self._log = log

    @property
    def files(self) -> tuple[Path, ...]:
        """Not hashed: what is made of a log is not evidence."""
        return ()

    def topics(self) -> pl.DataFrame:
        """The log's topics."""
        return self._log.topics()

    def check(self) -> LogCheck:
        """Check the log."""
        return self._log.check()

    def notes(self) -> tuple[str, ...]:
        """Notes on what was recognised in the log."""
        return self._log.notes()

    def units(self, topic: str) -> Mapping[str, str]:
        """The units that the log states."""
        return self._log.units(topic)

    def losses(self) -> tuple[Loss, ...]:
        """The log's losses."""
        return self._log.losses()


class CachedLog(DerivedLog):
    """Another log, with what was read of it kept."""

    def __init__(self, log: Log) -> None:
        super().__init__(log)
        self._topics: pl.DataFrame | None = None
        self._kept: dict[tuple[str, tuple[str, ...], int | None, int | None], pl.DataFrame] = {}

    def topics(self) -> pl.DataFrame:
        """The log's topics, listed once."""
        if self._topics is None:
            self._topics = super().topics()
        return self._topics

    def _read_many(
        self, fields: Mapping[str, Sequence[str]], start_ns: int | None, end_ns: int | None
    ) -> dict[str, pl.DataFrame]:
        """What the log reads in one pass; topics that were decoded before are not read again."""
        wanted = {topic: (topic, tuple(names), start_ns, end_ns) for topic, names in fields.items()}
        new = {topic: fields[topic] for topic, key in wanted.items() if key not in self._kept}
        for topic, frame in self._log.read_many(new, start_ns, end_ns).items() if new else ():
            self._kept[wanted[topic]] = frame
        return {topic: self._kept[key] for topic, key in wanted.items()}

    def machine_ids(self) -> tuple[str, ...]:
        """Serial numbers of machines in the log."""
        return self._log.machine_ids()

    def expect(self, fields: Mapping[str, Sequence[str]]) -> None:
        """Tell the log which fields will be read, unless they are cached."""
        if not self._kept:
            self._log.expect(fields)


class LogPart(DerivedLog):
    """Part of another log between two log times."""

    def __init__(self, log: Log, start_ns: int | None, end_ns: int | None) -> None:
        """Take a stretch of a log.

        Args:
            log: the whole, open.
            start_ns: first log time, inclusive; None: its beginning.
            end_ns: last log time, inclusive; None: its end.
        """
        super().__init__(log)
        self._span = start_ns, end_ns

    def _read_many(
        self, fields: Mapping[str, Sequence[str]], start_ns: int | None, end_ns: int | None
    ) -> dict[str, pl.DataFrame]:
        """Cut from what is read of the whole, which may be at hand."""
        first, last = self._span
        bounds = [
            *(pl.col("log_time_ns") >= each for each in (first, start_ns) if each is not None),
            *(pl.col("log_time_ns") <= each for each in (last, end_ns) if each is not None),
        ]
        whole = self._log.read_many(fields)
        return {topic: frame.filter(*bounds) for topic, frame in whole.items()}
