"""Read a topic of one or several logs in batches of selected rows and columns.

Logs are kept open while their files are unchanged, since opening one reads its index.
"""

import warnings
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from threading import Lock
from typing import Final

import polars as pl

from analysis.model.loss import Loss
from estimators.errors import LogError, PayscopeError, suggest_choice
from replay.frames.frame_limits import LIMITS
from replay.frames.predicate import FIRST_NS, LAST_NS, TimeRange, bound_log_times_by_predicate
from replay.frames.shape import FrameOptions, TopicShape
from replay.logs import Log, TimeAxis, open_log
from replay.logs.messages.message_types import LeafField

#: Column with the log of each row, if there are several logs.
SOURCE: Final = "source"
_Key = tuple[str, tuple[tuple[str, int, int], ...], TimeAxis | None]
_opened: OrderedDict[_Key, Log] = OrderedDict()
_one_at_a_time: Final = Lock()


class LossWarning(UserWarning):
    """Warning that part of a log could not be read."""


class TopicSource:
    """A topic of several logs, which are read on demand.

    Attributes:
        losses: data that could not be read so far, over all logs.
        failure: error that ended reading, of which polars keeps only the text; None without one.
    """

    def __init__(
        self,
        paths: Sequence[Path],
        topic: str,
        options: FrameOptions,
        *,
        fields: Sequence[str] | None = None,
        with_source: bool = False,
        time_axis: TimeAxis | None = None,
        losses: list[Loss] | None = None,
    ) -> None:
        """Examine the first log that has the topic.

        Args:
            paths: logs in order.
            topic: name of the topic; a log without it is reported as a loss.
            options: how messages become columns.
            fields: dotted names, including elements of lists; None for all fields.
            with_source: whether to add a column with the log of each row.
            time_axis: time column and format of tables.
            losses: list to use as the attribute `losses`; None for a new one.

        Raises:
            LogError: a log cannot be opened, or no log has the topic.
        """
        self.losses: list[Loss] = [] if losses is None else losses
        self.failure: PayscopeError | None = None
        self.topic, self._paths, self._options = topic, tuple(paths), options
        self._time, self._field_names = time_axis, fields
        self._source = SOURCE if with_source else None
        self._shape = self._find_shape_of_first_log()

    @cached_property
    def schema(self) -> pl.Schema:
        """Data types of the columns."""
        mine: dict[str, pl.DataType] = {} if self._source is None else {self._source: pl.String()}
        return pl.Schema({**mine, **self._shape.schema})

    @property
    def time_column(self) -> str:
        """Name of the log-time column."""
        return self._shape.time

    def iter_row_batches(
        self,
        columns: Sequence[str] | None = None,
        predicate: pl.Expr | None = None,
        max_rows: int | None = None,
    ) -> Iterator[pl.DataFrame]:
        """Yield rows log by log, in log-time order within each log.

        Args:
            columns: selected columns; None for all.
            predicate: filter, whose range of time and sources limits the rows that are read.
            max_rows: maximum number of rows, counted before the predicate.
        """
        try:
            yield from self._iter_filtered_row_batches(
                list(columns or self.schema), predicate, max_rows
            )
        except PayscopeError as error:
            self.failure = error
            raise

    def _iter_filtered_row_batches(
        self, columns: list[str], predicate: pl.Expr | None, max_rows: int | None
    ) -> Iterator[pl.DataFrame]:
        within, needed = TimeRange(), list(columns)
        if predicate is not None:
            needed += [c for c in predicate.meta.root_names() if c not in needed]
            if max_rows is None:  # with a time range, other rows would be the first ones
                within = bound_log_times_by_predicate(predicate, self.time_column)
        left = LAST_NS if max_rows is None else max_rows
        for path in self._paths:
            if left <= 0 or within.first_ns > within.last_ns:
                return
            if not self._may_log_contain_rows(path, predicate):
                continue
            for frame in self._iter_frames_of_log_file(path, needed, within):
                rows = frame[:left] if frame.height > left else frame
                left -= rows.height
                if predicate is not None:
                    rows = rows.filter(predicate)
                if rows.height:
                    yield _select_columns_of_frame(rows, columns)
                if left <= 0:
                    break

    def _may_log_contain_rows(self, path: Path, predicate: pl.Expr | None) -> bool:
        """Whether a predicate on the source may keep rows of a log."""
        if predicate is None or self._source is None:
            return True
        known = pl.DataFrame({self._source: [str(path)]})
        for part in split_predicate_at_and(predicate):
            if part.meta.root_names() == [self._source]:
                with suppress(pl.exceptions.PolarsError):
                    if not known.select(part.any()).item():
                        return False
        return True

    def _iter_frames_of_log_file(
        self, path: Path, needed_columns: list[str], time_range: TimeRange
    ) -> Iterator[pl.DataFrame]:
        log = open_or_reuse_log(path, self._time)
        earlier_losses = len(self.losses)
        try:
            yield from self._iter_frames_of_open_log(log, needed_columns, time_range)
        finally:
            self.losses += [loss for loss in log.losses() if loss not in self.losses]
            # losses of other topics do not concern the reader of this one
            mine = [each for each in self.losses[earlier_losses:] if each.topic in ("", self.topic)]
            _warn_of_losses_of_log(path, mine)

    def _iter_frames_of_open_log(
        self, log: Log, needed_columns: list[str], time_range: TimeRange
    ) -> Iterator[pl.DataFrame]:
        shape, own = self._shape, [name for name in needed_columns if name != self._source]
        if not self._does_log_have_topic(log):
            return
        fields = shape.list_fields_needed_for_columns(own)
        known = {leaf.name: leaf for leaf in self._list_requested_leaf_fields(log)}
        missing = [name for name in fields if name not in known]
        for name in missing:
            self._note_loss_of_log(log, f"its messages have no field '{name}', which is null here")
        for name in known.keys() & fields:
            is_same = known[name].dtype == shape.leaves[name].dtype
            if not is_same:
                raise LogError(
                    f"{log.path}: topic '{self.topic}' has '{name}' as {known[name].dtype}, but "
                    f"earlier logs have it as {shape.leaves[name].dtype}; scan these logs "
                    "separately, or select other fields"
                )
        bounds = (
            None if time_range.first_ns == FIRST_NS else time_range.first_ns,
            None if time_range.last_ns == LAST_NS else time_range.last_ns,
        )
        there = [name for name in fields if name in known]
        for read in log.scan(self.topic, there, *bounds):
            nulls = [pl.lit(None, shape.leaves[name].dtype).alias(name) for name in missing]
            frame = shape.make_frame_of_columns(read.with_columns(nulls) if nulls else read, own)
            if self._source in needed_columns:
                # a frame without columns has no height
                height = pl.repeat(str(log.path), read.height, dtype=pl.String, eager=True)
                frame = (
                    frame.with_columns(height.alias(SOURCE))
                    if own
                    else pl.DataFrame({SOURCE: height})
                )
            yield _select_columns_of_frame(frame, needed_columns)

    def _does_log_have_topic(self, log: Log) -> bool:
        if self.topic in log.topic_names():
            return True
        self._note_loss_of_log(log, "this log does not have the topic")
        return False

    def _note_loss_of_log(self, log: Log, loss_text: str) -> None:
        loss = Loss(source=log.path.name, topic=self.topic, what=loss_text)
        if loss not in self.losses:
            self.losses.append(loss)

    def _find_shape_of_first_log(self) -> TopicShape:
        named: dict[str, None] = {}
        for path in self._paths:
            log = open_or_reuse_log(path, self._time)
            topics = log.topic_names()
            if self.topic in topics:
                return TopicShape(self._list_requested_leaf_fields(log), self._options)
            named |= dict.fromkeys(topics)
        logs = ", ".join(map(str, self._paths[:3])) + (" …" if len(self._paths) > 3 else "")
        raise LogError(f"{logs}: no topic '{self.topic}'; {suggest_choice(self.topic, named)}")

    def _list_requested_leaf_fields(self, log: Log) -> tuple[LeafField, ...]:
        return log.leaf_fields(self.topic, self._field_names)


def _select_columns_of_frame(frame: pl.DataFrame, columns: list[str]) -> pl.DataFrame:
    """Select columns; a frame with exactly these is returned unchanged."""
    return frame if frame.columns == columns else frame.select(columns)


def split_predicate_at_and(predicate: pl.Expr) -> Iterator[pl.Expr]:
    """Split a predicate into the parts joined by AND."""
    parts = list(reversed(predicate.meta.pop()))
    if len(parts) == 2 and (parts[0] & parts[1]).meta.eq(predicate):
        for part in parts:
            yield from split_predicate_at_and(part)
    else:
        yield predicate


def _warn_of_losses_of_log(path: Path, losses: Sequence[Loss]) -> None:
    if losses:
        more = f" (and {len(losses) - 1} more)" if len(losses) > 1 else ""
        warnings.warn(f"{path}: {losses[0]}{more}", LossWarning, stacklevel=2)


def open_or_reuse_log(path: Path, time_axis: TimeAxis | None = None) -> Log:
    """Open a log, or reuse the open one if its files are unchanged.

    Args:
        path: path of the log.
        time_axis: time column and format of a table.

    Raises:
        LogError: as from `open_log`.
    """
    with _one_at_a_time:
        key = (str(path.absolute()), read_file_names_sizes_and_change_times(path), time_axis)
        log = _opened.pop(key, None)
        if log is None:
            log = open_log(path, time=time_axis)
        _opened[key] = log
        # a log that is still read is closed afterwards, when nothing refers to it any longer
        while len(_opened) > LIMITS.max_open_logs:
            _opened.popitem(last=False)
        return log


def read_file_names_sizes_and_change_times(path: Path) -> tuple[tuple[str, int, int], ...]:
    """Read name, size in bytes and modification time in ns of a file or a directory's files."""
    try:
        files = sorted(path.iterdir()) if path.is_dir() else [path]
        return tuple((f.name, f.stat().st_size, f.stat().st_mtime_ns) for f in files)
    except OSError:  # opening the log raises the error
        return ()
