"""A recording is a log: replayed, it gives what its own log gives."""

import subprocess
from pathlib import Path

import polars as pl
import pytest

from analysis import Run
from estimators.errors import LogError
from recordings import read_recording, write_recording
from recordings.rrd.recording_limits import LIMITS
from recordings.rrd.viewer import find_viewer_executable
from replay import load_machine, open_log
from replay.logs import Log
from replay.pipeline import run
from tests.replay.sledge import Payscope, join_to_one_line
from tests.twins import mark_heavy_after

GOLDEN = Path(__file__).resolve().parents[2] / "golden"


@pytest.mark.heavy
@pytest.mark.parametrize("name", mark_heavy_after(1, ["straight.mcap", "planar.mcap", "table.csv"]))
def test_a_replay_of_the_recording_equals_that_of_the_log_bit_for_bit(
    name: str, tmp_path: Path
) -> None:
    machine = load_machine(
        GOLDEN / "table.machine.toml" if name == "table.csv" else Path("cat262c.toml")
    )
    first = run(open_log(GOLDEN / name), machine)
    path = write_recording(first, tmp_path / "first.rrd")
    again = run(open_log(path), machine)
    assert list(again.frames) == list(first.frames)
    for stage, frame in first.frames.items():
        assert again.frames[stage].equals(frame), stage
    assert again.provenance.losses == first.provenance.losses
    assert again.provenance.notes == first.provenance.notes
    assert again.provenance.t0_unix_ns == first.provenance.t0_unix_ns


@pytest.fixture
def recorded(payscope: Payscope, log: Path, machine_file: Path, tmp_path: Path) -> Path:
    path = tmp_path / "out.rrd"
    assert payscope("run", log, "-m", machine_file, "-o", path).status == 0
    return path


@pytest.mark.heavy
def test_commands_take_it_in_the_place_of_a_log(
    payscope: Payscope, recorded: Path, machine_file: Path, tmp_path: Path
) -> None:
    again = tmp_path / "again.rrd"
    assert payscope("run", recorded, "-m", machine_file, "-o", again).status == 0
    assert read_recording(again).frames["loads"].equals(read_recording(recorded).frames["loads"])
    assert "recording" in payscope("info", recorded).out


@pytest.mark.heavy
def test_it_is_not_replaced_by_its_own_replay_also_with_force(
    payscope: Payscope, recorded: Path, machine_file: Path
) -> None:
    before = recorded.read_bytes()
    said = payscope("run", recorded, "-m", machine_file, "-o", recorded, "--force")
    join_to_one_line(said, recorded.name, "is also an input")
    assert recorded.read_bytes() == before


@pytest.mark.heavy
def test_a_field_that_was_not_recorded_and_a_recording_without_channels_are_one_line(
    recorded: Path, tmp_path: Path
) -> None:
    log: Log = open_log(recorded)
    topic = log.topics()["topic"][0]
    with pytest.raises(LogError, match=r"was recorded without field 'odd'; .*replay the log"):
        log.read(topic, ["odd"])
    with pytest.raises(LogError, match="no topic '/odd'"):
        log.read("/odd", ["x"])
    whole = read_recording(recorded)
    frames = {name: frame for name, frame in whole.frames.items() if not name.startswith("raw/")}
    bare = write_recording(type(whole)(frames, whole.provenance), tmp_path / "bare.rrd")
    with pytest.raises(LogError, match="does not contain the channels of its log"):
        open_log(bare)


def test_rows_that_a_recovered_recording_lost_are_losses_of_the_log(tmp_path: Path) -> None:
    rows = 3 * LIMITS.stored_block_rows
    count = pl.int_range(rows, eager=True)
    imu = pl.DataFrame({"log_time_ns": count, "header_stamp_ns": count, "x": count})
    path = write_recording(Run({"raw/imu": imu}), tmp_path / "shift.rrd")
    with open_log(path) as whole:
        assert whole.read("imu", ["x"]).height == rows
        assert whole.losses() == ()
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    saved = tmp_path / "recovered.rrd"
    command = [find_viewer_executable(), "rrd", "optimize", path, "-o", saved]
    subprocess.run(command, check=True, capture_output=True)
    with open_log(saved) as torn:
        left = torn.read("imu", ["x"]).height
        assert 0 < left < rows
        (loss,) = torn.losses()
    assert str(loss) == f"recovered.rrd imu: the recording has {left} of {rows} rows"
