"""One Parquet file of a topic: rows are gathered into row groups and written as they come."""

import os
from pathlib import Path
from types import TracebackType
from typing import Final, Self

import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq

from estimators.file_digest import file_sha256
from replay.logs.converted.description import LOG_TIME, ConvertedPart

#: A reader of some rows unpacks whole row groups; smaller ones are larger on the disk.
_GROUP_ROWS: Final = 1 << 17
#: Of rows that are large by themselves, such as images.
_GROUP_BYTES: Final = 32 << 20


def arrow_schema(schema: pl.Schema, units: dict[str, str], metadata: dict[str, str]) -> pa.Schema:
    """The schema of a topic's files, its fields with their units, with metadata of its own."""
    plain = pl.DataFrame(schema=schema).to_arrow(compat_level=pl.CompatLevel.oldest()).schema
    fields = [
        field.with_metadata({"unit": units[field.name]}) if units.get(field.name) else field
        for field in plain
    ]
    return pa.schema(fields, metadata=metadata)


class PartWriter:
    """Writes a part under a temporary name; `close` gives it its own."""

    def __init__(self, folder: Path, file: str, schema: pa.Schema) -> None:
        """Begin a file.

        Args:
            folder: of the conversion.
            file: below it, as its description names it.
            schema: of the topic.
        """
        self._path, self._file, self._schema = folder / file, file, schema
        self._path.parent.mkdir(exist_ok=True)
        self._partial = self._path.with_suffix(".partial")
        self._writer = pq.ParquetWriter(
            self._partial, schema, compression="zstd", write_page_checksum=True
        )
        self._waiting: list[pl.DataFrame] = []
        self._waiting_rows = self._waiting_bytes = 0
        self._rows = 0
        self._first: int | None = None
        self._last: int | None = None

    def write(self, rows: pl.DataFrame) -> None:
        """Take rows, which follow those before."""
        self._waiting.append(rows)
        self._waiting_rows += rows.height
        self._waiting_bytes += int(rows.estimated_size())
        if self._waiting_rows >= _GROUP_ROWS or self._waiting_bytes >= _GROUP_BYTES:
            self._flush()

    def _flush(self) -> None:
        if not self._waiting_rows:
            return
        rows = pl.concat(self._waiting)
        self._waiting, self._waiting_rows, self._waiting_bytes = [], 0, 0
        first, last = rows[LOG_TIME][0], rows[LOG_TIME][-1]
        self._first = first if self._first is None else min(first, self._first)
        self._last = last if self._last is None else max(last, self._last)
        self._rows += rows.height
        table = rows.to_arrow(compat_level=pl.CompatLevel.oldest()).cast(self._schema)
        self._writer.write_table(table, row_group_size=_GROUP_ROWS)

    def close(self) -> ConvertedPart:
        """End the file, and say what is in it."""
        self._flush()
        self._writer.close()
        with self._partial.open("rb") as written:
            os.fsync(written.fileno())
        self._partial.replace(self._path)
        return ConvertedPart(
            file=self._file,
            rows=self._rows,
            size_bytes=self._path.stat().st_size,
            sha256=file_sha256(self._path),
            start_ns=self._first,
            end_ns=self._last,
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Let go of a file that was not closed: it stays under its temporary name."""
        self._writer.close()
