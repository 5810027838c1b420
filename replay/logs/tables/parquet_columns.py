"""Read the columns of Parquet, Arrow and JSON-lines files.

Arrow reads the first two, since polars may crash on a damaged file.
"""

import codecs
import gzip
import io
import json
from collections import Counter
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import NoneType
from typing import Any, Final

import polars as pl
import pyarrow as pa
from pyarrow.parquet import ParquetFile

from analysis.model.physical_units import find_pint_unit_name
from estimators.errors import format_count
from replay.logs.messages.broken_bytes import BROKEN_BYTES, BrokenBytesError
from replay.logs.tables.header import ColumnName, split_unit_from_column_name
from replay.logs.tables.hints import JSON_LINES
from replay.logs.tables.table_limits import LIMITS

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
#: Keys under which libraries store JSON with units; pandas has them in `metadata` of its columns.
_ATTRIBUTES: Final = ("PANDAS_ATTRS", "attrs", "pandas")
#: Keys of a field's metadata that hold its unit.
_UNIT_KEYS: Final = (b"unit", b"units", b"Unit", b"Units", b"UNIT", b"unit_string")
#: Errors that polars raises for text that it cannot parse; a panic is not an `Exception`.
_POLARS_ERRORS: Final = (pl.exceptions.PolarsError, pl.exceptions.PanicException)
#: Constants that Python writes and JSON does not have, and the escape of the NUL character.
_NUL: Final = rb"\u0000"
_NO_JSON: Final = (b"NaN", b"Infinity", _NUL)
#: Kinds of JSON values, by the Python type that represents them; other types are numbers.
_JSON_KINDS: Final = {
    dict: "objects", list: "lists", bool: "truths", str: "texts", NoneType: None,
}  # fmt: skip


def open_typed_columns(path: Path, suffix: str) -> "ParquetColumns":
    """Open the columns of a file whose cells have types.

    Args:
        path: the file.
        suffix: its format: "parquet", "arrow", "feather" or one of `JSON_LINES`.
    """
    if suffix in JSON_LINES:
        return JsonLinesColumns(path)
    return ParquetColumns(path) if suffix == "parquet" else ArrowColumns(path)


class ParquetColumns:
    """Flat columns of one file, read on demand. The file is not kept open."""

    def __init__(self, path: Path) -> None:
        """Read the footer.

        Raises:
            BrokenBytesError: it is not a Parquet file, or damaged.
        """
        self._path = path
        self.notes: tuple[str, ...] = ()
        self.losses: tuple[str, ...] = ()
        schema = self._read_arrow_schema()
        self.metadata = _decode_metadata_texts(schema.metadata or {})
        flat = [field for field in schema if not pa.types.is_nested(field.type)]
        stated = find_schema_units(self.metadata, [field.name for field in flat])
        self.columns = [
            _make_column_name(field.name, field.metadata or {}, stated.get(field.name))
            for field in flat
        ]
        self.names = [column.name for column in self.columns]
        self._text_names = {field.name for field in flat if is_text_type(field.type)}

    def _read_arrow_schema(self) -> Any:
        with _convert_arrow_errors(), ParquetFile(self._path) as file:
            self._footer = file.metadata
            return file.schema_arrow

    def read_first_text_cells(self, column_index: int, count: int = 50) -> list[str]:
        """The first `count` non-empty cells of a text column; empty for other columns."""
        name = self.names[column_index]
        if name not in self._text_names:
            return []
        cells = self._read_column_as_series(name).cast(pl.String)
        return cells.filter(cells.str.len_bytes() > 0).head(count).to_list()

    @property
    def rows(self) -> int:
        """Number of rows."""
        return int(self._footer.num_rows)

    def read_columns(self, names: Sequence[str]) -> dict[str, pl.Series]:
        """Read columns by name, (rows,) each.

        Raises:
            BrokenBytesError: the pages of a column are damaged.
        """
        return {name: self._read_column_as_series(name) for name in names}

    def _read_column_as_series(self, name: str) -> pl.Series:
        column = self._read_arrow_column(name)
        with _convert_arrow_errors():
            # polars assumes that text is UTF-8, and panics otherwise
            column.validate(full=True)
            getattr(column.type, "tz", None)
            series = pl.Series(name, column)
        if isinstance(series.dtype, pl.Categorical | pl.Enum):
            series = series.cast(pl.String)
        rows = self.rows
        if series.len() != rows:
            raise BrokenBytesError(f"column '{name}' has {series.len():,} rows, the file {rows:,}")
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


def is_text_type(arrow_type: Any) -> bool:
    """Whether an Arrow type is text, also if dictionary-encoded."""
    if pa.types.is_dictionary(arrow_type):
        arrow_type = arrow_type.value_type
    is_view = pa.types.is_string_view(arrow_type)
    return is_view or pa.types.is_string(arrow_type) or pa.types.is_large_string(arrow_type)


class JsonLinesColumns(ParquetColumns):
    """Columns of a file with a JSON object per line, kept in memory.

    Members of nested objects become columns such as `wheel.torque`, elements of short lists columns
    such as `accel[0]`.
    """

    def _read_arrow_schema(self) -> Any:
        opened = gzip.open if self._path.suffix.lower() == ".gz" else open
        try:
            with opened(self._path, "rb") as file:
                text = file.read(LIMITS.json_max_bytes + 1)
        except BROKEN_BYTES as error:
            raise BrokenBytesError(error) from error
        if len(text) > LIMITS.json_max_bytes:
            size = f"{LIMITS.json_max_bytes >> 30} GiB"
            raise BrokenBytesError(f"it is larger than {size}; save it as Parquet")
        try:
            frame = self._parse_lines(text.removeprefix(codecs.BOM_UTF8))
            self._table = self._flatten_columns(frame).to_arrow()
        except pl.exceptions.DuplicateError as error:
            raise BrokenBytesError(
                f"two fields of a line become columns of the same name: {error}; rename one of them"
            ) from error
        except (*_POLARS_ERRORS, pa.ArrowException, OverflowError) as error:
            raise BrokenBytesError(error) from error
        return self._table.schema

    def _parse_lines(self, text: bytes) -> pl.DataFrame:
        """Parse all lines at once; line by line, keeping only objects, if that fails."""
        if _NUL not in text:  # a name with one makes polars panic
            with suppress(*_POLARS_ERRORS):
                return pl.read_ndjson(io.BytesIO(text), infer_schema_length=None)
        lines: list[bytes] = []
        faults: list[int] = []
        for number, line in enumerate(text.split(b"\n"), start=1):
            line_text = line.decode("utf-8", "replace").strip()
            row = parse_json_or_none(line_text)
            if not isinstance(row, dict):
                faults += [number] if line_text else []
            elif any(word in line for word in _NO_JSON):
                lines.append(json.dumps(row).replace("\\u0000", "").encode())
            else:
                lines.append(line_text.encode())
        if not lines:
            raise BrokenBytesError("no line is a JSON object")
        if faults:
            dropped = format_count(len(faults), "line")
            self.losses += (
                f"{dropped} dropped: not JSON objects; the first is line {faults[0]:,}",
            )
        try:
            return pl.read_ndjson(io.BytesIO(b"\n".join(lines)), infer_schema_length=None)
        except _POLARS_ERRORS:
            return self._parse_each_column([json.loads(line) for line in lines])

    def _parse_each_column(self, rows: list[dict[str, Any]]) -> pl.DataFrame:
        """Make columns of the kind that most of their values have; other values become null."""
        columns: list[pl.Series] = []
        for name in dict.fromkeys(name for row in rows for name in row):
            values = [row.get(name) for row in rows]
            kinds = Counter(_find_json_kind(value) for value in values if value is not None)
            kind = kinds.most_common(1)[0][0] if kinds else None
            if len(kinds) > 1:
                count = format_count(kinds.total() - kinds[str(kind)], "value")
                self.losses += (f"{count} of '{name}' lost: most are {kind}, these are not",)
            own = [{name: value if _find_json_kind(value) == kind else None} for value in values]
            columns.append(pl.from_dicts(own, infer_schema_length=None, strict=False)[name])
        return pl.DataFrame(columns)

    def _flatten_columns(self, frame: pl.DataFrame) -> pl.DataFrame:
        """Turn members of objects and elements of short lists into columns; drop long lists."""
        columns: list[pl.Series] = []
        waiting = frame.get_columns()[::-1]
        while waiting:
            column = waiting.pop()
            name = column.name
            if isinstance(column.dtype, pl.Struct):
                inner = column.struct.unnest().get_columns()
                waiting += [each.alias(f"{name}.{each.name}") for each in inner[::-1]]
            elif isinstance(column.dtype, pl.List):
                lengths = column.list.len().drop_nulls()
                lengths = lengths.filter(lengths > 0)
                count = int(lengths.mode().max() or 0)  # pyright: ignore[reportArgumentType] a length
                if count > LIMITS.list_max_elements:
                    self.notes += (f"'{name}' is left out: a list of {count} elements",)
                    continue
                if others := int((lengths != count).sum()):
                    said = format_count(others, "row")
                    self.losses += (f"'{name}' does not have {count} elements in {said}",)
                waiting += [
                    column.list.get(k, null_on_oob=True).alias(f"{name}[{k}]")
                    for k in reversed(range(count))
                ]
            else:
                wide = isinstance(column.dtype, pl.Int128 | pl.UInt128)
                columns.append(column.cast(pl.Float64) if wide else column)
        return pl.DataFrame(columns)

    @property
    def rows(self) -> int:
        """Number of rows."""
        return int(self._table.num_rows)

    def _read_arrow_column(self, name: str) -> Any:
        return self._table[name]


def _find_json_kind(value: Any) -> str | None:
    """Kind of a JSON value: a name from `_JSON_KINDS`, else "numbers"; None for null."""
    return _JSON_KINDS.get(type(value), "numbers")


def _decode_metadata_texts(metadata: Mapping[bytes, bytes]) -> dict[str, str]:
    """Decode metadata entries as UTF-8; invalid bytes are replaced."""
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
    """Make a column's name, with the unit from its metadata, the schema's, or the name itself."""
    stated = next((metadata[key] for key in _UNIT_KEYS if key in metadata), b"")
    bare, unit = split_unit_from_column_name(name)
    own = find_pint_unit_name(stated.decode("utf-8", "replace"))
    return ColumnName(name, bare, own or schema_unit or unit)


def find_schema_units(metadata: Mapping[str, str], names: Sequence[str]) -> dict[str, str]:
    """Find the units stated in a file's metadata, by column, as pint names them.

    Args:
        metadata: metadata of the file, as text.
        names: names of its columns.
    """
    found: dict[str, str] = {}
    for name, text in _iter_units_in_metadata(metadata, names):
        unit = find_pint_unit_name(text)
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
    """Yield columns and units from attributes.

    Known forms are a map of units, a map per column, and a list of columns with `metadata`.
    """
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
        return json.loads(text, parse_constant=lambda _: None) if text else None
    except (ValueError, RecursionError):
        return None
