"""`rerun-importer-payscope`: the Rerun viewer opens logs through it."""

import os
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import pytest

from recordings.rrd.viewer import take_screenshots_of_recording_or_log
from tests.viewer_needed import VIEWER

REPO = Path(__file__).resolve().parents[3]
NOT_MINE = 66
IDS = ("--application-id", "app", "--recording-id", "rec")


def imported(path: Path, *more: str, **environment: str) -> "subprocess.CompletedProcess[bytes]":
    """Start the importer as the viewer does."""
    command = [sys.executable, "-P", "-c", "import payscope; payscope.importer()", str(path)]
    return subprocess.run(
        [*command, *IDS, *more],
        capture_output=True,
        check=False,
        env={**os.environ, "PYTHONPATH": str(REPO), **environment},
        timeout=120,
    )


def entities(stream: bytes, tmp_path: Path) -> dict[str, set[str]]:
    """The components of each entity of a stream."""
    import rerun as rr

    path = tmp_path / "stream.rrd"
    path.write_bytes(stream)
    return {
        chunk.entity_path: {field.name for field in chunk.to_record_batch().schema}
        for chunk in rr.chunk.RrdReader(path).store().stream()
    }


def said(tmp_path: Path) -> str:
    """The text of the stream that `entities` has looked at."""
    import rerun as rr

    store = rr.chunk.RrdReader(tmp_path / "stream.rrd").store()
    return "".join(
        str(chunk.to_record_batch().column("TextDocument:text").to_pylist())
        for chunk in store.stream()
        if "TextDocument:text" in chunk.to_record_batch().schema.names
    )


@pytest.fixture
def bag(own_data: Path, tmp_path: Path) -> Path:
    """A ROS 1 bag in a folder of its own."""
    path = tmp_path / "axis.bag"
    path.write_bytes((own_data / "logs/linear_axis.bag").read_bytes())
    return path


@pytest.fixture
def script(tmp_path: Path) -> Path:
    """The importer as an executable, in a folder of its own."""
    path = tmp_path / "bin" / "rerun-importer-payscope"
    path.parent.mkdir()
    path.write_text(
        f'#!/bin/sh\nPYTHONPATH="{REPO}" exec "{sys.executable}" -P -c '
        '"import payscope; payscope.importer()" "$@"\n'
    )
    path.chmod(0o755)
    return path


def test_the_installed_command_has_the_name_that_the_viewer_looks_for() -> None:
    scripts = tomllib.loads((REPO / "pyproject.toml").read_text())["project"]["scripts"]
    assert scripts["rerun-importer-payscope"] == "payscope:importer"


@pytest.mark.parametrize("name", ["cat.png", "notes.md", "other.rrd", "scan.mcap", "gone.bag"])
def test_a_file_of_somebody_else_is_answered_at_once_with_the_documented_status(
    tmp_path: Path, name: str
) -> None:
    if name != "gone.bag":
        (tmp_path / name).write_bytes(b"whatever")
    began = time.monotonic()
    left = imported(tmp_path / name)
    assert (left.returncode, left.stdout, left.stderr) == (NOT_MINE, b"", b"")
    assert time.monotonic() - began < 5.0


@pytest.mark.heavy
def test_a_log_without_a_machine_file_shows_its_columns_with_joints_by_name(
    bag: Path, tmp_path: Path
) -> None:
    """Whatever else newer viewers ask for."""
    left = imported(bag, "--opened-recording-id", "other", "--static", "--unheard-of=1")
    assert (left.returncode, left.stderr) == (0, b"")
    shown = entities(left.stdout, tmp_path)
    assert {"payscope:position[slide]", "payscope:effort[slide]"} <= shown["/axis"]
    assert "payscope init axis.bag -o axis.toml" in said(tmp_path)


@pytest.mark.heavy
def test_a_machine_file_beside_the_log_replays_it(bag: Path, tmp_path: Path) -> None:
    machine = (REPO / "examples/linear_axis_ros.toml").read_text()
    bag.with_suffix(".toml").write_text(machine)
    left = imported(bag)
    assert (left.returncode, left.stderr) == (0, b"")
    assert "payscope:mass_kg" in entities(left.stdout, tmp_path)["/display/loads"]


@pytest.mark.heavy
def test_where_the_machine_file_does_not_fit_the_columns_are_shown_and_why(
    bag: Path, tmp_path: Path
) -> None:
    bag.with_suffix(".toml").write_text("[channels.force_x_N]\ntopic = '/nowhere'\nfield = 'x'\n")
    left = imported(bag)
    assert left.returncode == 0
    assert left.stderr.decode().count("\n") == 1
    assert "shown without a replay" in left.stderr.decode()
    assert "/axis" in entities(left.stdout, tmp_path)
    assert "does not fit" in said(tmp_path)


def times(tmp_path: Path, entity: str) -> dict[str, tuple[str, set[object]]]:
    """Type and values of the timelines of an entity of the stream that `entities` has looked at."""
    import rerun as rr

    store = rr.chunk.RrdReader(tmp_path / "stream.rrd").store()
    batches = [chunk.to_record_batch() for chunk in store.stream() if chunk.entity_path == entity]
    return {
        field.name: (str(field.type), set(batches[0].column(field.name).cast("int64").to_pylist()))
        for field in batches[0].schema
        if (field.metadata or {}).get(b"rerun:kind") == b"index"
    }


ASKED = (
    *("--entity-path-prefix", "/robots/one\\ two"),
    *("--time_sequence", "lap=7", "--time_duration_nanos", "up=1500000000"),
    *("--time_timestamp_nanos", "day=1700000000000000000", "--time_sequence", "nonsense"),
    *("--time_duration_nanos", "log_time=5", "--time", "up=1500000000", "--sequence", "lap=7"),
)


@pytest.mark.heavy
def test_a_prefix_is_of_everything_and_a_time_of_every_row(bag: Path, tmp_path: Path) -> None:
    left = imported(bag, *ASKED)
    assert (left.returncode, left.stderr) == (0, b"")
    shown = entities(left.stdout, tmp_path)
    drawn = {entity for entity in shown if not entity.startswith("/__")}
    assert "/robots/one\\ two/axis" in drawn
    assert all(entity.startswith("/robots/one\\ two/") for entity in drawn)
    found = times(tmp_path, "/robots/one\\ two/axis")
    assert found["lap"] == ("int64", {7})
    assert found["up"] == ("duration[ns]", {1_500_000_000})
    assert found["day"] == ("timestamp[ns]", {1_700_000_000_000_000_000})
    assert {"time", "t"} <= set(found)
    assert "log_time" not in found


@pytest.mark.heavy
def test_the_replay_with_a_machine_file_that_a_variable_names_lies_under_a_prefix_too(
    bag: Path, tmp_path: Path
) -> None:
    machine = str(REPO / "examples/linear_axis_ros.toml")
    left = imported(bag, "--entity-path-prefix", "yard", PAYSCOPE_MACHINE=machine)
    shown = entities(left.stdout, tmp_path)
    assert "payscope:mass_kg" in shown["/yard/display/loads"]
    assert "/display/loads" not in shown


@pytest.mark.heavy
def test_the_sdk_opens_a_log_under_a_prefix_at_its_own_times(
    script: Path, bag: Path, tmp_path: Path
) -> None:
    out = tmp_path / "stream.rrd"
    opens = (
        "import rerun, sys\n"
        "recording = rerun.RecordingStream('mine', recording_id='rec')\n"
        "recording.save(sys.argv[2])\n"
        "recording.set_time('lap', sequence=7)\n"
        "recording.log_file_from_path(sys.argv[1], entity_path_prefix='/yard')\n"
        "recording.flush()\n"
    )
    subprocess.run(
        [sys.executable, "-P", "-c", opens, str(bag), str(out)],
        check=True,
        env={**os.environ, "PATH": f"{script.parent}:/usr/bin:/bin"},
        timeout=120,
    )
    shown = entities(out.read_bytes(), tmp_path)
    assert "payscope:effort[slide]" in shown["/yard/axis"]
    assert times(tmp_path, "/yard/axis")["lap"] == ("int64", {7})


@pytest.mark.heavy
def test_a_log_that_cannot_be_read_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "torn.bag"
    path.write_bytes(b"no bag at all")
    left = imported(path)
    assert (left.returncode, left.stdout) == (2, b"")
    assert left.stderr.decode().startswith("payscope: ")
    assert left.stderr.decode().count("\n") == 1


@pytest.mark.usefixtures("small_viewer")
class TestViewer:
    pytestmark = VIEWER

    @pytest.mark.heavy
    def test_the_viewer_opens_a_ros_1_bag_without_one_view_error(
        self, script: Path, data_in_kind: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        # no other importer of ours, nor any else's
        monkeypatch.setenv("PATH", f"{script.parent}:/usr/bin:/bin")
        drawn = take_screenshots_of_recording_or_log(
            data_in_kind / "logs/husky_asphalt.bag", tmp_path
        )
        assert [each.tab for each in drawn] == ["Log", "/imu/data", "/drives"]
        assert [error for each in drawn for error in each.errors] == []
