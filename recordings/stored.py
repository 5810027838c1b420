"""How a frame lies in a recording: its entity, its components, and what each column was.

Rerun forgets empty frames, the order of columns and their dtypes, and it draws a line across a
null. So a manifest goes into the recording, and a missing number in a column of floats is stored
as NaN; `raw` fields, which are not drawn and may hold both, keep their nulls.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final, Literal, Self

import numpy as np
import polars as pl
from pydantic import BaseModel, ConfigDict

from estimators.errors import OutputError
from recordings.table import ROW, SINCE_START, TIME, component, entity_parts

if TYPE_CHECKING:
    import pyarrow as pa

_DTYPES: Final = {
    str(dtype): dtype
    for dtype in (
        pl.Boolean,
        pl.String,
        pl.Float32,
        pl.Float64,
        *(pl.Int8, pl.Int16, pl.Int32, pl.Int64),
        *(pl.UInt8, pl.UInt16, pl.UInt32, pl.UInt64),
    )
}
_ENUM: Final = "Enum"
_TIME_COLUMNS: Final = ("t_ns", "start_t_ns", "log_time_ns")
#: Times further out than 146 years from 1970 are left to the row timeline.
_LATEST_NS: Final = 2**62

RowsBy = Literal["t_ns", "start_t_ns", "log_time_ns", "row"]


class StoredColumn(BaseModel):
    """What a column was before it was stored."""

    model_config = ConfigDict(frozen=True)

    name: str
    dtype: str
    categories: tuple[str, ...] = ()
    missing: Literal["null", "nan"] = "null"

    @classmethod
    def of(cls, series: pl.Series, *, drawable: bool) -> Self:
        """Describe `series`; a drawable one has its missing numbers stored as NaN.

        Raises:
            OutputError: its dtype cannot be stored, or it has no name.
        """
        dtype = series.dtype
        if not series.name:
            raise OutputError("a column without a name cannot be stored; name it in the log")
        if isinstance(dtype, pl.Enum):
            categories = tuple(dtype.categories.to_list())
            return cls(name=series.name, dtype=_ENUM, categories=categories)
        if str(dtype) not in _DTYPES:
            known = ", ".join((*_DTYPES, _ENUM))
            raise OutputError(f"column '{series.name}': cannot store {dtype}; known: {known}")
        as_nan = drawable and dtype.is_float() and not series.is_nan().any()
        return cls(name=series.name, dtype=str(dtype), missing="nan" if as_nan else "null")

    @property
    def polars_dtype(self) -> pl.DataType:
        """The dtype as polars has it."""
        return pl.Enum(self.categories) if self.dtype == _ENUM else _DTYPES[self.dtype]()

    def encode(self, series: pl.Series) -> pl.Series:
        """Make `series` what is stored: an enum as text, a missing number perhaps as NaN."""
        if self.dtype == _ENUM:
            return series.cast(pl.String)
        return series.fill_null(float("nan")) if self.missing == "nan" else series

    def decode(self, series: pl.Series) -> pl.Series:
        """Undo `encode`."""
        typed = series.cast(self.polars_dtype)
        return typed.fill_nan(None) if self.missing == "nan" else typed


class StoredFrame(BaseModel):
    """What a frame was before it was stored, and which of its columns places it in time."""

    model_config = ConfigDict(frozen=True)

    name: str
    rows: int
    rows_by: RowsBy
    columns: tuple[StoredColumn, ...]

    @classmethod
    def of(cls, name: str, frame: pl.DataFrame) -> Self:
        """Describe `frame`.

        Raises:
            OutputError: a column's dtype cannot be stored.
        """
        drawable = entity_parts(name)[0] != "raw"
        return cls(
            name=name,
            rows=frame.height,
            rows_by=_placed_by(frame),
            columns=tuple(StoredColumn.of(s, drawable=drawable) for s in frame.get_columns()),
        )

    @property
    def entity(self) -> str:
        """Its entity path."""
        return entity_path(self.name)

    def select(self, columns: Sequence[str]) -> tuple[StoredColumn, ...]:
        """Some of its columns, in the order asked for."""
        by_name = {column.name: column for column in self.columns}
        return tuple(by_name[name] for name in columns)

    def to_batch(self, part: pl.DataFrame, first_row: int, t0_ns: int) -> "pa.RecordBatch":
        """Make rows of the frame one record batch, with the timelines as its first columns."""
        import pyarrow as pa

        arrays = _timelines(part, self.rows_by, first_row, t0_ns)
        fields = [pa.field(name, array.type) for name, array in arrays.items()]
        # a list of one value a row: a bare null would become a row without any value
        starts = pa.array(np.arange(part.height + 1, dtype=np.int32))
        for column in self.columns:
            name = component(column.name)
            values = column.encode(part[column.name]).to_arrow()
            if pa.types.is_large_string(values.type):
                values = values.cast(pa.string())
            arrays[name] = pa.ListArray.from_arrays(starts, values)
            metadata = {"rerun:entity_path": self.entity, "rerun:component": name}
            fields.append(pa.field(name, arrays[name].type, metadata=metadata))
        return pa.record_batch(list(arrays.values()), schema=pa.schema(fields))


class Manifest(BaseModel):
    """Everything that Rerun would forget of a run's frames, in their order."""

    model_config = ConfigDict(frozen=True)

    frames: tuple[StoredFrame, ...]

    def frame(self, name: str) -> StoredFrame | None:
        """The frame of that name, if there is one."""
        return next((frame for frame in self.frames if frame.name == name), None)


def entity_path(frame: str) -> str:
    """The entity path of a frame, as Rerun spells it."""
    import rerun as rr

    return rr.new_entity_path(list(entity_parts(frame)))


def _placed_by(frame: pl.DataFrame) -> RowsBy:
    for name in _TIME_COLUMNS:
        if name in frame.columns and frame.schema[name] == pl.Int64:
            times = frame[name]
            if times.null_count() == 0 and bool((times.abs() < _LATEST_NS).all()):
                return name
    return ROW


def _timelines(
    part: pl.DataFrame, rows_by: RowsBy, first_row: int, t0_ns: int
) -> "dict[str, pa.Array]":
    import pyarrow as pa

    if rows_by == ROW:
        return {ROW: pa.array(np.arange(first_row, first_row + part.height))}
    since_start = part[rows_by] - t0_ns if rows_by == "log_time_ns" else part[rows_by]
    return {
        TIME: (since_start + t0_ns).to_arrow().cast(pa.timestamp("ns")),
        SINCE_START: since_start.to_arrow().cast(pa.duration("ns")),
    }
