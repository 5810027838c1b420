"""Tables of a bundle as Parquet, and safe reading of untrusted ones.

A few bytes of Parquet can unpack to gigabytes, and some damaged files crash Arrow's reader. So
tables of bundles are neither compressed nor encoded, and a separate process with limits reads them.
"""

import io
import json
import math
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import polars as pl

from recordings.calibration.bundle_limits import LIMITS

if TYPE_CHECKING:
    import pyarrow as pa

_READER: Final = Path(__file__).with_name("parquet_process.py")
#: Arrow's name of the type that `encode_table_as_parquet` gives a column; Arrow itself is imported
#: by the reader's process alone.
_ARROW: Final[Mapping[type[pl.DataType], str]] = {
    pl.String: "string",
    pl.Float64: "double",
    pl.Int64: "int64",
    pl.Boolean: "bool",
}

Schema = Mapping[str, type[pl.DataType]]


def encode_table_as_parquet(frame: pl.DataFrame) -> bytes:
    """Frame as Parquet, without compression and dictionaries."""
    import pyarrow.parquet as pq

    buffer = io.BytesIO()
    pq.write_table(
        _convert_to_plain_arrow(frame),
        buffer,
        compression="none",
        use_dictionary=False,
        write_statistics=False,
        store_schema=False,
    )
    return buffer.getvalue()


@dataclass(frozen=True, slots=True)
class UntrustedTable:
    """A table from an untrusted source.

    Attributes:
        data: content.
        schema: required columns in order.
    """

    data: bytes
    schema: Schema


def read_untrusted_tables(tables: Sequence[UntrustedTable]) -> list[pl.DataFrame | str]:
    """Read untrusted tables in the format of `encode_table_as_parquet`.

    Returns:
        The frame of each, or its fault: other columns, compressed or coded, too many rows, a number
        that is not finite, or damaged.
    """
    said = read_tables_in_child_process(tables)
    if said is None and len(tables) > 1:  # one of them ended the reader: which?
        return [each for table in tables for each in read_untrusted_tables([table])]
    if said is None:
        return ["is so damaged that it crashes the reader"]
    return [
        _make_frame_or_describe_fault(each, table.schema)
        for each, table in zip(said, tables, strict=True)
    ]


def read_tables_in_child_process(tables: Sequence[UntrustedTable]) -> list[dict[str, Any]] | None:
    """Results of the reader process for each table; None if it crashed."""
    asked = json.dumps(
        [
            {
                "bytes": len(table.data),
                "columns": [[name, _ARROW[dtype]] for name, dtype in table.schema.items()],
            }
            for table in tables
        ]
    )
    data = b"".join(table.data for table in tables)
    ask = _ask_once if len(data) <= LIMITS.kept_tables_bytes else run_table_reader_process
    out = ask(asked, data)
    return None if out is None else json.loads(out)


def run_table_reader_process(request_json: str, tables_bytes: bytes) -> bytes | None:
    """Run the reader's process; its JSON output, or None if it crashed."""
    # the process writes JSON, and is told nothing but what columns to expect
    child = subprocess.Popen(
        [sys.executable, "-I", str(_READER), request_json],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    try:
        out, _ = child.communicate(tables_bytes, timeout=LIMITS.tables_max_s)
    except subprocess.TimeoutExpired:
        child.kill()
        child.communicate()
        return None
    return None if child.returncode or len(out) > LIMITS.tables_output_bytes else out


#: The same bytes hold the same, and the reader takes a quarter of a second to start.
_ask_once: Final = lru_cache(maxsize=16)(run_table_reader_process)


def _make_frame_or_describe_fault(
    reader_output: dict[str, Any], schema: Schema
) -> pl.DataFrame | str:
    """Frame of an untrusted table, or the fault that makes it unusable."""
    if "fault" in reader_output:
        return str(reader_output["fault"])
    columns: dict[str, list[Any]] = reader_output["columns"]
    for values in columns.values():
        if any(isinstance(v, float) and not math.isfinite(v) for v in values):
            return "holds a number that is not finite"
    return pl.DataFrame(columns, schema=dict(schema))


def _convert_to_plain_arrow(frame: pl.DataFrame) -> "pa.Table":
    """Frame as Arrow with plain types."""
    import pyarrow as pa

    table = frame.to_arrow()
    texts = (pa.types.is_large_string, pa.types.is_string_view)
    fields = [
        pa.field(f.name, pa.string() if any(is_text(f.type) for is_text in texts) else f.type)
        for f in table.schema
    ]
    return table.cast(pa.schema(fields))
