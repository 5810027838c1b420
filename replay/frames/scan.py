"""Scan topics of logs as lazy frames of polars, and as streams of Arrow."""

import atexit
import threading
from collections.abc import Callable, Iterator, Sequence
from datetime import timedelta
from glob import glob, has_magic
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple

import polars as pl
from polars.io.plugins import register_io_source

from analysis.model.loss import Loss
from estimators.errors import LogError, suggest_choice
from replay.frames.frame_limits import LIMITS
from replay.frames.shape import LOG_TIME, LOG_TIME_NS, FrameOptions
from replay.frames.topic_source import SOURCE, TopicSource
from replay.logs import TimeAxis, expand_log_folders

Logs = str | Path | Sequence[str | Path]


def scan_log(  # noqa: PLR0913 - each names one choice
    logs: Logs,
    topic: str,
    *,
    fields: Sequence[str] | None = None,
    nested: Literal["dotted", "struct"] = "dotted",
    arrays: Literal["list", "array"] = "list",
    enums: Literal["name", "number"] = "name",
    times: Literal["datetime", "ns"] = "datetime",
    time: TimeAxis | None = None,
    losses: list[Loss] | None = None,
) -> pl.LazyFrame:
    """Scan a topic of one or several logs as a lazy frame.

    The selected columns, the row limit and the filter's range of log time and source are passed to
    the index of each log, so that only relevant chunks are read and only needed fields decoded.
    Rows come log by log, in log-time order within each.

    Args:
        logs: a log as for `open_log`, a folder of logs, a pattern (`shifts/*.bag`), or several of
            these. Unless it is one log, a column `source` names the log of each row.
        topic: name of the topic (`payscope info` lists them; a table has one, `table`).
        fields: dotted names, with an element by index or name (`effort[left]`); None for all
            fields.
        nested: `dotted` for columns with dotted names (`angular_velocity.z`), or `struct`.
        arrays: fixed-length arrays as `list` or `array`.
        enums: enumerations by `name` from the definition, or by `number`.
        times: `log_time` and `header_stamp` in UTC, or `log_time_ns` and `header_stamp_ns`.
        time: time column and format of tables.
        losses: list that receives data that could not be read, once rows are read; a `LossWarning`
            reports them as well.

    Raises:
        LogError: the log, topic or field does not exist; or, when rows are read, a topic that
            cannot be decoded.
    """
    options = FrameOptions(nested, arrays, enums, times)
    return make_lazy_frame_of_topic(
        make_row_source_of_topic(logs, topic, options, fields=fields, time_axis=time, losses=losses)
    )


class _OpenReaders:
    """Counter of the active readers of a process, so that it does not exit while one is working.

    A query with a row limit ends before its current chunk is read. If polars' thread then returned
    to an interpreter that has ended, the process would abort.
    """

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._open, self._reading, self._ends = 0, 0, False
        atexit.register(self._end_and_wait_for_readers)

    def iter_batches_until_interpreter_exit(
        self, batches: Iterator[pl.DataFrame]
    ) -> Iterator[pl.DataFrame]:
        """Yield the batches, and stop when the interpreter ends."""
        self._add_to_reader_counts(opened_change=1)
        try:
            while not self._ends:
                self._add_to_reader_counts(reading_change=1)
                try:
                    batch = next(batches, None)
                finally:
                    self._add_to_reader_counts(reading_change=-1)
                if batch is None:
                    break
                yield batch
        finally:
            self._add_to_reader_counts(opened_change=-1)

    def _add_to_reader_counts(self, opened_change: int = 0, reading_change: int = 0) -> None:
        with self._changed:
            self._open += opened_change
            self._reading += reading_change
            self._changed.notify_all()

    def _end_and_wait_for_readers(self) -> None:
        with self._changed:
            self._ends = True
            if self._changed.wait_for(lambda: not self._reading, LIMITS.scan_read_s):
                # a reader that is abandoned is never closed, and does no harm
                self._changed.wait_for(lambda: not self._open, LIMITS.scan_close_s)


_READERS: Final = _OpenReaders()

#: Function that yields batches for requested columns, predicate and number of rows.
Batches = Callable[[list[str] | None, pl.Expr | None, int | None], Iterator[pl.DataFrame]]


def make_lazy_frame_of_batches(batches: Batches, schema: pl.Schema, topic: str) -> pl.LazyFrame:
    """Make a lazy frame of batches; those unread when the interpreter exits are dropped."""

    def iter_requested_rows(
        columns: list[str] | None,
        predicate: pl.Expr | None,
        n_rows: int | None,
        batch_size: int | None,
    ) -> Iterator[pl.DataFrame]:
        del batch_size  # only a hint; the file determines the size of batches
        return _READERS.iter_batches_until_interpreter_exit(batches(columns, predicate, n_rows))

    return register_io_source(iter_requested_rows, schema=schema, explain_name=topic)


def make_lazy_frame_of_topic(topic_source: TopicSource) -> pl.LazyFrame:
    """Make a lazy frame that reads the batches of a topic when it is collected."""
    return make_lazy_frame_of_batches(
        topic_source.iter_row_batches, topic_source.schema, f"log {topic_source.topic}"
    )


class LogStream:
    """A topic as a stream of Arrow record batches; each reader reads the logs again.

    DuckDB, pyarrow, pandas and DataFusion read it by `__arrow_c_stream__`.

    Attributes:
        losses: data that could not be read so far.
        schema: schema of the columns.
    """

    def __init__(
        self, source: TopicSource, columns: Sequence[str] | None, predicate: pl.Expr | None
    ) -> None:
        self._source, self._columns, self._predicate = source, columns, predicate
        names = source.schema if columns is None else columns
        for name in names:
            if name not in source.schema:
                raise LogError(
                    f"no column '{name}' in topic '{source.topic}'; "
                    f"{suggest_choice(name, source.schema)}"
                )
        self.schema = pl.Schema({name: source.schema[name] for name in names})
        self.losses = source.losses

    def __iter__(self) -> Iterator[pl.DataFrame]:
        return self._source.iter_row_batches(self._columns, self._predicate)

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object:
        import pyarrow as pa  # slow to import

        def to_plain_arrow(frame: pl.DataFrame) -> Any:
            # pandas and others may not support string views yet
            return frame.to_arrow(compat_level=pl.CompatLevel.oldest())

        schema = to_plain_arrow(self.schema.to_frame()).schema
        batches = (batch for frame in self for batch in to_plain_arrow(frame).to_batches())
        reader: Any = pa.RecordBatchReader.from_batches(schema, batches)
        return reader.__arrow_c_stream__(requested_schema)


def stream_log(
    logs: Logs,
    topic: str,
    *,
    columns: Sequence[str] | None = None,
    where: pl.Expr | None = None,
    fields: Sequence[str] | None = None,
    options: FrameOptions = FrameOptions(),  # noqa: B008 - it is frozen
    time: TimeAxis | None = None,
    losses: list[Loss] | None = None,
) -> LogStream:
    """Stream a topic to libraries that read Arrow, with the same rows as `scan_log`.

    Args:
        logs: as in `scan_log`.
        topic: as in `scan_log`.
        columns: selected columns; None for all.
        where: filter expression; its range of `log_time` limits the rows that are read.
        fields: as in `scan_log`.
        options: how messages become columns.
        time: time column and format of tables.
        losses: receives data that could not be read.

    Raises:
        LogError: the log, topic, field or column does not exist.
    """
    source = make_row_source_of_topic(
        logs, topic, options, fields=fields, time_axis=time, losses=losses
    )
    return LogStream(source, columns, where)


def join_topics(
    left: pl.LazyFrame,
    right: pl.LazyFrame,
    *,
    tolerance: str | timedelta | None = None,
    strategy: Literal["backward", "forward", "nearest"] = "backward",
    suffix: str = "_right",
) -> pl.LazyFrame:
    """Join each row of one topic with the row of another that is nearest in time.

    Args:
        left: frame from `scan_log`; its rows are kept.
        right: frame of the same logs, with the same `times`.
        tolerance: largest time difference, such as "20ms"; None for no limit.
        strategy: the last row before, the first row after, or the nearest.
        suffix: suffix of columns of `right` that `left` has as well, including its time.
    """
    has = left.collect_schema(), right.collect_schema()
    time = LOG_TIME if LOG_TIME in has[0] else LOG_TIME_NS
    by = [SOURCE] if all(SOURCE in each for each in has) else None
    if time == LOG_TIME_NS and isinstance(tolerance, str):
        tolerance_ns: Any = pl.select(pl.duration(nanoseconds=0).dt.offset_by(tolerance)).item()
        tolerance = tolerance_ns
    return left.join_asof(
        right,
        on=time,
        by=by,
        tolerance=tolerance,
        strategy=strategy,
        suffix=suffix,
        coalesce=False,
        check_sortedness=False,
    )


class ExpandedLogs(NamedTuple):
    """Paths of logs, and whether the argument may name several: a list, folder or pattern."""

    paths: list[Path]
    can_be_several: bool


def expand_log_paths(logs: Logs) -> ExpandedLogs:
    """Find the named logs: single ones, those in folders, and those that match patterns.

    Raises:
        LogError: a pattern or folder has no log.
    """
    named = [logs] if isinstance(logs, str | Path) else list(logs)
    found: list[Path] = []
    for each in named:
        if has_magic(str(each)) and not Path(each).exists():
            matching = sorted(map(Path, glob(str(each), recursive=True)))  # noqa: PTH207 - the pattern may be absolute
            if not matching:
                raise LogError(f"{each}: no log matches this pattern; correct it")
            found += matching
        else:
            found.append(Path(each))
    if not found:
        raise LogError("no log is given; give at least one")
    paths = expand_log_folders(found)
    return ExpandedLogs(paths, not isinstance(logs, str | Path) or paths != [Path(logs)])


def make_row_source_of_topic(
    logs: Logs,
    topic: str,
    options: FrameOptions = FrameOptions(),  # noqa: B008 - it is frozen
    *,
    fields: Sequence[str] | None = None,
    time_axis: TimeAxis | None = None,
    losses: list[Loss] | None = None,
) -> TopicSource:
    """Make the row source of a topic, for a lazy frame or a stream.

    Args:
        logs: as in `scan_log`.
        topic: as in `scan_log`.
        options: how messages become columns.
        fields: as in `scan_log`.
        time_axis: time column and format of tables.
        losses: list that receives data that could not be read.

    Raises:
        LogError: the log, topic or field does not exist.
    """
    paths, is_several = expand_log_paths(logs)
    return TopicSource(
        paths,
        topic,
        options,
        fields=fields,
        with_source=is_several,
        time_axis=time_axis,
        losses=losses,
    )
