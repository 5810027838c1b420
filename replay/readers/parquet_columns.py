"""Columns of a Parquet file, read with Arrow: polars' own reader can end the process on damage."""

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import polars as pl
import pyarrow as pa
from pyarrow.parquet import ParquetFile

from replay.messages.broken import BROKEN_BYTES


class ParquetColumns:
    """The flat columns of one file, each read when it is asked for. Nothing stays open."""

    def __init__(self, path: Path) -> None:
        """Read the footer.

        Raises:
            OSError: it is no Parquet file, or a damaged one.
        """
        self._path = path
        with _one_kind_of_fault(), ParquetFile(path) as file:
            self._footer = file.metadata
            fields = [f for f in file.schema_arrow if not pa.types.is_nested(f.type)]
            self.names: list[str] = [field.name for field in fields]

    def read(self, name: str) -> pl.Series:
        """A column, (rows,).

        Raises:
            OSError: its pages are damaged.
        """
        with _one_kind_of_fault(), ParquetFile(self._path, metadata=self._footer) as file:
            column = _series(file.read([name])[name]).alias(name)
            if column.len() != self._footer.num_rows:
                raise OSError(f"{column.len():,} of {self._footer.num_rows:,} rows are there")
            return column


def _series(column: pa.ChunkedArray) -> pl.Series:
    # polars takes it that text is UTF-8, and panics at names that are not
    column.validate(full=True)
    getattr(column.type, "tz", None)
    return pl.Series(column)


@contextmanager
def _one_kind_of_fault() -> Generator[None]:
    try:
        yield
    except (pa.ArrowException, *BROKEN_BYTES) as error:
        raise OSError(" ".join(str(error).split())) from error
