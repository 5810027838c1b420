"""Read untrusted Parquet in a separate process with limits: Parquet on stdin, JSON on stdout.

It imports no module of payscope, so that it can be started in isolation, and opens no file.
"""

import io
import json
import sys
from typing import Any, Final

#: Bounds of untrusted tables: rows, unpacked bytes, bytes of memory, seconds of processor time.
_MOST_ROWS: Final = 100_000
_MOST_BYTES: Final = 64 << 20
_MOST_MEMORY: Final = 2 << 30
_MOST_CPU_S: Final = 30
_PLAIN: Final = {"PLAIN", "RLE", "BIT_PACKED"}


def main() -> None:
    """Read the tables on stdin, and print their columns or faults as JSON."""
    data = sys.stdin.buffer.read()
    # Arrow works without NumPy, and then starts in half the time
    sys.modules["numpy"] = None  # pyright: ignore[reportArgumentType] - as `import` understands it
    _limit_process_memory_and_time()
    found: list[dict[str, Any]] = []
    for asked in json.loads(sys.argv[1]):
        part, data = data[: asked["bytes"]], data[asked["bytes"] :]
        found.append(
            _read_parquet_table_as_json(part, [tuple(column) for column in asked["columns"]])
        )
    sys.stdout.write(json.dumps(found))


def _read_parquet_table_as_json(
    parquet_bytes: bytes, expected_columns: list[tuple[str, ...]]
) -> dict[str, Any]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        file = pq.ParquetFile(io.BytesIO(parquet_bytes))
        fault = _describe_table_fault(file, expected_columns)
        if fault:
            return {"fault": fault}
        table = file.read(use_threads=False)
        table.validate(full=True)
        return {"columns": table.to_pydict()}
    except (pa.ArrowException, OSError, MemoryError, ValueError, OverflowError) as error:
        why = (str(error) or type(error).__name__).splitlines()[0][:200]
        return {"fault": f"is damaged ({why})"}


def _describe_table_fault(file: Any, expected_columns: list[tuple[str, ...]]) -> str:
    about = file.metadata
    if about.num_rows > _MOST_ROWS:
        return f"has {about.num_rows:,} rows; at most {_MOST_ROWS:,} are allowed"
    if [(field.name, str(field.type)) for field in file.schema_arrow] != expected_columns:
        return "has other columns than such a table"
    for group in range(about.num_row_groups):
        for number in range(about.num_columns):
            chunk = about.row_group(group).column(number)
            coded = chunk.compression != "UNCOMPRESSED" or not _PLAIN.issuperset(chunk.encodings)
            if coded or chunk.total_uncompressed_size > _MOST_BYTES:
                return "is compressed or encoded, which a table of a bundle never is"
    return ""


def _limit_process_memory_and_time() -> None:
    """Limit memory and processor time of this process, if the system supports it."""
    try:
        import resource
    except ImportError:
        return
    resource.setrlimit(resource.RLIMIT_AS, (_MOST_MEMORY, _MOST_MEMORY))
    resource.setrlimit(resource.RLIMIT_CPU, (_MOST_CPU_S, _MOST_CPU_S))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


if __name__ == "__main__":
    main()
