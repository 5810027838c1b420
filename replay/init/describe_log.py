"""Describe the contents of a log, as `payscope info` prints them."""

import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import polars as pl

from analysis.model.loss import Loss
from replay.logs import TABLE, Log, LogCheck

if TYPE_CHECKING:
    from replay.recognise.profile import FieldProfile


@dataclass(frozen=True, slots=True, eq=False)
class LogInfo:
    """Contents of a log. Times are in ns by its own clock; null if it has no messages."""

    path: Path
    format: str
    size_bytes: int
    start_ns: int | None
    end_ns: int | None
    duration_s: float | None
    messages: int
    #: a row per topic, as `Log.topics` returns them
    topics: pl.DataFrame
    losses: tuple[Loss, ...]
    #: what was read to check it; None if only the index was read
    checked: LogCheck | None = None
    check_s: float | None = None
    #: every field with single values; for a log of messages, only if requested
    fields: "tuple[FieldProfile, ...]" = ()
    #: notes on how the log is written, as detected
    notes: tuple[str, ...] = ()

    @property
    def is_read_without_loss(self) -> bool | None:
        """Whether everything was read without loss; None if not checked."""
        return None if self.checked is None else not self.losses

    def to_dict(self) -> dict[str, Any]:
        """The fields as JSON-compatible values."""
        return {
            "path": str(self.path),
            "format": self.format,
            "size_bytes": self.size_bytes,
            "start_ns": self.start_ns,
            "end_ns": self.end_ns,
            "duration_s": self.duration_s,
            "messages": self.messages,
            "topics": self.topics.to_dicts(),
            "fields": [each.to_dict() for each in self.fields],
            "notes": list(self.notes),
            "losses": [asdict(loss) for loss in self.losses],
            "check": None
            if self.checked is None
            else {
                "whole": self.is_read_without_loss,
                **asdict(self.checked),
                "seconds": self.check_s,
            },
        }


def describe_log_by_index(
    log: Log, *, is_log_checked: bool = False, are_fields_profiled: bool = False
) -> LogInfo:
    """Describe a log by its index, without decoding its messages.

    Args:
        log: opened log.
        is_log_checked: whether to read and decode everything too (`Log.check`).
        are_fields_profiled: whether to describe every field; those of a table always are.

    Raises:
        LogError: a table's time column contains no times.
    """
    topics = log.topics()
    begun = time.perf_counter()
    checked = log.check() if is_log_checked else None
    ends: dict[str, Any] = topics.select(
        pl.col("start_ns").min(), pl.col("end_ns").max(), pl.col("messages").sum()
    ).row(0, named=True)
    start, end = ends["start_ns"], ends["end_ns"]
    is_table = topics.height > 0 and str(topics["topic"][0]).partition("/")[0] == TABLE
    described: tuple[FieldProfile, ...] = ()
    if are_fields_profiled or is_table:
        from replay.recognise.profile import profile_fields  # imports machines, which is slow

        described = tuple(profile_fields(log))
    return LogInfo(
        path=log.path,
        format=log.format,
        size_bytes=sum(file.stat().st_size for file in log.files),
        start_ns=start,
        end_ns=end,
        duration_s=None if start is None else (end - start) / 1e9,
        messages=ends["messages"],
        topics=topics,
        fields=described,
        notes=(*log.notes(), *(f"its metadata name machine {each}" for each in log.machine_ids())),
        losses=log.losses(),
        checked=checked,
        check_s=time.perf_counter() - begun if is_log_checked else None,
    )
