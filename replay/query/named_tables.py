"""Open the tables of a query: topics of logs, frames of recordings, ledgers, results of fleets."""

import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Final

import polars as pl

from analysis.model.check_names import rename_stored_checks
from analysis.model.loss import Loss
from estimators.errors import LogError, QueryError
from recordings.review.shift_ledger import CSV, PARQUET
from replay.fleet.gathered_tables import make_tables_of_fleet, open_results_of_fleet
from replay.fleet.results_layout import MARK
from replay.frames.scan import expand_log_paths, make_lazy_frame_of_topic, make_row_source_of_topic
from replay.frames.shape import LOG_TIME
from replay.frames.topic_source import TopicSource, open_or_reuse_log
from replay.logs import TABLE, Log, TimeAxis
from replay.query.recording_frames import AT_S, RecordingFrame, open_recording_frames

_RECORDING: Final = ".rrd"
_PLAIN: Final = {PARQUET: pl.scan_parquet, CSV: pl.scan_csv}
_BEGIN: Final = "start_t_ns"


@dataclass
class NamedTables:
    """Tables by their names in a query.

    Attributes:
        recordings: named recordings.
        fleet: named results of a fleet, if any.
        losses: losses so far while reading topics.
        sources: sources of the topics, for error messages.
        tables: tables by name and, if unambiguous, by a single word: `imu_data` for `/imu/data`.
        words: single-word names by full name.
    """

    recordings: tuple[Path, ...] = ()
    fleet: str | None = None
    losses: list[Loss] = field(default_factory=list)
    sources: list[TopicSource] = field(default_factory=list)
    tables: dict[str, Callable[[], pl.LazyFrame]] = field(default_factory=dict)
    words: dict[str, str] = field(default_factory=dict)

    def add_table_or_query_error_if_name_taken(
        self, name: str, table: Callable[[], pl.LazyFrame], origin: str
    ) -> None:
        """Add a table under its name; if that is taken, using it in a query raises an error."""
        if name in self.tables:
            fault = f"query: two tables are named '{name}', one of {origin}; query them separately"

            def raise_query_error() -> pl.LazyFrame:
                raise QueryError(fault)

            self.tables[name] = raise_query_error
        else:
            self.tables[name] = table

    def add_unquoted_table_aliases(self) -> None:
        """Add table names that need no quotes in SQL.

        Anything but letters, digits and _ becomes _. Ambiguous aliases are omitted.
        """
        words: dict[str, list[str]] = {}
        for name in self.tables:
            words.setdefault(re.sub(r"\W+", "_", name).strip("_"), []).append(name)
        for word, names in words.items():
            if len(names) == 1 and word not in self.tables:
                self.tables[word] = self.tables[names[0]]
                self.words[names[0]] = word


def open_named_tables(
    sources: Sequence[str], time_axis: TimeAxis | None = None, columns: Sequence[str] = ()
) -> NamedTables:
    """Open sources as tables; only their indexes are read.

    Args:
        sources: logs, folders and patterns of logs, recordings, reviews and ledgers, and the
            results of a fleet.
        time_axis: time axis of tables.
        columns: columns named in the query; list elements among them (`effort[left]`) become
            columns.

    Raises:
        PayscopeError: a source does not exist, or is of none of these kinds.
    """
    recordings: list[Path] = []
    ledgers: list[Path] = []
    fleets: list[str] = []
    logs: list[str] = []
    for source in sources:
        path = Path(source)
        if "://" in source or (path / MARK).is_dir():
            fleets.append(source)
        elif path.suffix.lower() == _RECORDING:
            recordings.append(path)
        elif path.name in _PLAIN:
            ledgers.append(path)
        elif (path / PARQUET).is_file():
            ledgers.append(path / PARQUET)
            recordings += sorted(path.glob(f"*{_RECORDING}"))
        else:
            logs.append(source)
    if len(fleets) > 1:
        raise QueryError(
            f"query: results of two fleets ({', '.join(fleets)}); query them separately"
        )
    found = NamedTables(tuple(dict.fromkeys(recordings)), fleets[0] if fleets else None)
    t0_unix_ns = _add_frames_of_recordings(found)
    if logs:
        _add_tables_of_topics(found, logs, _TopicOptions(time_axis, t0_unix_ns, tuple(columns)))
    for ledger in ledgers:
        found.add_table_or_query_error_if_name_taken(
            ledger.stem, partial(_scan_ledger_lazily, ledger), str(ledger)
        )
    for fleet in fleets:
        for name, table in make_tables_of_fleet(open_results_of_fleet(fleet)).items():
            found.add_table_or_query_error_if_name_taken(
                name, partial(add_start_time_column_in_unix_s, table), fleet
            )
    found.add_unquoted_table_aliases()
    return found


def _scan_ledger_lazily(ledger: Path) -> pl.LazyFrame:
    return rename_stored_checks("cycles", _PLAIN[ledger.name](ledger))


def _add_frames_of_recordings(tables: NamedTables) -> int | None:
    """Add the frames of all recordings; return the start of the run if there is only one."""
    by_name: dict[str, list[RecordingFrame]] = {}
    for path in tables.recordings:
        for name, frame in open_recording_frames(
            path, has_source_column=len(tables.recordings) > 1
        ).items():
            by_name.setdefault(name, []).append(frame)
    for name, frames in by_name.items():
        tables.add_table_or_query_error_if_name_taken(
            name, partial(_concatenate_lazy_frames, frames), str(frames[0].recording)
        )
    starts = {frame.t0_unix_ns for frames in by_name.values() for frame in frames}
    return starts.pop() if len(tables.recordings) == 1 else None


def _concatenate_lazy_frames(frames: Sequence[RecordingFrame]) -> pl.LazyFrame:
    if len(frames) == 1:
        return frames[0].make_lazy_frame()
    return pl.concat([frame.make_lazy_frame() for frame in frames], how="diagonal_relaxed")


@dataclass(frozen=True, slots=True)
class _TopicOptions:
    """Options for reading topics as tables.

    Attributes:
        time: time axis of tables.
        t0_unix_ns: start of the run of the recording that is queried together with them.
        columns: columns named in the query.
    """

    time: TimeAxis | None
    t0_unix_ns: int | None
    columns: tuple[str, ...]

    def choose_fields_of_topic(self, log: Log, topic: str) -> list[str] | None:
        """All fields and the named list elements; None, for all fields, if none is named."""
        whole = [leaf.name for leaf in log.leaf_fields(topic)]
        picked: list[str] = []
        for name in self.columns:
            if "[" in name and name not in whole:
                with suppress(LogError):  # an element in another topic
                    picked += [leaf.name for leaf in log.leaf_fields(topic, [name])]
        return [*whole, *picked] if picked else None


def _add_tables_of_topics(tables: NamedTables, logs: Sequence[str], options: _TopicOptions) -> None:
    named = logs[0] if len(logs) == 1 else logs
    paths, _ = expand_log_paths(named)
    topics: dict[str, list[Path]] = {}
    for path in paths:
        for topic in open_or_reuse_log(path, options.time).topic_names():
            topics.setdefault(topic, []).append(path)
    if not topics:
        raise LogError(f"{', '.join(map(str, paths))}: the logs have no topics; give other logs")

    def rows_of_topic(topic: str, of_logs: Sequence[Path]) -> pl.LazyFrame:
        chosen = named if len(paths) == 1 else of_logs
        first = open_or_reuse_log(of_logs[0], options.time)
        source = make_row_source_of_topic(
            chosen,
            topic,
            fields=options.choose_fields_of_topic(first, topic),
            time_axis=options.time,
            losses=tables.losses,
        )
        tables.sources.append(source)
        rows = make_lazy_frame_of_topic(source)
        if options.t0_unix_ns is None:
            return rows
        since_start = pl.col(LOG_TIME).cast(pl.Int64) - options.t0_unix_ns
        return rows.select((since_start / 1e9).alias(AT_S), pl.all())

    for topic, of_logs in topics.items():
        tables.add_table_or_query_error_if_name_taken(
            topic, partial(rows_of_topic, topic, of_logs), str(of_logs[0])
        )
    for path in topics.get(TABLE, ()):
        # tables of files can also be queried by the names of the files
        tables.add_table_or_query_error_if_name_taken(
            path.stem, partial(rows_of_topic, TABLE, [path]), str(path)
        )


def add_start_time_column_in_unix_s(table: Callable[[], pl.LazyFrame]) -> pl.LazyFrame:
    """Add a column with the start time in s, for `fleet open --at`, if a fleet's table has one."""
    rows = table()
    if _BEGIN not in rows.collect_schema():
        return rows
    return rows.with_columns((pl.col(_BEGIN) / 1e9).alias(AT_S))
