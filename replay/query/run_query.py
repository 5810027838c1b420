"""The command `query`: a SELECT over what is named, its rows on the screen or in a file."""

import warnings
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import polars as pl

from estimators.errors import OutputError
from recordings.report.atomic_output import atomic_file, check_output, keep_apart
from replay.frames.select_statement import checked_select, query_fault, quoted_names, select_rows
from replay.frames.topic_source import LossWarning
from replay.logs import TimeAxis
from replay.query.moments import moments, opening
from replay.query.named_tables import NamedTables, named_tables


@dataclass(frozen=True, slots=True)
class Query:
    """A statement over tables; its rows are computed when they are taken."""

    named: NamedTables
    rows: pl.LazyFrame

    def collect(self, apart_s: float | None = None) -> pl.DataFrame:
        """The rows, or where `apart_s` says how far apart rows of one are, the moments.

        Raises:
            PayscopeError: a log cannot be read, or rows cannot be computed.
        """
        with self._faults():
            rows = self.rows.collect(engine="streaming")
        if apart_s is None:
            return rows
        return moments(rows, apart_s, self.named.recordings, self.named.fleet)

    def write(self, path: Path, file_format: str, *, force: bool) -> None:
        """Write the rows to a file as they are computed, in bounded memory.

        Args:
            path: the file.
            file_format: parquet, csv or arrow.
            force: whether to replace it.

        Raises:
            PayscopeError: a log cannot be read, the file cannot be written.
        """
        keep_apart(path, self.named.recordings)
        check_output(path, force=force)
        listed = [name for name, dtype in self.rows.collect_schema().items() if dtype.is_nested()]
        if file_format == "csv" and listed:
            raise OutputError(
                f"{path}: CSV has no lists, and {', '.join(listed)} are; leave them out, or write "
                ".parquet or .arrow"
            )
        with atomic_file(path, force=force) as partial, self._faults():
            match file_format:
                case "csv":
                    self.rows.sink_csv(partial)
                case "arrow":
                    self.rows.sink_ipc(partial, compat_level=pl.CompatLevel.oldest())
                case _:
                    self.rows.sink_parquet(partial)

    def opens(self, rows: pl.DataFrame) -> str | None:
        """The command that opens the first row in the viewer, if any does."""
        first = rows.row(0, named=True) if rows.height else {}
        return opening(first, self.named.recordings, self.named.fleet)

    @contextmanager
    def _faults(self) -> Generator[None]:
        """What goes wrong while rows are computed, as ours: polars gives the text of an error."""
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", LossWarning)  # the command says losses itself
                yield
        except pl.exceptions.PolarsError as error:
            failures = [each.failure for each in self.named.sources if each.failure]
            raise (failures[0] if failures else query_fault(error, self.named.tables)) from None


def query(sources: Sequence[str], sql: str, time: TimeAxis | None = None) -> Query:
    """Prepare a query; nothing but indices is read.

    Args:
        sources: as for `named_tables`.
        sql: one SELECT.
        time: where tables keep their time.

    Raises:
        PayscopeError: a source that cannot be opened, a statement that is no SELECT over them.
    """
    checked_select(sql)  # before logs are opened
    named = named_tables(sources, time, quoted_names(sql))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LossWarning)
        return Query(named, select_rows(sql, named.tables))
