"""Where a fleet's results lie, and how one is written: its tables, then its row of `results`."""

import hashlib
import io
import json
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple
from urllib.parse import quote, unquote

import polars as pl

from analysis.fleet.fleet_tables import RESULTS, TABLES, rows_of_table
from replay.fleet.object_store import Store

#: A result is there when its row of this table is, which is written last.
MARK: Final = RESULTS.name
RECORDINGS: Final = "recordings"
#: Hexadecimal digits of a digest that tell recordings of a fleet apart (128 bits).
_DIGITS: Final = 32


class ResultName(NamedTuple):
    """Where the parts of a result lie."""

    machine: str
    day: str
    key: str

    def table_object_name(self, name: str) -> str:
        """The object of one of its tables."""
        return f"{name}/machine={quote(self.machine, safe='')}/day={self.day}/{self.key}.parquet"

    @property
    def recording(self) -> str:
        """The object of its recording."""
        machine = quote(self.machine, safe="")
        return f"{RECORDINGS}/machine={machine}/day={self.day}/{self.key}.rrd"


def parse_result_name(stored: str) -> ResultName | None:
    """The name of the result that an object is a part of; None for an object of another kind."""
    parts = stored.split("/")
    if len(parts) != 4 or not parts[1].startswith("machine=") or not parts[2].startswith("day="):
        return None
    return ResultName(
        unquote(parts[1].removeprefix("machine=")),
        parts[2].removeprefix("day="),
        parts[3].partition(".")[0],
    )


def result_key(basis: str, digests: Sequence[str]) -> str:
    """The key of a result: its log by content, and all else that it depends on."""
    whole = json.dumps([basis, sorted(digests)])
    return hashlib.sha256(whole.encode()).hexdigest()[:_DIGITS]


def write_result(
    store: Store,
    name: ResultName,
    t0_unix_ns: int | None,
    frames: Mapping[str, pl.DataFrame],
    row: Mapping[str, object],
) -> None:
    """Write a result; one that breaks off was never there.

    Args:
        store: of the results.
        name: of this one.
        t0_unix_ns: of its first sample.
        frames: by table, but for `results`.
        row: of `results`.
    """
    of = {**name._asdict(), "t0_unix_ns": t0_unix_ns}
    for each, frame in frames.items():
        store.write(name.table_object_name(each), parquet_bytes(rows_of_table(each, frame, of)))
    columns = {c.name: pl.Series([row.get(c.name)], dtype=c.dtype) for c in TABLES[MARK].columns}
    store.write(
        name.table_object_name(MARK), parquet_bytes(rows_of_table(MARK, pl.DataFrame(columns), of))
    )


def parquet_bytes(frame: pl.DataFrame) -> bytes:
    """A table as Parquet."""
    written = io.BytesIO()
    frame.write_parquet(written, compression="zstd", statistics=True)
    return written.getvalue()
