"""Columns of Parquet and Arrow files, read by Arrow since polars may crash on damage."""

import json
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import polars as pl
import pyarrow as pa
from pyarrow.parquet import ParquetFile

from analysis.model.physical_units import find_pint_name
from replay.logs.messages.broken_bytes import BROKEN_BYTES, BrokenBytesError
from replay.logs.tables.header import ColumnName, split_unit_from_column_name

_MAPS: Final = ("units", "unit", "column_units")
_OF_A_COLUMN: Final = (
    "{}.unit",
    "{}.units",
    "{}_unit",
    "{}:unit",
    "unit:{}",
    "unit.{}",
    "units.{}",
)
#: Keys under which a library keeps JSON of its own; pandas' column list has units in `metadata`.
_ATTRIBUTES: Final = ("PANDAS_ATTRS", "attrs", "pandas")
#: Keys of a field's metadata that hold its unit.
_UNIT_KEYS: Final = (b"unit", b"units", b"Unit", b"Units", b"UNIT", b"unit_string")


def open_parquet_or_arrow(path: Path) -> "ParquetColumns":
    """Open the columns of a Parquet file, or of an Arrow (Feather) file."""
    return ParquetColumns(path) if path.suffix.lower() == ".parquet" else ArrowColumns(path)


class ParquetColumns:
    """Flat columns of one file, read on demand. The file is not kept open."""

    def __init__(self, path: Path) -> None:
        """Read the footer.

        Raises:
            BrokenBytesError: it is not a Parquet file, or damaged.
        """
        self._path = path
        self.notes: tuple[str, ...] = ()
        schema = self._read_arrow_schema()
        self.metadata = _decode_metadata_texts(schema.metadata or {})
        flat = [field for field in schema if not pa.types.is_nested(field.type)]
        stated = find_schema_units(self.metadata, [field.name for field in flat])
        self.columns = [
            _make_column_name(field.name, field.metadata or {}, stated.get(field.name))
            for field in flat
        ]
        self.names = [column.name for column in self.columns]

    def _read_arrow_schema(self) -> Any:
        with _convert_arrow_errors(), ParquetFile(self._path) as file:
            self._footer = file.metadata
            return file.schema_arrow

    def read_first_text_cells(self, column_index: int) -> list[str]:  # noqa: ARG002 as of a text
        """Empty, since columns of a Parquet file have types."""
        return []

    @property
    def rows(self) -> int:
        """Number of rows."""
        return int(self._footer.num_rows)

    def read_columns(self, names: Sequence[str]) -> dict[str, pl.Series]:
        """Columns, (rows,) each.

        Raises:
            BrokenBytesError: the pages of a column are damaged.
        """
        return {name: self._read_column_as_series(name) for name in names}

    def _read_column_as_series(self, name: str) -> pl.Series:
        column = self._read_arrow_column(name)
        with _convert_arrow_errors():
            # polars takes it that text is UTF-8, and panics at names that are not
            column.validate(full=True)
            getattr(column.type, "tz", None)
            series = pl.Series(name, column)
        rows = self.rows
        if series.len() != rows:
            raise BrokenBytesError(f"{series.len():,} of {rows:,} rows were found")
        return series

    def _read_arrow_column(self, name: str) -> Any:
        with _convert_arrow_errors(), ParquetFile(self._path, metadata=self._footer) as file:
            return file.read([name])[name]


class ArrowColumns(ParquetColumns):
    """Flat columns of an Arrow file (Feather 2), read on demand."""

    def _read_arrow_schema(self) -> Any:
        with _convert_arrow_errors(), pa.OSFile(str(self._path)) as source:
            file = pa.ipc.open_file(source)
            self._batches = file.num_record_batches
            self._height = sum(file.get_batch(k).num_rows for k in range(self._batches))
            return file.schema

    @property
    def rows(self) -> int:
        """Number of rows."""
        return self._height

    def _read_arrow_column(self, name: str) -> Any:
        with _convert_arrow_errors(), pa.OSFile(str(self._path)) as source:
            place = pa.ipc.open_file(source).schema.get_field_index(name)
            options = pa.ipc.IpcReadOptions(included_fields=[place])
            one = pa.ipc.open_file(source, options=options)
            batches = [one.get_batch(k) for k in range(self._batches)]
            return pa.Table.from_batches(batches, schema=one.schema)[name]


def _decode_metadata_texts(metadata: Mapping[bytes, bytes]) -> dict[str, str]:
    """Metadata entries that are text."""
    return {
        key.decode(errors="replace"): text.decode(errors="replace")
        for key, text in metadata.items()
    }


@contextmanager
def _convert_arrow_errors() -> Generator[None]:
    try:
        yield
    except (pa.ArrowException, *BROKEN_BYTES) as error:
        raise BrokenBytesError(error) from error


def _make_column_name(
    name: str, metadata: dict[bytes, bytes], schema_unit: str | None
) -> ColumnName:
    """Column with the unit from its metadata, the schema's metadata, or its name."""
    stated = next((metadata[key] for key in _UNIT_KEYS if key in metadata), b"")
    bare, unit = split_unit_from_column_name(name)
    own = find_pint_name(stated.decode("utf-8", "replace"))
    return ColumnName(name, bare, own or schema_unit or unit)


def find_schema_units(metadata: Mapping[str, str], names: Sequence[str]) -> dict[str, str]:
    """Units stated in a file's metadata, by column, in pint's names.

    Args:
        metadata: metadata of the file, as text.
        names: names of its columns.
    """
    found: dict[str, str] = {}
    for name, text in _iter_units_in_metadata(metadata, names):
        unit = find_pint_name(text)
        if unit is not None:
            found.setdefault(name, unit)
    return found


def _iter_units_in_metadata(
    metadata: Mapping[str, str], names: Sequence[str]
) -> Iterator[tuple[str, str]]:
    for name in names:
        keys = (form.format(name) for form in _OF_A_COLUMN)
        yield from ((name, metadata[key]) for key in keys if key in metadata)
    known = frozenset(names)
    for key in _MAPS:
        yield from _iter_units_in_json_map(parse_json_or_none(metadata.get(key)), known)
    for key in _ATTRIBUTES:
        yield from iter_attribute_units(parse_json_or_none(metadata.get(key)), known)


def iter_attribute_units(attributes: Any, known_names: frozenset[str]) -> Iterator[tuple[str, str]]:
    """Units in attributes: a map of units, a map per column, or columns with `metadata`."""
    if not isinstance(attributes, dict):
        return
    for key in _MAPS:
        yield from _iter_units_in_json_map(attributes.get(key), known_names)
    yield from _iter_units_in_json_map(attributes, known_names)
    columns = attributes.get("columns")
    for column in columns if isinstance(columns, list) else ():
        if isinstance(column, dict) and isinstance(column.get("name"), str):
            yield from _iter_units_in_json_map(
                {column["name"]: column.get("metadata")}, known_names
            )


def _iter_units_in_json_map(units: Any, known_names: frozenset[str]) -> Iterator[tuple[str, str]]:
    """Units in `{"speed": "km/h"}`, or `{"speed": {"unit": "km/h"}}`."""
    for name, stated in units.items() if isinstance(units, dict) else ():
        if name not in known_names:
            continue
        if isinstance(stated, dict):
            stated = next((stated[key] for key in _MAPS if key in stated), None)
        if isinstance(stated, str):
            yield name, stated


def parse_json_or_none(text: str | None) -> Any:
    """Parsed JSON; None if invalid or nested too deeply."""
    try:
        return json.loads(text) if text else None
    except (ValueError, RecursionError):
        return None
