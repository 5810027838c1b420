"""A stretch of a recording holds what lies in it, and nothing else."""

from pathlib import Path

import polars as pl
import pytest

from estimators.errors import RecordingError
from recordings import read_recording, write_recording
from recordings.display import is_long
from recordings.window import read_window

S = 10**9


@pytest.fixture(scope="module")
def recording(drives, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_recording(drives(700.0), tmp_path_factory.mktemp("window") / "shift.rrd")


def test_a_stretch_has_the_rows_inside_and_the_manoeuvres_that_reach_into_it(recording: Path):
    whole, part = read_recording(recording), read_window(recording, 100.0, 160.0)
    inside = pl.col("t_ns").is_between(100 * S, 160 * S)
    for name in ("aligned", "excitation", "gate", "estimates/ls"):
        assert part.frames[name].equals(whole.frames[name].filter(inside))
    reaches = (pl.col("end_t_ns") >= 100 * S) & (pl.col("start_t_ns") <= 160 * S)
    assert part.frames["segments"].equals(whole.frames["segments"].filter(reaches))
    assert part.frames["masses"].equals(whole.frames["masses"])
    assert part.provenance.notes[-1] == "a stretch of shift.rrd, from 100 to 160 s"


def test_a_stretch_of_a_long_run_is_drawn_whole(recording: Path):
    assert is_long(read_recording(recording))
    assert not is_long(read_window(recording, None, 300.0))


def test_without_ends_it_is_the_recording(recording: Path):
    assert read_window(recording, None, None) == read_recording(recording)


def test_a_stretch_outside_is_one_line_with_what_there_is(recording: Path):
    with pytest.raises(RecordingError, match=r"nothing from 9000 to \S+ s; it has 0 to \S+ s$"):
        read_window(recording, 9000.0, None)
