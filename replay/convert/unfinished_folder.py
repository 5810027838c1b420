"""Keep the state of an unfinished conversion: its plan, and the completed time spans.

It is in a folder beside the output. A span is complete when its record exists, which is written
after its parts, one Parquet file per topic; all other files belong to an interrupted span.
"""

import fcntl
import os
import shutil
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Final, Self, TypeVar

import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import BaseModel, ConfigDict, ValidationError

from estimators.errors import OutputError
from estimators.file_digest import file_sha256
from replay.convert.convert_limits import LIMITS
from replay.logs.converted.description import LOG_TIME, ConvertedPart, SourceFile

_SUFFIX: Final = ".unfinished"
_PLAN: Final = "plan.json"
_LOCK: Final = ".lock"
_Model = TypeVar("_Model", bound=BaseModel)


class PartWriter:
    """Writer of a part under a temporary name, which `close_and_describe_part` renames."""

    def __init__(self, folder: Path, file: str, schema: pa.Schema) -> None:
        """Create the file.

        Args:
            folder: folder of the conversion.
            file: path relative to the folder, as in the description.
            schema: schema of the topic.
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

    def append_rows(self, new_rows: pl.DataFrame) -> None:
        """Append rows, which are buffered up to the size of a row group."""
        self._waiting.append(new_rows)
        self._waiting_rows += new_rows.height
        self._waiting_bytes += int(new_rows.estimated_size())
        if self._waiting_rows >= LIMITS.group_rows or self._waiting_bytes >= LIMITS.group_bytes:
            self._write_buffered_rows()

    def _write_buffered_rows(self) -> None:
        if not self._waiting_rows:
            return
        rows = pl.concat(self._waiting)
        self._waiting, self._waiting_rows, self._waiting_bytes = [], 0, 0
        first, last = rows[LOG_TIME][0], rows[LOG_TIME][-1]
        self._first = first if self._first is None else min(first, self._first)
        self._last = last if self._last is None else max(last, self._last)
        self._rows += rows.height
        table = rows.to_arrow(compat_level=pl.CompatLevel.oldest()).cast(self._schema)
        self._writer.write_table(table, row_group_size=LIMITS.group_rows)

    def close_and_describe_part(self) -> ConvertedPart:
        """Finish the file and describe its content."""
        self._write_buffered_rows()
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
        """Release a file that was not closed; it keeps its temporary name."""
        self._writer.close()


class ConversionPlan(BaseModel):
    """Plan of a conversion; parts of another plan cannot be reused."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    payscope: str
    files: tuple[SourceFile, ...]
    topics: tuple[str, ...]
    #: log times at which spans begin; the first begins with the log, the last ends with it
    borders_ns: tuple[int, ...]


class FinishedSpan(BaseModel):
    """Parts of a completed span, by topic."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    parts: dict[str, ConvertedPart]


class UnfinishedFolder:
    """The folder of an unfinished conversion.

    Attributes:
        path: path of the folder.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def resume_or_restart_conversion(self, conversion_plan: ConversionPlan) -> list[FinishedSpan]:
        """Resume a conversion if it has the same plan; else remove its content.

        Returns:
            The completed spans, from the first on.
        """
        if load_json_model_or_none(self.path / _PLAN, ConversionPlan) != conversion_plan:
            self.remove_content_except_lock()
            write_file_atomically(self.path / _PLAN, conversion_plan.model_dump_json(indent=1))
            return []
        done: list[FinishedSpan] = []
        while span := load_json_model_or_none(
            self.path / _make_span_file_name(len(done)), FinishedSpan
        ):
            if not all((self.path / part.file).is_file() for part in span.parts.values()):
                break
            done.append(span)
        return done

    def record_finished_span(
        self, span_number: int, parts_by_topic: dict[str, ConvertedPart]
    ) -> FinishedSpan:
        """Record that a span is complete, with its parts."""
        span = FinishedSpan(parts=parts_by_topic)
        write_file_atomically(
            self.path / _make_span_file_name(span_number), span.model_dump_json(indent=1)
        )
        return span

    def remove_content_except_lock(self) -> None:
        """Remove everything in the folder except its lock."""
        for each in self.path.iterdir():
            if each.is_dir():
                shutil.rmtree(each)
            elif each.name != _LOCK:
                each.unlink()

    def remove_all_except(self, kept_files: set[str]) -> None:
        """Remove everything except the parts of a finished conversion.

        Args:
            kept_files: files to keep, by their paths relative to the folder.
        """
        for each in sorted(self.path.rglob("*"), reverse=True):
            if each.is_file() and each.relative_to(self.path).as_posix() not in kept_files:
                each.unlink()


@contextmanager
def open_unfinished_folder(target: Path) -> Generator[UnfinishedFolder]:
    """Context with the working folder for `target`, locked for this process.

    Raises:
        OutputError: another process is converting to the same output.
    """
    path = target.with_name(f"{target.name}{_SUFFIX}")
    path.mkdir(exist_ok=True)
    with (path / _LOCK).open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise OutputError(
                f"{target}: another process is converting to this folder; wait for it, or name "
                "another folder"
            ) from None
        yield UnfinishedFolder(path)


def write_file_atomically(path: Path, text: str) -> None:
    """Write a small file atomically and durably, even if power fails."""
    partial = path.with_suffix(".partial")
    with partial.open("w", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    partial.replace(path)


def _make_span_file_name(span_number: int) -> str:
    return f"span-{span_number:05}.json"


def load_json_model_or_none(path: Path, model: type[_Model]) -> _Model | None:
    """Read a JSON file as a model; None if it is missing or does not fit the model."""
    try:
        return model.model_validate_json(path.read_bytes())
    except (FileNotFoundError, ValidationError):
        return None


def make_arrow_schema_with_units(
    schema: pl.Schema, units: dict[str, str], metadata: dict[str, str]
) -> pa.Schema:
    """Make the Arrow schema of a topic's files, with units of fields and metadata."""
    plain = pl.DataFrame(schema=schema).to_arrow(compat_level=pl.CompatLevel.oldest()).schema
    fields = [
        field.with_metadata({"unit": units[field.name]}) if units.get(field.name) else field
        for field in plain
    ]
    return pa.schema(fields, metadata=metadata)
