"""Columns of a Parquet file, read with Arrow: polars' own reader can end the process on damage."""

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import polars as pl
import pyarrow as pa
from pyarrow.parquet import ParquetFile

from replay.messages.broken import BROKEN_BYTES, BrokenBytesError


class ParquetColumns:
    """The flat columns of one file, each read when it is asked for. Nothing stays open."""

    def __init__(self, path: Path) -> None:
        """Read the footer.

        Raises:
            BrokenBytesError: it is no Parquet file, or a damaged one.
        """
        self._path = path
        with _library_call(), ParquetFile(path) as file:
            self._footer = file.metadata
            schema: Any = file.schema_arrow
        self.names: list[str] = [f.name for f in schema if not pa.types.is_nested(f.type)]

    def read(self, name: str) -> pl.Series:
        """A column, (rows,).

        Raises:
            BrokenBytesError: its pages are damaged.
        """
        with _library_call(), ParquetFile(self._path, metadata=self._footer) as file:
            column = file.read([name])[name]
            # polars takes it that text is UTF-8, and panics at names that are not
            column.validate(full=True)
            getattr(column.type, "tz", None)
            series = pl.Series(name, column)
        rows = self._footer.num_rows
        if series.len() != rows:
            raise BrokenBytesError(f"{series.len():,} of {rows:,} rows are there")
        return series


@contextmanager
def _library_call() -> Generator[None]:
    try:
        yield
    except (pa.ArrowException, *BROKEN_BYTES) as error:
        raise BrokenBytesError(error) from error
