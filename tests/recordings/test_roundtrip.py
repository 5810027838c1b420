"""`read_recording` gives back exactly what `write_recording` was given."""

import re
import struct
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import polars as pl
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from analysis import Loss, Provenance, Run
from analysis.model.schema import PHASE
from estimators.errors import OutputError, RecordingError
from recordings import (
    list_columns_by_frame,
    read_frame,
    read_provenance,
    read_recording,
    write_recording,
)
from recordings.rrd.recording_limits import LIMITS
from recordings.rrd.stored_frames import StoredFrame
from recordings.rrd.viewer import find_viewer_executable
from tests.one_line import assert_one_line

if TYPE_CHECKING:
    import pyarrow as pa

BITS = st.integers(0, 2**64 - 1).map(lambda bits: struct.unpack("<d", struct.pack("<Q", bits))[0])
FLOATS = st.floats(allow_nan=False, allow_infinity=False, allow_subnormal=True)
INT64 = st.integers(-(2**63), 2**63 - 1)
TEXT = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=8)
NAMES = st.text("abcXYZ_./[]: é", min_size=1, max_size=8)
DTYPES = {
    "raw": [
        (pl.Float64, BITS | st.sampled_from([-0.0, 5e-324, float("inf"), float("nan")])),
        (pl.Int64, INT64),
        (pl.Boolean, st.booleans()),
        (pl.String, TEXT),
    ],
    "stage": [
        (pl.Float64, FLOATS | st.sampled_from([-0.0, 5e-324, -5e-324, 1.8e308])),
        (pl.Int64, INT64),
        (pl.Boolean, st.booleans()),
        (pl.String, TEXT),
        (PHASE, st.sampled_from(PHASE.categories.to_list())),
    ],
}


@st.composite
def frames(draw: st.DrawFn, kind: str) -> pl.DataFrame:
    """A frame of a few columns of any dtype, with nulls, perhaps of nothing else, or empty."""
    rows = draw(st.integers(0, 5))
    series: list[pl.Series] = []
    for name in draw(st.lists(NAMES, min_size=1, max_size=4, unique=True)):
        dtype, values = draw(st.sampled_from(DTYPES[kind]))
        cells = draw(st.lists(st.none() | values, min_size=rows, max_size=rows))
        series.append(pl.Series(name, cells, dtype=dtype, strict=True))
    times = st.lists(st.integers(0, 2**50), min_size=rows, max_size=rows).map(sorted)
    time = {"raw": "log_time_ns", "stage": "t_ns"}[kind]
    if draw(st.booleans()):
        series.insert(0, pl.Series(time, draw(times), dtype=pl.Int64))
    return pl.DataFrame(series)


@st.composite
def runs(draw: st.DrawFn) -> Run:
    """A run with frames that the table knows by name only."""
    made: dict[str, pl.DataFrame] = {}
    for topic in draw(st.lists(NAMES, max_size=2, unique=True)):
        made[f"raw/{topic}"] = draw(frames("raw"))
    for name in draw(st.permutations(["alpha", "beta/ls"]))[: draw(st.integers(0, 2))]:
        made[name] = draw(frames("stage"))
    json = st.recursive(
        st.none() | st.booleans() | st.integers(-9, 9) | FLOATS | TEXT,
        lambda inner: st.lists(inner, max_size=2) | st.dictionaries(TEXT, inner, max_size=2),
        max_leaves=4,
    )
    about = Provenance(
        machine=draw(st.dictionaries(st.sampled_from("abc"), json)),
        t0_unix_ns=draw(st.integers(0, 2**60)),
        losses=(Loss(source="log.bag", what=draw(TEXT)),),
        notes=(draw(TEXT),),
    )
    return Run(made, about)


def bits(run: Run) -> list[object]:
    """Every cell, floats as their bits: −0.0 is not 0.0, and NaN is NaN."""
    return [
        [None if v is None else struct.pack("<d", v) if isinstance(v, float) else v for v in s]
        for frame in run.frames.values()
        for s in frame.get_columns()
    ]


# each writes a recording, which takes a twentieth of a second and more
@pytest.mark.heavy
@settings(max_examples=30, deadline=None, suppress_health_check=list(HealthCheck))
@given(run=runs())
def test_whatever_was_written_is_read_back_bit_for_bit_in_the_same_order(run: Run, tmp_path: Path):
    path = write_recording(run, tmp_path / "any.rrd", overwrites=True)
    back = read_recording(path)
    assert back == run
    assert bits(back) == bits(run)
    assert list_columns_by_frame(path) == {
        name: tuple(frame.columns) for name, frame in run.frames.items()
    }


@pytest.mark.heavy
def test_a_run_with_every_frame_comes_back_equal_and_the_recorder_verifies_the_file(
    drives, tmp_path: Path
):
    run = drives(60.0)
    path = write_recording(run, tmp_path / "shift.rrd")
    assert read_recording(path) == run
    assert read_provenance(path) == run.provenance
    subprocess.run(
        [find_viewer_executable(), "rrd", "verify", path], check=True, capture_output=True
    )


def test_rows_of_many_blocks_keep_their_order_also_after_the_recorder_rearranged_them(
    tmp_path: Path,
):
    n = 3 * LIMITS.stored_block_rows + 7
    frame = pl.DataFrame(
        {"t_ns": pl.int_range(n, eager=True), "value": pl.int_range(n, 0, -1, eager=True)}
    )
    same_time = pl.DataFrame({"log_time_ns": [7] * n, "x": pl.int_range(n, eager=True)})
    run = Run({"raw//imu": same_time, "stage": frame})
    path = write_recording(run, tmp_path / "long.rrd")
    assert read_recording(path) == run
    tidied = tmp_path / "tidied.rrd"
    command = [find_viewer_executable(), "rrd", "optimize", path, "-o", tidied]
    subprocess.run(command, check=True, capture_output=True)
    assert read_recording(tidied) == run


@pytest.mark.heavy
def test_what_the_recorder_put_apart_is_put_together_again(drives, tmp_path: Path):
    # it keeps thin columns, as those of booleans, in other chunks than thick ones
    run = drives(60.0)
    path, tidied = write_recording(run, tmp_path / "shift.rrd"), tmp_path / "tidied.rrd"
    command = [find_viewer_executable(), "rrd", "optimize", path, "-o", tidied]
    subprocess.run(command, check=True, capture_output=True)
    assert read_recording(tidied) == run


def test_a_block_that_lost_a_column_is_no_row():
    import pyarrow as pa

    frame = pl.DataFrame({"a": pl.int_range(LIMITS.stored_block_rows + 5, eager=True), "b": "b"})
    stored = StoredFrame.from_frame("stage", frame)
    first, second = stored.iter_blocks_of_frame(frame)
    torn = pa.record_batch({name: second.column(name) for name in ("row", "payscope:a")})
    assert stored.rebuild_frame_from_blocks([torn, first], stored.columns).equals(
        frame.head(LIMITS.stored_block_rows)
    )


def _drawn(run: Run, path: Path, frame: str) -> "pa.RecordBatch":
    import rerun as rr

    write_recording(run, path)
    store = rr.chunk.RrdReader(path).store()
    (chunk,) = store.stream().filter(content=f"/display/{frame}")
    return chunk.to_record_batch()


def test_missing_numbers_are_drawn_as_nan_so_that_no_line_crosses_them(tmp_path: Path):
    frame = pl.DataFrame({"t_ns": [0, 1, 2], "force_x_N": [1.0, None, 3.0]})
    batch = _drawn(Run({"excitation": frame}), tmp_path / "gap.rrd", "excitation")
    drawn = batch.column("payscope:force_x_N").flatten()
    assert drawn.null_count == 0
    assert str(drawn[1]) == "nan"


def test_times_lie_on_the_utc_timeline_and_on_the_one_since_the_start(tmp_path: Path):
    frame = pl.DataFrame({"t_ns": [0, 5], "force_x_N": [1.0, 2.0]})
    run = Run({"excitation": frame}, Provenance(t0_unix_ns=10**18))
    batch = _drawn(run, tmp_path / "time.rrd", "excitation")
    assert batch.column("time").cast("int64").to_pylist() == [10**18, 10**18 + 5]
    assert batch.column("t").cast("int64").to_pylist() == [0, 5]


@pytest.mark.heavy
def test_one_frame_or_some_of_its_columns_are_read_alone_in_the_order_asked_for(
    drives, tmp_path: Path
):
    run = drives(30.0)
    path = write_recording(run, tmp_path / "shift.rrd")
    gate = run.frames["gate"]
    assert read_frame(path, "gate").equals(gate)
    some = read_frame(path, "gate", ["mi_x_nat", "t_ns"])
    assert some.equals(gate.select("mi_x_nat", "t_ns"))


@pytest.mark.heavy
def test_an_unknown_stage_or_column_is_answered_with_the_nearest_one(drives, tmp_path: Path):
    path = write_recording(drives(30.0), tmp_path / "shift.rrd")
    with pytest.raises(RecordingError, match=r"no frame 'gat'; did you mean 'gate'\?"):
        read_frame(path, "gat")
    with pytest.raises(RecordingError, match=r"'gate' has no 'mi'; .*mi_x_nat"):
        read_frame(path, "gate", ["mi"])


def test_an_existing_recording_is_replaced_only_when_forced(tmp_path: Path):
    path = write_recording(Run({"old": pl.DataFrame({"a": [1]})}), tmp_path / "shift.rrd")
    new = Run({"new": pl.DataFrame({"a": [2]})})
    with pytest.raises(OutputError, match=r"exists already.*--force"):
        write_recording(new, path)
    assert list(list_columns_by_frame(path)) == ["old"]
    write_recording(new, path, overwrites=True)
    assert read_recording(path) == new
    assert [each.name for each in tmp_path.iterdir()] == ["shift.rrd"]


def test_a_missing_folder_is_named_and_nothing_is_written(tmp_path: Path):
    with pytest.raises(OutputError, match=r"no folder '.*nowhere'; create it first"):
        write_recording(Run({}), tmp_path / "nowhere" / "shift.rrd")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_refuses_files_is_one_line():
    with pytest.raises(OutputError, match=r"^/proc/shift\.rrd: cannot write in '/proc' \(.*\);"):
        write_recording(Run({}), "/proc/shift.rrd")


def test_a_dtype_that_cannot_be_stored_leaves_no_half_file(tmp_path: Path):
    run = Run({"stage": pl.DataFrame({"path": [[1, 2]]})})
    with pytest.raises(OutputError, match=r"column 'path': a List\(Int64\) cannot be stored; "):
        write_recording(run, tmp_path / "shift.rrd")
    assert list(tmp_path.iterdir()) == []


def test_a_column_without_a_name_is_refused_in_one_line(tmp_path: Path):
    with pytest.raises(OutputError, match="column of the log has an empty name"):
        write_recording(Run({"raw/table": pl.DataFrame({"": [1.0]})}), tmp_path / "shift.rrd")


def test_provenance_that_json_cannot_hold_is_refused_rather_than_changed(tmp_path: Path):
    run = Run({}, Provenance(machine={"position_m": (1.0, 2.0)}))
    with pytest.raises(OutputError, match="plain JSON"):
        write_recording(run, tmp_path / "shift.rrd")
    assert list(tmp_path.iterdir()) == []


def _broken(tmp_path: Path, content: bytes) -> str:
    path = tmp_path / "bad.rrd"
    path.write_bytes(content)
    with pytest.raises(RecordingError) as caught:
        read_recording(path)
    assert_one_line(caught.value)
    assert str(path) in str(caught.value)
    return str(caught.value)


def test_what_is_no_recording_is_said_in_one_line(tmp_path: Path):
    assert "not a Rerun recording" in _broken(tmp_path, b"time_s,force_N\n0,1\n")
    assert "not a Rerun recording" in _broken(tmp_path, b"")
    with pytest.raises(RecordingError, match="no such recording"):
        read_recording(tmp_path / "missing.rrd")
    with pytest.raises(RecordingError, match="a folder"):
        read_recording(tmp_path)


def test_a_recording_of_another_program_is_said_in_one_line(tmp_path: Path):
    import rerun as rr

    path = tmp_path / "other.rrd"
    with rr.RecordingStream("other") as other:
        other.save(path)
        other.log("x", rr.TextLog("x"))
    other.disconnect()
    with pytest.raises(RecordingError, match="not one that payscope wrote"):
        read_recording(path)


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (lambda data: data + bytes(2), "its end is missing, or something was appended"),
        (lambda data: data[:-50], "its end is missing"),
        (lambda data: data[:10], "its end is missing"),
        (lambda data: data[:-200] + bytes(9) + data[-191:], "a checksum does not match"),
    ],
)
def test_what_is_wrong_with_a_recording_is_said_without_reruns_words(
    change: Callable[[bytes], bytes], fault: str, tmp_path: Path
) -> None:
    run = Run({"stage": pl.DataFrame({"t_ns": pl.int_range(9, eager=True)})})
    path = write_recording(run, tmp_path / "shift.rrd")
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(RecordingError) as error:
        read_recording(path)
    assert fault in str(error.value)
    assert not re.search("RrdReader|footer|decode frame|Arrow", str(error.value))


def test_a_truncated_recording_names_the_remedy_and_the_remedy_saves_its_complete_rows(
    tmp_path: Path,
):
    rows_written = 3 * LIMITS.stored_block_rows
    run = Run({"stage": pl.DataFrame({"t_ns": pl.int_range(rows_written, eager=True)})})
    path = write_recording(run, tmp_path / "shift.rrd")
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    with pytest.raises(RecordingError, match=r"damaged or not finished.*`rerun rrd optimize"):
        read_recording(path)
    saved = tmp_path / "recovered.rrd"
    command = [find_viewer_executable(), "rrd", "optimize", path, "-o", saved]
    subprocess.run(command, check=True, capture_output=True)
    back = read_recording(saved)
    rows = back.frames["stage"].height
    assert 0 < rows < rows_written
    assert back.frames["stage"].equals(run.frames["stage"].head(rows))
    assert back.provenance.losses[-1].what == f"the recording has {rows} of {rows_written} rows"
