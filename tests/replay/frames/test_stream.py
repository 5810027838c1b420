"""A topic as a stream of Arrow, for whatever takes one."""

import subprocess
import sys
from pathlib import Path

import datafusion
import duckdb
import pandas as pd
import polars as pl
import pyarrow as pa
import pytest

import payscope
from estimators.errors import LogError
from tests.replay.frames.test_scan import START_NS, STEP_NS, joints, time
from tests.replay.logs.written_logs import write_mcap

REPO = Path(__file__).resolve().parents[3]


@pytest.fixture
def log(tmp_path: Path) -> Path:
    write_mcap(tmp_path / "shift.mcap", joints(300))
    return tmp_path / "shift.mcap"


def test_pyarrow_reads_what_polars_collects(log: Path) -> None:
    table = pa.table(payscope.stream_log(log, "/joints"))
    assert pl.DataFrame(table).equals(payscope.scan_log(log, "/joints").collect())


def test_pandas_reads_it(log: Path) -> None:
    stream = payscope.stream_log(log, "/joints", columns=["log_time", "effort[0]"],
                                 fields=["effort[0]"])  # fmt: skip
    found = pd.DataFrame.from_arrow(stream)
    assert found["effort[0]"].sum() == sum(range(300))
    assert found["log_time"].iloc[0] == pd.Timestamp(START_NS, tz="UTC")


def test_datafusion_queries_it(log: Path) -> None:
    context = datafusion.SessionContext()
    stream = payscope.stream_log(log, "/joints", fields=["effort[left]"])
    context.from_arrow(stream, name="joints")
    found = context.sql(
        'SELECT count(*) AS n, max("effort[left]") AS most, min(log_time) AS first FROM joints'
    )
    assert pl.DataFrame(found.to_arrow_table()).rows() == [(300, 299.0, time(0))]


def test_duckdb_queries_it_as_often_as_it_likes(log: Path) -> None:
    stream = payscope.stream_log(log, "/joints", fields=["effort[left]"])
    table = duckdb.connect().from_arrow(stream)
    assert table.aggregate('count(*), max("effort[left]")').fetchall() == [(300, 299.0)]
    assert pa.table(stream).num_rows == 300


def test_a_filter_on_the_time_bounds_the_stream(log: Path) -> None:
    within = pl.col("log_time").is_between(time(10), time(19), closed="both")
    stream = payscope.stream_log(log, "/joints", columns=["name[]"], where=within)
    assert stream.schema == {"name[]": pl.List(pl.String())}
    read = payscope.open_log(log).read("/joints", [], *(START_NS + k * STEP_NS for k in (10, 19)))
    assert sum(frame.height for frame in stream) == read.height


def test_a_column_that_is_not_there_is_named(log: Path) -> None:
    with pytest.raises(LogError, match="did you mean 'log_time'"):
        payscope.stream_log(log, "/joints", columns=["log_tim"])


@pytest.mark.heavy
def test_scanning_imports_nothing_of_recordings(log: Path) -> None:
    code = (
        f"import sys, payscope; payscope.scan_log({str(log)!r}, '/joints').collect()\n"
        # numba takes BLAS from scipy.linalg where compiled code is loaded
        "heavy = ('rerun', 'matplotlib', 'pandas', 'typer', 'pydantic', 'recordings')\n"
        "heavy += tuple(f'scipy.{part}' for part in ('signal', 'special', 'stats', 'optimize'))\n"
        "print([name for name in heavy if name in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=REPO
    )
    assert done.stdout.strip() == "[]"
