"""Store drawn frames in a recording: a row per sample, on two timelines."""

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
import polars as pl

from recordings.rrd.recording_limits import LIMITS
from recordings.rrd.stored_frames import make_entity_path
from recordings.rrd.stored_names import SINCE_START, TIME, make_component_name

if TYPE_CHECKING:
    import pyarrow as pa


def iter_record_batches_to_draw(
    name: str,
    frame: pl.DataFrame,
    t0_unix_ns: int,
    parent_entity: str = "",
    extra_times: "Mapping[str, pa.Scalar]" = MappingProxyType({}),
) -> "Iterator[pa.RecordBatch]":
    """Yield record batches of a frame, with the timelines as first columns.

    Args:
        name: name of the frame.
        frame: frame with `t_ns`, and floats or texts.
        t0_unix_ns: Unix time of `t_ns` 0.
        parent_entity: parent entity; empty for none.
        extra_times: additional timelines, each with one time for all rows.
    """
    import pyarrow as pa

    entity = make_entity_path(name, parent_entity)
    for part in frame.iter_slices(LIMITS.drawn_chunk_rows):
        since_start = part["t_ns"]
        arrays: dict[str, pa.Array] = {
            TIME: (since_start + t0_unix_ns).to_arrow().cast(pa.timestamp("ns")),
            SINCE_START: since_start.to_arrow().cast(pa.duration("ns")),
            **{timeline: pa.repeat(time, part.height) for timeline, time in extra_times.items()},
        }
        fields = [pa.field(name, array.type) for name, array in arrays.items()]
        # a list of one value per row: a null by itself would become a row without any value
        starts = pa.array(np.arange(part.height + 1, dtype=np.int32))
        for column in part.drop("t_ns").get_columns():
            # Rerun draws a line across a null, but not across a NaN
            has_gaps = column.dtype.is_float() and column.null_count()
            drawn = column.fill_null(float("nan")) if has_gaps else column
            values = drawn.to_arrow()
            if pa.types.is_large_string(values.type):
                values = values.cast(pa.string())
            stored = make_component_name(column.name)
            arrays[stored] = pa.ListArray.from_arrays(starts, values)
            metadata = {"rerun:entity_path": entity, "rerun:component": stored}
            fields.append(pa.field(stored, arrays[stored].type, metadata=metadata))
        yield pa.record_batch(list(arrays.values()), schema=pa.schema(fields))
