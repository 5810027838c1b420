"""A recording says what it holds, to Rerun's own tools as well."""

import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import polars as pl
import pytest
import rerun as rr
from rerun.server import Server

from analysis import InputFile, Run
from analysis.model.schema import conform_frame_to_schema
from recordings import read_recording, write_recording
from recordings.rrd.recording_properties import make_recording_properties
from recordings.rrd.stored_names import make_component_name
from recordings.rrd.viewer import find_viewer_executable
from tests.recordings.conftest import MASS_KG


@pytest.fixture(scope="module")
def told(drives: Callable[..., Run]) -> Run:
    """A run of one load of a machine with a serial number."""
    run = drives()
    machine = {"machine": {"name": "CAT 262C", "id": "MST04711", "timezone": "Asia/Tokyo"}}
    about = run.provenance.model_copy(
        update={
            "machine": machine,
            "versions": {"payscope": "0.1.0", "numpy": "2.4"},
            "inputs": (InputFile(name="shift.bag", sha256="0" * 64, size_bytes=1),),
        }
    )
    return replace(run, provenance=about).with_fingerprint()


@pytest.fixture(scope="module")
def recording(told: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_recording(told, tmp_path_factory.mktemp("told") / "shift.rrd")


def chunks(recording: Path, content: str) -> list[dict[str, Any]]:
    """Rows below an entity, as Rerun reads them."""
    stream = rr.chunk.RrdReader(recording).store().stream().filter(content=content)
    return [row for chunk in stream for row in chunk.to_record_batch().to_pylist()]


def test_the_properties_say_machine_day_answer_and_versions(told: Run) -> None:
    said = make_recording_properties(told)
    load = told.frames["loads"].row(0, named=True)
    assert said["machine"] == "CAT 262C"
    assert said["serial"] == "MST04711"
    assert said["day"] == "2023-11-15"  # in Tokyo
    assert said["logs"] == "shift.bag"
    assert said["loads"] == told.frames["loads"].height == 1
    assert said["mass_kg"] == load["mass_kg"] == pytest.approx(MASS_KG, rel=0.1)
    assert said["mass_U_kg"] == pytest.approx(1.96 * load["u_kg"])
    assert said["can_weigh"] is True
    assert said["verdict"] == "can weigh"
    assert said["fingerprint"] == told.provenance.fingerprint.results  # type: ignore[union-attr]
    assert said["versions"] == "payscope 0.1.0, numpy 2.4"


def test_a_log_that_cannot_weigh_says_why_and_has_no_mass(drives: Callable[..., Run]) -> None:
    run = drives(passed=False)
    failed = run.frames["verdict"].filter((pl.col("about") == "mass") & ~pl.col("passed"))
    said = make_recording_properties(run)
    assert said["can_weigh"] is False
    assert said["verdict"] == f"cannot weigh: {', '.join(failed['check'])}"


def test_a_shift_has_tonnes(drives: Callable[..., Run]) -> None:
    sums = {"cycles_counted": [12], "payload_kg": [14_200.0], "payload_u_kg": [300.0]}
    shift = conform_frame_to_schema("shift", pl.DataFrame(sums))
    said = make_recording_properties(Run({"shift": shift}, drives().provenance))
    assert said["cycles"] == 12
    assert said["tonnes_t"] == pytest.approx(14.2)
    assert said["tonnes_U_t"] == pytest.approx(0.588)


@pytest.mark.heavy
def test_reruns_reader_gives_them_back(told: Run, recording: Path) -> None:
    [row] = chunks(recording, "/__properties/answer")
    del row["rerun.controls.RowId"]
    assert {name: values[0] for name, values in row.items()} == make_recording_properties(told)


def test_reruns_command_prints_them(recording: Path) -> None:
    printed = subprocess.run(
        [
            str(find_viewer_executable()),
            "rrd",
            "print",
            "-vvv",
            "--entity",
            "/__properties/answer",
            recording,
        ],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    for part in ("/__properties/answer", "MST04711", "CAT 262C", "can weigh"):
        assert part in printed


def test_reruns_catalog_has_them_as_columns(told: Run, recording: Path) -> None:
    with Server(host="127.0.0.1", datasets={"runs": [recording]}) as server:
        client = server.client()  # the table is of no use without it
        table = client.get_dataset("runs").segment_table()
        [row] = pl.DataFrame(table.to_arrow_table()).rows(named=True)
    said = {
        name.removeprefix("property:answer:"): values[0]
        for name, values in row.items()
        if name.startswith("property:answer:")
    }
    assert said == make_recording_properties(told)


def test_loads_and_findings_are_rows_in_time(told: Run, recording: Path) -> None:
    for name in ("loads", "segments", "findings"):
        frame = told.frames[name]
        rows = chunks(recording, f"/rows/{name}")
        assert len(rows) == frame.height
        begin = frame["start_t_ns"].fill_null(0) + told.provenance.t0_unix_ns
        assert [row["time"].value for row in rows] == begin.to_list()
        column = next(c for c, dtype in frame.schema.items() if dtype == pl.Float64)
        stored = [row[make_component_name(column)] for row in rows]
        assert stored == [[] if value is None else [value] for value in frame[column]]


def test_what_was_recorded_is_what_was_written(told: Run, recording: Path) -> None:
    assert read_recording(recording) == told
