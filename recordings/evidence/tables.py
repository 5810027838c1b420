"""The tables of a bundle as Parquet, and the careful reading of a stranger's.

A few bytes of Parquet can ask for gigabytes, and Arrow's reader ends the whole process on some
damaged files. So ours are neither compressed nor coded, and another process with bounds reads them.
"""

import io
import json
import math
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import polars as pl

from estimators.errors import EvidenceError

if TYPE_CHECKING:
    import pyarrow as pa

_READER: Final = Path(__file__).with_name("parquet_process.py")
_PATIENCE_S: Final = 60.0
_MOST_OUTPUT: Final = 256 << 20

Schema = Mapping[str, type[pl.DataType]]


def write_table(frame: pl.DataFrame) -> bytes:
    """A frame as Parquet: not compressed, no dictionaries."""
    import pyarrow.parquet as pq

    buffer = io.BytesIO()
    pq.write_table(
        _plain(frame),
        buffer,
        compression="none",
        use_dictionary=False,
        write_statistics=False,
        store_schema=False,
    )
    return buffer.getvalue()


def read_table(data: bytes, what: str, schema: Schema) -> pl.DataFrame:
    """Read what `write_table` wrote, of a stranger.

    Args:
        data: the bytes.
        what: what they are, for the error.
        schema: the columns that it must have, in order.

    Raises:
        EvidenceError: other columns, compressed or coded, too many rows, a number that is not
            finite, or damaged.
    """
    wanted = [[f.name, str(f.type)] for f in _plain(pl.DataFrame(schema=schema)).schema]
    # the process sees no environment, takes nothing from here, and writes JSON
    child = subprocess.Popen(
        [sys.executable, "-I", str(_READER), json.dumps(wanted)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    try:
        out, _ = child.communicate(data, timeout=_PATIENCE_S)
    except subprocess.TimeoutExpired:
        child.kill()
        child.communicate()
        raise EvidenceError(f"{what}: cannot be read within {_PATIENCE_S:.0f} s") from None
    if child.returncode or len(out) > _MOST_OUTPUT:
        raise EvidenceError(f"{what}: is damaged so that no reader survives it")
    said = json.loads(out)
    if "fault" in said:
        raise EvidenceError(f"{what}: {said['fault']}")
    columns: dict[str, list[Any]] = said["columns"]
    for values in columns.values():
        if any(isinstance(v, float) and not math.isfinite(v) for v in values):
            raise EvidenceError(f"{what}: holds a number that is not finite")
    return pl.DataFrame(columns, schema=dict(schema))


def _plain(frame: pl.DataFrame) -> "pa.Table":
    """The frame as Arrow of plain types."""
    import pyarrow as pa

    table = frame.to_arrow()
    texts = (pa.types.is_large_string, pa.types.is_string_view)
    fields = [
        pa.field(f.name, pa.string() if any(is_text(f.type) for is_text in texts) else f.type)
        for f in table.schema
    ]
    return table.cast(pa.schema(fields))
