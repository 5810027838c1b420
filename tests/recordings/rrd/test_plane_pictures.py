"""Pictures over no time: what they draw is what the frames hold, and all of it is in view."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from analysis import Run
from recordings import read_recording, write_recording
from recordings.rrd.plane_pictures import make_plane_pictures
from recordings.rrd.recording_limits import LIMITS
from tests.recordings.conftest import MASS_KG, METHODS


def test_the_slope_of_the_accepted_points_is_the_mass(drives) -> None:
    picture = make_plane_pictures(drives(60.0))["scatter"]
    (accepted,) = (each for each in picture.series if each.label.startswith("accepted"))
    slope_kg = np.polyfit(accepted.x, accepted.y, 1)[0]
    assert slope_kg == pytest.approx(MASS_KG, rel=0.1)
    lines = [each for each in picture.series if each.joined]
    masses = drives(60.0).frames["loads"]["mass_kg"].drop_nulls()
    assert [line.y[-1] / line.x[-1] for line in lines] == pytest.approx(
        sorted({masses.min(), masses.max()})
    )


def test_a_long_log_is_thinned_evenly(drives) -> None:
    picture = make_plane_pictures(drives(700.0))["scatter"]
    assert max(each.x.size for each in picture.series) <= 2000


def test_a_line_is_what_the_calibration_adds_to_each_estimate(drives) -> None:
    run = drives(60.0)
    picture = make_plane_pictures(run)["line"]
    assert [each.label for each in picture.series if not each.joined] == list(METHODS)
    lines = [each for each in picture.series if each.joined]
    for line, (_, points) in zip(
        lines, run.frames["calibration"].group_by("method", maintain_order=True), strict=True
    ):
        alpha, beta = points["alpha_1"][0], points["beta_kg"][0]
        assert line.y + line.x == pytest.approx(alpha * line.x + beta)


def test_a_method_without_an_estimate_is_in_no_picture(drives) -> None:
    run = drives(60.0)
    silent = METHODS[0]
    without = run.frames["calibration"].with_columns(
        pl.when(pl.col("method") != silent).then("estimate_kg").alias("estimate_kg")
    )
    pictures = make_plane_pictures(Run({**run.frames, "calibration": without}))
    for name in ("line", "errors"):
        assert silent not in [each.label for each in pictures[name].series]


def test_errors_of_one_load_stand_beside_each_other_by_method(drives) -> None:
    picture = make_plane_pictures(drives(60.0))["errors"]
    places = [each.x[0] for each in picture.series if each.label in METHODS]
    assert len(set(places)) == len(METHODS)


def test_evidence_has_the_interval_of_a_later_mass() -> None:
    points = pl.DataFrame(
        {
            "reference_kg": [3000.0, 3500.0],
            "mean_kg": [3010.0, 3512.0],
            "error_kg": [1.0, -1.0],
            "error_left_out_kg": [None, -2.0],
        }
    )
    line = pl.DataFrame(
        {"alpha_1": [1.0], "beta_kg": [-11.0], "line_u_kg": [3.0], "coverage_k_1": [2.0]}
    )
    pictures = make_plane_pictures(Run({"points": points, "line": line}))
    assert list(pictures) == ["line", "errors"]
    levels = [each.y[0] for each in pictures["errors"].series if each.joined]
    assert levels == [0.0, 6.0, -6.0]


def test_a_run_without_calibration_and_excitation_has_no_picture() -> None:
    assert make_plane_pictures(Run({})) == {}


@pytest.mark.heavy
def test_everything_is_in_view_and_the_run_is_read_back_unchanged(drives, tmp_path: Path) -> None:
    import rerun as rr

    run = drives(60.0)
    path = write_recording(run, tmp_path / "shift.rrd")
    left, top, right, bottom = LIMITS.plane_bounds
    seen: set[str] = set()
    for chunk in rr.chunk.RrdReader(path).store().stream():
        if not chunk.entity_path.startswith("/display/picture/"):
            continue
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            if not name.endswith(("Points2D:positions", "LineStrips2D:strips")):
                continue
            places = np.array(pl.Series(batch.column(name)).explode().to_list())
            x, y = np.concatenate([np.reshape(each, (-1, 2)) for each in places]).T
            assert left <= x.min() <= x.max() <= right
            assert top <= y.min() <= y.max() <= bottom
            seen.add(chunk.entity_path.split("/")[3])
    assert seen == {"scatter", "line", "errors"}
    assert read_recording(path) == run
