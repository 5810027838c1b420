"""Names of a fleet's stored results, and the order in which they are written."""

import hashlib
import io
import json
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple
from urllib.parse import quote, unquote

import polars as pl

from analysis.fleet.fleet_tables import RESULTS, TABLES, convert_frame_to_table_rows
from replay.fleet.object_store import ObjectStore

#: Table whose row is written last: a result exists if its row does.
MARK: Final = RESULTS.name
RECORDINGS: Final = "recordings"
#: Hexadecimal digits of a digest that distinguish recordings of a fleet (128 bits).
_DIGITS: Final = 32


class ResultName(NamedTuple):
    """Name of a result, from which its objects are named."""

    machine: str
    day: str
    key: str

    def make_object_name_of_table(self, table_name: str) -> str:
        """Object name of one of its tables."""
        return (
            f"{table_name}/machine={quote(self.machine, safe='')}/day={self.day}/{self.key}.parquet"
        )

    @property
    def recording_object_name(self) -> str:
        """Object name of its recording."""
        machine = quote(self.machine, safe="")
        return f"{RECORDINGS}/machine={machine}/day={self.day}/{self.key}.rrd"


def parse_result_name(stored_object: str) -> ResultName | None:
    """Parse the name of the result that an object belongs to; None for other objects."""
    parts = stored_object.split("/")
    if len(parts) != 4 or not parts[1].startswith("machine=") or not parts[2].startswith("day="):
        return None
    return ResultName(
        unquote(parts[1].removeprefix("machine=")),
        parts[2].removeprefix("day="),
        parts[3].partition(".")[0],
    )


def digest_result_key(setup_digest: str, log_digests: Sequence[str]) -> str:
    """Compute the key of a result: digest of its log's content and all else that it depends on."""
    whole = json.dumps([setup_digest, sorted(log_digests)])
    return hashlib.sha256(whole.encode()).hexdigest()[:_DIGITS]


def write_result_tables(
    store: ObjectStore,
    result_name: ResultName,
    t0_unix_ns: int | None,
    frames: Mapping[str, pl.DataFrame],
    results_row: Mapping[str, object],
) -> None:
    """Write a result; its row of `results` is written last, and makes it exist.

    Args:
        store: store of the results.
        result_name: name of the result.
        t0_unix_ns: Unix time of its first sample.
        frames: tables by name, without `results`.
        results_row: row of the table `results`.
    """
    of = {**result_name._asdict(), "t0_unix_ns": t0_unix_ns}
    for each, frame in frames.items():
        store.write_object(
            result_name.make_object_name_of_table(each),
            encode_compressed_parquet_table(convert_frame_to_table_rows(each, frame, of)),
        )
    columns = {
        c.name: pl.Series([results_row.get(c.name)], dtype=c.dtype) for c in TABLES[MARK].columns
    }
    store.write_object(
        result_name.make_object_name_of_table(MARK),
        encode_compressed_parquet_table(
            convert_frame_to_table_rows(MARK, pl.DataFrame(columns), of)
        ),
    )


def encode_compressed_parquet_table(frame: pl.DataFrame) -> bytes:
    """Encode a table as a Parquet file, compressed by zstd."""
    written = io.BytesIO()
    frame.write_parquet(written, compression="zstd", statistics=True)
    return written.getvalue()
