"""A stretch of another log, by its log times."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import polars as pl

from analysis.model.loss import Loss
from replay.logs import Log, LogCheck


class PartOfLog(Log):
    """What another log recorded from one log time to another; leaving it leaves that one open."""

    def __init__(self, log: Log, start_ns: int | None, end_ns: int | None) -> None:
        """Take a stretch of a log.

        Args:
            log: the whole, open.
            start_ns: first log time, inclusive; None: its beginning.
            end_ns: last log time, inclusive; None: its end.
        """
        super().__init__(log.path, log.format)
        self._log = log
        self._span = start_ns, end_ns

    @property
    def files(self) -> tuple[Path, ...]:
        """Not hashed: a part of a log is not evidence."""
        return ()

    def topics(self) -> pl.DataFrame:
        """The topics of the whole log."""
        return self._log.topics()

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

    def check(self) -> LogCheck:
        """Check the whole log."""
        return self._log.check()

    def notes(self) -> tuple[str, ...]:
        """What was recognised of the log."""
        return self._log.notes()

    def units(self, topic: str) -> Mapping[str, str]:
        """The units that the log states."""
        return self._log.units(topic)

    def losses(self) -> tuple[Loss, ...]:
        """The log's losses."""
        return self._log.losses()
