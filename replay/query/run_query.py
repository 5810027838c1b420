"""The command `query`: run a SELECT over named sources, and show or write its rows."""

import re
import shlex
import warnings
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, Final

import polars as pl

from estimators.errors import OutputError, QueryError
from recordings.report.atomic_output import (
    refuse_input_as_output,
    require_writable_output,
    stage_output_file,
)
from replay.frames.select_statement import (
    convert_to_query_error,
    find_quoted_names,
    run_select_in_stable_order,
    strip_statement_terminator,
)
from replay.frames.shape import LOG_TIME
from replay.frames.topic_source import SOURCE, LossWarning
from replay.logs import TimeAxis
from replay.query.named_tables import NamedTables, open_named_tables
from replay.query.recording_frames import AT_S

_KEY: Final = "key"
#: Digits of a key that identify a recording of a fleet.
_KEY_DIGITS: Final = 12
OPENS: Final = "opens"
#: Polars' errors when a Parquet file cannot be written; for other files, it raises OSError.
_WRITE_FAULT: Final = re.compile(r"(?:underlying IO error|Invalid thrift): (.+)")


@dataclass(frozen=True, slots=True)
class Query:
    """SQL statement over tables; its rows are computed when collected."""

    named: NamedTables
    rows: pl.LazyFrame

    def collect_rows(self, merge_within_s: float | None = None) -> pl.DataFrame:
        """Compute the rows; with `merge_within_s`, group rows at most that far apart into moments.

        Raises:
            PayscopeError: a log cannot be read, or rows cannot be computed.
        """
        with self._convert_to_query_errors():
            rows = self.rows.collect(engine="streaming")
        if merge_within_s is None:
            return rows
        return merge_rows_near_in_time_with_open_commands(
            rows, merge_within_s, self.named.recordings, self.named.fleet
        )

    def write_rows_to_file(self, path: Path, file_format: str, *, overwrites: bool) -> None:
        """Write the rows to a file as they are computed, in bounded memory.

        Args:
            path: path of the file.
            file_format: parquet, csv or arrow.
            overwrites: whether to replace an existing file.

        Raises:
            PayscopeError: a log cannot be read, or the file cannot be written.
        """
        refuse_input_as_output(path, self.named.recordings)
        require_writable_output(path, overwrites=overwrites)
        listed = [name for name, dtype in self.rows.collect_schema().items() if dtype.is_nested()]
        if file_format == "csv" and listed:
            raise OutputError(
                f"{path}: CSV cannot hold lists, and the columns {', '.join(listed)} are lists; "
                "leave them out, or write .parquet or .arrow"
            )
        with (
            stage_output_file(path, overwrites=overwrites) as partial,
            self._convert_to_query_errors(path),
        ):
            match file_format:
                case "csv":
                    self.rows.sink_csv(partial)
                case "arrow":
                    self.rows.sink_ipc(partial, compat_level=pl.CompatLevel.oldest())
                case _:
                    self.rows.sink_parquet(partial)

    def format_viewer_command_of_rows(self, rows: pl.DataFrame) -> str | None:
        """Command that opens the first row that the viewer can show; None if there is none."""
        first = rows.row(0, named=True) if rows.height else {}
        return format_viewer_command_of_row(first, self.named.recordings, self.named.fleet)

    @contextmanager
    def _convert_to_query_errors(self, output: Path | None = None) -> Generator[None]:
        """Convert errors of computing and writing rows to `PayscopeError`."""
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", LossWarning)  # the command reports losses itself
                yield
        except pl.exceptions.PolarsError as error:
            failures = [each.failure for each in self.named.sources if each.failure]
            fault = _WRITE_FAULT.search(str(error))
            if output is not None and fault and not failures:
                raise OutputError(f"{output}: cannot be written ({fault[1]})") from None
            raise (
                failures[0] if failures else convert_to_query_error(error, self.named.tables)
            ) from None


def prepare_query_of_sources(
    sources: Sequence[str], sql: str, time_axis: TimeAxis | None = None
) -> Query:
    """Prepare a query; only the indexes of the sources are read.

    Args:
        sources: sources as for `open_named_tables`.
        sql: one SELECT statement.
        time_axis: time axis of tables.

    Raises:
        PayscopeError: a source cannot be opened, or the statement is not a SELECT over them.
    """
    strip_statement_terminator(sql)  # before logs are opened
    named = open_named_tables(sources, time_axis, find_quoted_names(sql))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LossWarning)
        return Query(named, run_select_in_stable_order(sql, named.tables))


def merge_rows_near_in_time_with_open_commands(
    rows: pl.DataFrame, merge_within_s: float, recordings: Sequence[Path], fleet: str | None
) -> pl.DataFrame:
    """Group rows that are close in time into moments.

    Args:
        rows: rows with `at_s` or `log_time`; those of several recordings also with `source` or
            `key`.
        merge_within_s: largest distance in seconds between rows of one moment.
        recordings: queried recordings.
        fleet: queried results of a fleet, if any.

    Returns:
        One row per moment: its recording or log, `from_s` and `to_s` (or `from` and `to`), `rows`
        and, if a recording was queried, `opens`, the command that opens it.

    Raises:
        QueryError: the rows have no time.
    """
    time = next((name for name in (AT_S, LOG_TIME) if name in rows.columns), None)
    if time is None:
        raise QueryError(
            f"query: --moments needs {AT_S} (recordings) or {LOG_TIME} (topics) among the columns; "
            f"the query has {', '.join(rows.columns)}"
        )
    by = [name for name in (SOURCE, _KEY) if name in rows.columns]
    start, end = ("from_s", "to_s") if time == AT_S else ("from", "to")
    apart: Any = (
        merge_within_s if time == AT_S else pl.duration(microseconds=round(merge_within_s * 1e6))
    )
    is_new = (pl.col(time).diff() > apart).fill_null(value=False).cum_sum()
    number = is_new.over(by) if by else is_new
    found = (
        rows.select(*by, time)
        .drop_nulls(time)
        .sort(*by, time)
        .with_columns(number.alias("moment"))
        .group_by(*by, "moment", maintain_order=True)
        .agg(
            pl.col(time).first().alias(start),
            pl.col(time).last().alias(end),
            pl.len().alias("rows"),
        )
        .drop("moment")
    )
    opens = [
        format_viewer_command_of_row(row, recordings, fleet) for row in found.iter_rows(named=True)
    ]
    if not any(opens):
        return found
    return found.with_columns(pl.Series(OPENS, opens, dtype=pl.String))


def format_viewer_command_of_row(
    row: dict[str, Any], recordings: Sequence[Path], fleet: str | None
) -> str | None:
    """Format the command that opens a row or moment; None if there is no recording of it."""
    at = next((row[n] for n in (AT_S, "from_s", LOG_TIME, "from") if row.get(n) is not None), None)
    if at is None:
        return None
    second = f"{at:%Y-%m-%dT%H:%M:%S.%f}Z" if isinstance(at, datetime) else f"{at:.3f}"
    if fleet is not None and row.get(_KEY):
        return f"payscope fleet open {shlex.quote(fleet)} {row[_KEY][:_KEY_DIGITS]} --at {second}"
    named = [str(each) for each in recordings]
    recording = named[0] if len(named) == 1 else row.get(SOURCE)
    if recording not in named:
        return None
    return f"payscope view {shlex.quote(str(recording))} --at {second}"
