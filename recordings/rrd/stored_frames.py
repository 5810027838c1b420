"""Store frames in a recording in blocks of rows, each column of a block as one list.

Rerun stores row id and times in every row and an offset in every cell, which take more space than
the numbers themselves. So a frame that is not drawn is stored in rows of many values each. Rerun
does not keep empty frames, the order of columns and their dtypes: a manifest has these.
"""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Final, Self

import numpy as np
import polars as pl
from pydantic import BaseModel, ConfigDict

from estimators.errors import OutputError
from recordings.rrd.recording_limits import LIMITS
from recordings.rrd.stored_names import ROW, make_component_name, split_frame_name_to_path

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


class StoredColumn(BaseModel):
    """Original type of a stored column."""

    model_config = ConfigDict(frozen=True)

    name: str
    dtype: str
    categories: tuple[str, ...] = ()

    @classmethod
    def from_series(cls, series: pl.Series) -> Self:
        """Describe the dtype of `series`.

        Raises:
            OutputError: its dtype cannot be stored, or it has no name.
        """
        dtype = series.dtype
        if not series.name:
            raise OutputError(
                "a column of the log has an empty name, which cannot be stored; name it in the log"
            )
        if isinstance(dtype, pl.Enum):
            categories = tuple(dtype.categories.to_list())
            return cls(name=series.name, dtype=_ENUM, categories=categories)
        if str(dtype) not in _DTYPES:
            known = ", ".join((*_DTYPES, _ENUM))
            raise OutputError(
                f"column '{series.name}': a {dtype} cannot be stored; supported: {known}"
            )
        return cls(name=series.name, dtype=str(dtype))

    @property
    def polars_dtype(self) -> pl.DataType:
        """The original dtype in polars."""
        return pl.Enum(self.categories) if self.dtype == _ENUM else _DTYPES[self.dtype]()

    def encode_series(self, series: pl.Series) -> pl.Series:
        """Convert `series` to its stored form: an enum to the numbers of its categories."""
        return series.to_physical() if self.dtype == _ENUM else series

    def decode_series(self, series: pl.Series) -> pl.Series:
        """Undo `encode_series`."""
        if self.dtype != _ENUM:
            return series.cast(self.polars_dtype)
        categories = pl.Series(series.name, self.categories, dtype=self.polars_dtype)
        return categories.gather(series)


class StoredFrame(BaseModel):
    """Original schema of a stored frame."""

    model_config = ConfigDict(frozen=True)

    name: str
    rows: int
    columns: tuple[StoredColumn, ...]

    @classmethod
    def from_frame(cls, name: str, frame: pl.DataFrame) -> Self:
        """Describe the schema of `frame`.

        Raises:
            OutputError: a column's dtype cannot be stored.
        """
        columns = tuple(StoredColumn.from_series(series) for series in frame.get_columns())
        return cls(name=name, rows=frame.height, columns=columns)

    @property
    def entity_path_text(self) -> str:
        """Entity path of the frame."""
        return make_entity_path(self.name)

    def select_columns(self, columns: Sequence[str]) -> tuple[StoredColumn, ...]:
        """Select some of its columns, in the given order."""
        by_name = {column.name: column for column in self.columns}
        return tuple(by_name[name] for name in columns)

    def iter_blocks_of_frame(self, frame: pl.DataFrame) -> "Iterator[pa.RecordBatch]":
        """Yield blocks of the frame, each a record batch of a row, indexed by its first row."""
        import pyarrow as pa

        for number, part in enumerate(frame.iter_slices(LIMITS.stored_block_rows)):
            arrays: list[pa.Array] = [pa.array(np.array([number * LIMITS.stored_block_rows]))]
            fields = [pa.field(ROW, arrays[0].type)]
            whole = pa.array(np.array([0, part.height], dtype=np.int32))
            for column in self.columns:
                values = column.encode_series(part[column.name]).to_arrow()
                if pa.types.is_large_string(values.type):
                    values = values.cast(pa.string())
                name = make_component_name(column.name)
                arrays.append(pa.ListArray.from_arrays(whole, values))
                metadata = {"rerun:entity_path": self.entity_path_text, "rerun:component": name}
                fields.append(pa.field(name, arrays[-1].type, metadata=metadata))
            yield pa.record_batch(arrays, schema=pa.schema(fields))

    def rebuild_frame_from_blocks(
        self, batches: "Sequence[pa.RecordBatch]", columns: Sequence[StoredColumn]
    ) -> pl.DataFrame:
        """Rebuild columns of the frame from its blocks, in any order.

        Args:
            batches: record batches, a row per block.
            columns: columns to rebuild.
        """
        import pyarrow as pa

        found = [
            group_column_values_by_block(batches, make_component_name(column.name))
            for column in columns
        ]
        # blocks of a damaged recording may lack a column: only complete blocks are used
        whole = sorted(set.intersection(*(set(each) for each in found))) if found else []
        series: list[pl.Series] = []
        for column, blocks in zip(columns, found, strict=True):
            if whole:
                parts = pa.chunked_array([blocks[first] for first in whole])
                series.append(column.decode_series(pl.Series(column.name, pl.from_arrow(parts))))
            else:
                series.append(pl.Series(column.name, dtype=column.polars_dtype))
        return pl.DataFrame(series)


def group_column_values_by_block(
    block_batches: "Sequence[pa.RecordBatch]", column_name: str
) -> "dict[int, pa.Array]":
    """Group the values of a column by the first row of their block.

    `rerun rrd optimize` separates small columns from large ones, so a batch may lack columns.
    """
    found: dict[int, pa.Array] = {}
    for batch in block_batches:
        if column_name not in batch.schema.names:
            continue
        values = batch.column(column_name)
        there = values.is_valid().to_pylist()
        for row, first in enumerate(batch.column(ROW).to_pylist()):
            if there[row]:
                found[first] = values.slice(row, 1).flatten()
    return found


class Manifest(BaseModel):
    """Order and schema of a run's frames, which Rerun would not keep."""

    model_config = ConfigDict(frozen=True)

    frames: tuple[StoredFrame, ...]

    def find_frame_by_name(self, name: str) -> StoredFrame | None:
        """Find the frame of this name; None if absent."""
        return next((frame for frame in self.frames if frame.name == name), None)


def make_entity_path(frame_name: str, parent_entity: str = "") -> str:
    """Make the entity path of a frame in Rerun's spelling, below a parent if there is one."""
    import rerun as rr

    prefix = parent_entity.strip("/")
    path = rr.new_entity_path(list(split_frame_name_to_path(frame_name)))
    return f"/{prefix}{path}" if prefix else path
