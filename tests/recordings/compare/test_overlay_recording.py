"""A recording of two replays: what differs is drawn, and nothing else."""

from pathlib import Path

import polars as pl
import pytest

from analysis import Run
from recordings import read_recording
from recordings.compare.overlay_recording import write_overlay_recording
from recordings.rrd.viewer import take_screenshots_of_recording
from tests.viewer_needed import VIEWER


def heavier(run: Run) -> Run:
    """The same run with an estimator that gives 10 kg more."""
    ls = run.frames["estimates/ls"].with_columns(pl.col("mass_kg") + 10.0)
    return Run({**run.frames, "estimates/ls": ls}, run.provenance)


def shown(path: Path) -> dict[str, set[str]]:
    """The components of each entity."""
    import rerun as rr

    return {
        chunk.entity_path: {field.name for field in chunk.to_record_batch().schema}
        for chunk in rr.chunk.RrdReader(path).store().stream()
    }


def blueprint(path: Path, ending: str) -> set[str]:
    """The names in those components of the blueprint that end so."""
    import rerun as rr

    reader = rr.chunk.RrdReader(path)
    (embedded,) = reader.blueprints()
    batches = [chunk.to_record_batch() for chunk in reader.stream(store=embedded)]
    return {
        name
        for batch in batches
        for component in batch.schema.names
        if component.endswith(ending)
        for row in batch.column(component).to_pylist()
        for name in row or ()
    }


def views(path: Path) -> set[str]:
    """What panels are called."""
    return blueprint(path, "ViewBlueprint:display_name")


def names(path: Path) -> set[str]:
    """What lines and bands are called in legends."""
    return blueprint(path, ":names")


@pytest.mark.heavy
def test_what_differs_is_drawn_over_each_other_and_subtracted(drives, tmp_path: Path) -> None:
    a = drives(60.0)
    path = write_overlay_recording(
        a, heavier(a), tmp_path / "ab.rrd", "# A and B", is_same_log=True
    )
    drawn = shown(path)
    for side in ("A", "B", "B_less_A"):
        assert "payscope:mass_kg" in drawn[f"/{side}/estimates/ls"]
    named = views(path)
    mass = "Mass (kg): A strong, B pale"
    assert {mass, "B − A: Mass (kg)", "Speed (m/s)", "Compared"} <= named
    assert "Force (N)" not in named
    assert "B − A: Speed (m/s)" not in named


@pytest.mark.heavy
def test_a_legend_names_what_both_draw_once(drives, tmp_path: Path) -> None:
    a = drives(60.0)
    b = heavier(a)
    faster = b.frames["excitation"].with_columns(pl.col("speed_x_m_s") * 1.1)
    del b.frames["estimates/tls"]
    b.frames["excitation"] = faster
    named = names(write_overlay_recording(a, b, tmp_path / "ab.rrd", "", is_same_log=True))
    # five methods of each would not fit beside a small panel
    assert {"ls", "rls", "A tls"} <= named
    assert not {"A ls", "B ls", "tls", "B tls"} & named
    assert {"A speed", "B speed"} <= named


@pytest.mark.heavy
def test_of_a_long_log_the_difference_is_drawn_in_bins(drives, tmp_path: Path) -> None:
    a = drives(700.0)
    path = write_overlay_recording(a, heavier(a), tmp_path / "ab.rrd", "", is_same_log=True)
    assert "B − A: Mass (kg)" in views(path)


def test_it_keeps_no_frames_and_says_so(drives, tmp_path: Path) -> None:
    a = drives(60.0)
    kept = read_recording(write_overlay_recording(a, a, tmp_path / "ab.rrd", "", is_same_log=True))
    assert kept.frames == {}
    assert "two replays" in kept.provenance.notes[0]


@pytest.mark.slow
@pytest.mark.parametrize("is_same_log", [True, False], ids=["one log", "two logs"])
@pytest.mark.usefixtures("small_viewer")
class TestViewer:
    pytestmark = VIEWER

    def test_no_view_of_any_tab_complains(self, drives, tmp_path: Path, is_same_log: bool) -> None:
        a = drives(60.0)
        path = write_overlay_recording(
            a, heavier(drives(48.0)), tmp_path / "ab.rrd", "# A and B", is_same_log=is_same_log
        )
        drawn = take_screenshots_of_recording(path, tmp_path)
        assert drawn[0].tab == "Compared"
        assert [error for each in drawn for error in each.errors] == []
