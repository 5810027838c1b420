"""The ledger of a shift: frame `cycles` with times that people read, and what reviewers say."""

import datetime as dt
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import polars as pl

from analysis.stages.signals.timestamps import FIRST_DATE_NS
from recordings.review.reviewer_verdicts import CycleVerdict

PARQUET: Final = "ledger.parquet"
CSV: Final = "ledger.csv"
_NS: Final = 10**9


def identities(cycles: pl.DataFrame, t0_unix_ns: int) -> pl.Series:
    """An id a cycle: when it ends, in UTC, or by the log's own clock where that has no date."""
    return pl.Series(
        "id", [_identity(t0_unix_ns + t_ns) for t_ns in cycles["end_t_ns"]], dtype=pl.String
    )


def ledger(
    cycles: pl.DataFrame, t0_unix_ns: int, verdicts: Mapping[int, CycleVerdict]
) -> pl.DataFrame:
    """The ledger, a row a cycle.

    Args:
        cycles: the frame.
        t0_unix_ns: where its times begin.
        verdicts: by row.
    """
    rows = [verdicts.get(row) for row in range(cycles.height)]

    def said(name: str) -> list[str]:
        return ["" if each is None else str(getattr(each, name)) for each in rows]

    rejected = pl.Series(
        "rejected", [each is not None and each.reject for each in rows], dtype=pl.Boolean
    )
    times = [
        (pl.col(f"{name}_t_ns") + t0_unix_ns).alias(f"{name}_unix_ns")
        for name in ("start", "end", "dig", "dump")
    ]
    when = ["" if each is None else _iso(each.time) for each in rows]
    return cycles.select(
        "cycle",
        identities(cycles, t0_unix_ns),
        *times,
        (pl.col("start_t_ns") / _NS).alias("at_s"),
        pl.exclude("cycle", "start_t_ns", "end_t_ns", "dig_t_ns", "dump_t_ns", "counted"),
        (pl.col("counted") & ~rejected).alias("counted"),
        rejected,
        pl.Series("product", said("product"), dtype=pl.String),
        pl.Series("note", said("note"), dtype=pl.String),
        pl.Series("author", said("author"), dtype=pl.String),
        pl.Series("said", when, dtype=pl.String),
    )


def write_ledger(frame: pl.DataFrame, folder: Path) -> None:
    """Write both files.

    A spreadsheet would compute a text that begins like a formula: such a one gets an apostrophe.
    """
    frame.write_parquet(folder / PARQUET, compression="zstd")
    texts = [name for name, kind in frame.schema.items() if kind == pl.String]
    safe = [
        pl.when(pl.col(name).str.contains(r"^[=+\-@\t\r]"))
        .then(pl.lit("'") + pl.col(name))
        .otherwise(pl.col(name))
        .alias(name)
        for name in texts
    ]
    frame.with_columns(safe).write_csv(folder / CSV, float_precision=3)


def _identity(unix_ns: int) -> str:
    if unix_ns < FIRST_DATE_NS:
        return f"{unix_ns / _NS:.0f}s"
    return _iso(dt.datetime.fromtimestamp(unix_ns // _NS, dt.UTC))


def _iso(time: dt.datetime) -> str:
    return f"{time.astimezone(dt.UTC):%Y-%m-%dT%H:%M:%SZ}"
