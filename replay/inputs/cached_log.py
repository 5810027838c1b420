"""A log whose topics are decoded once, however often it is replayed."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import polars as pl

from analysis.model.loss import Loss
from replay.logs import Log, LogCheck


class CachedLog(Log):
    """Another log, with what was read of it kept; leaving this one leaves that one open."""

    def __init__(self, log: Log) -> None:
        super().__init__(log.path, log.format)
        self._log = log
        self._topics: pl.DataFrame | None = None
        self._kept: dict[tuple[str, tuple[str, ...], int | None, int | None], pl.DataFrame] = {}

    @property
    def files(self) -> tuple[Path, ...]:
        """Not hashed: a cached log is not evidence."""
        return ()

    def topics(self) -> pl.DataFrame:
        """The log's topics."""
        if self._topics is None:
            self._topics = self._log.topics()
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
        """What the log says of whose it is."""
        return self._log.machine_ids()

    def check(self) -> LogCheck:
        """Check the log."""
        return self._log.check()

    def notes(self) -> tuple[str, ...]:
        """What was recognised of the log."""
        return self._log.notes()

    def expect(self, fields: Mapping[str, Sequence[str]]) -> None:
        """What will be read is read of the log, where it is not kept."""
        if not self._kept:
            self._log.expect(fields)

    def units(self, topic: str) -> Mapping[str, str]:
        """The units that the log states."""
        return self._log.units(topic)

    def losses(self) -> tuple[Loss, ...]:
        """The log's losses."""
        return self._log.losses()
