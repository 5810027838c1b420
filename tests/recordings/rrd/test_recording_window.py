"""A stretch of a recording holds what lies in it, and nothing else."""

from pathlib import Path

import polars as pl
import pytest

from analysis.model.run_record import Run
from estimators.errors import RecordingError
from recordings import read_recording, write_recording
from recordings.rrd.display_frames import is_run_drawn_decimated
from recordings.rrd.recording_window import read_run_of_time_range

S = 10**9


@pytest.fixture(scope="module")
def recording(drives, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_recording(drives(700.0), tmp_path_factory.mktemp("window") / "shift.rrd")


@pytest.mark.heavy
def test_a_stretch_has_the_rows_inside_and_the_manoeuvres_that_reach_into_it(recording: Path):
    whole, part = read_recording(recording), read_run_of_time_range(recording, 100.0, 160.0)
    inside = pl.col("t_ns").is_between(100 * S, 160 * S)
    for name in ("aligned", "excitation", "gate", "estimates/ls"):
        assert part.frames[name].equals(whole.frames[name].filter(inside))
    reaches = (pl.col("end_t_ns") >= 100 * S) & (pl.col("start_t_ns") <= 160 * S)
    assert part.frames["segments"].equals(whole.frames["segments"].filter(reaches))
    assert part.frames["masses"].equals(whole.frames["masses"])
    assert part.provenance.notes[-1] == "a stretch of shift.rrd, from 100 s to 160 s"


def test_a_stretch_of_a_long_run_is_drawn_whole(recording: Path):
    assert is_run_drawn_decimated(read_recording(recording))
    assert not is_run_drawn_decimated(read_run_of_time_range(recording, None, 300.0))


@pytest.mark.heavy
def test_without_ends_it_is_the_recording(recording: Path):
    assert read_run_of_time_range(recording, None, None) == read_recording(recording)


def test_a_stretch_outside_is_one_line_with_what_there_is(recording: Path):
    with pytest.raises(
        RecordingError, match=r"has no data from 9000 s to the end; it has 0 to \S+ s$"
    ):
        read_run_of_time_range(recording, 9000.0, None)


@pytest.mark.parametrize("ends", [(9.0, 3.0), (float("nan"), None), (None, float("inf"))])
def test_ends_that_are_no_stretch_are_one_line(
    recording: Path, ends: tuple[float | None, float | None]
):
    with pytest.raises(
        RecordingError, match=r"shift\.rrd: from .* is not a time span; use seconds"
    ):
        read_run_of_time_range(recording, *ends)


def test_a_recording_without_samples_says_so(drives, tmp_path: Path):
    whole = drives(20.0)
    empty = Run({name: frame.clear() for name, frame in whole.frames.items()}, whole.provenance)
    path = write_recording(empty, tmp_path / "empty.rrd")
    with pytest.raises(RecordingError, match=r"has no data from 1 s to 2 s; it has no samples$"):
        read_run_of_time_range(path, 1.0, 2.0)


def test_fields_of_a_log_that_are_named_like_ours_are_not_taken_for_the_time(
    drives, tmp_path: Path
):
    about = drives(20.0).provenance
    at = [about.t0_unix_ns + second * S for second in range(5)]
    raw = pl.DataFrame({"log_time_ns": at, "header_stamp_ns": at, "t_ns": [0] * 5})
    path = write_recording(Run({"raw/table": raw}, about), tmp_path / "raw.rrd")
    assert read_run_of_time_range(path, 1.0, 3.0).frames["raw/table"].equals(raw[1:4])


@pytest.mark.heavy
def test_a_finding_of_the_whole_log_is_one_of_every_stretch(drives, tmp_path: Path):
    path = write_recording(drives(60.0), tmp_path / "shift.rrd")
    assert read_run_of_time_range(path, 30.0, 40.0).frames["findings"]["cause"].to_list() == [
        "delay"
    ]
    assert read_run_of_time_range(path, 5.0, 8.0).frames["findings"].height == 2
