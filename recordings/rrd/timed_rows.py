"""Small frames as rows in time, for Rerun's own tables: a row a load, where the load begins.

Frames are kept in blocks, which only payscope reads (`stored_frames`); these are besides.
"""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Final

import polars as pl

from analysis.model.schema import FRAMES
from recordings.rrd.recording_table import SINCE_START, TIME, component
from recordings.rrd.stored_frames import entity_path

if TYPE_CHECKING:
    import pyarrow as pa

#: The entity that they lie below.
ROWS: Final = "rows"
#: Frames of a row a load, a manoeuvre, a cycle, a finding.
TIMED: Final = ("loads", "segments", "cycles", "findings")


def timed_rows(frames: Mapping[str, pl.DataFrame], t0_unix_ns: int) -> "Iterator[pa.RecordBatch]":
    """Make a record batch of each frame that has rows; a row of the whole run is at its start.

    Args:
        frames: of a run.
        t0_unix_ns: where their times begin.
    """
    import pyarrow as pa

    for name in TIMED:
        frame, time = frames.get(name, pl.DataFrame()), FRAMES[name].time_column
        if frame.is_empty() or time is None:
            continue
        since_start = frame[time].fill_null(0)
        arrays: dict[str, pa.Array] = {
            TIME: (since_start + t0_unix_ns).to_arrow().cast(pa.timestamp("ns")),
            SINCE_START: since_start.to_arrow().cast(pa.duration("ns")),
        }
        fields = [pa.field(each, array.type) for each, array in arrays.items()]
        for column in frame.get_columns():
            plain = column.cast(pl.String) if isinstance(column.dtype, pl.Enum) else column
            values = plain.to_arrow()
            if not pa.types.is_primitive(values.type):
                values = values.cast(pa.string())
            stored = component(column.name)
            # one value a row, and none where it is missing
            cells = [[] if value is None else [value] for value in values.to_pylist()]
            arrays[stored] = pa.array(cells, pa.list_(values.type))
            metadata = {
                "rerun:entity_path": entity_path(name, ROWS),
                "rerun:component": stored,
            }
            fields.append(pa.field(stored, arrays[stored].type, metadata=metadata))
        yield pa.record_batch(list(arrays.values()), schema=pa.schema(fields))
