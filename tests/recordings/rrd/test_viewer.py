"""The real viewer opens a recording, and no view of any tab complains."""

import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from analysis import Run
from estimators.errors import OutputError, RecordingError
from recordings import read_recording, write_recording
from recordings.report import colours
from recordings.rrd.recording_table import TABS
from recordings.rrd.viewer import run_headless_viewer, take_screenshots_of_recording
from tests.recordings.conftest import METHODS
from tests.twins import mark_slow_after
from tests.viewer_needed import VIEWER

#: Tabs of what these runs do not have; they have no cycles at all.
EMPTY = ("Cycles",)
EMPTY_WITHOUT_ESTIMATES = ("Loads", "Estimates", "Turning", "Residuals")


class TestViewer:
    pytestmark = VIEWER

    @pytest.mark.heavy
    @pytest.mark.parametrize(
        "options",
        [
            pytest.param({}, id="short"),
            # an overview of its own; 30 s of drawing in software
            pytest.param({"duration_s": 700.0}, id="long", marks=pytest.mark.slow),
            pytest.param({"accepted": False}, id="nothing accepted", marks=pytest.mark.slow),
        ],
    )
    @pytest.mark.usefixtures("small_viewer")
    def test_every_tab_activated_in_turn_is_drawn_without_one_view_error(
        self, drives, tmp_path: Path, options: dict
    ):
        path = write_recording(drives(**options), tmp_path / "shift.rrd")
        drawn = take_screenshots_of_recording(path, tmp_path)
        named = [tab.name for tab in TABS if tab.name not in EMPTY]
        assert [each.tab for each in drawn] == [
            name
            for name in named
            if options.get("accepted", True) or name not in EMPTY_WITHOUT_ESTIMATES
        ]
        assert [error for each in drawn for error in each.errors] == []
        sizes = [each.png.stat().st_size for each in drawn]
        assert min(sizes) > 20_000
        assert len({each.png.read_bytes() for each in drawn}) == len(drawn)

    @pytest.mark.heavy
    @pytest.mark.parametrize("tab", mark_slow_after(1, ["Estimates", "Calibration"]))
    def test_each_of_five_methods_is_seen(self, drives, tmp_path: Path, tab: str):
        path = write_recording(drives(60.0), tmp_path / "shift.rrd")
        (shot,) = take_screenshots_of_recording(path, tmp_path, tab)
        pixels = np.asarray(Image.open(shot.png).convert("RGB")).reshape(-1, 3).astype(int)
        for method in METHODS:
            own = [int(colours.choose_method_colour(method)[at : at + 2], 16) for at in (1, 3, 5)]
            assert np.sum(abs(pixels - own).max(axis=1) < 12) > 50, method

    @pytest.mark.heavy
    def test_a_recording_is_seen_while_it_is_written_and_the_file_is_the_same(
        self, drives, tmp_path: Path
    ):
        run = drives(60.0)
        with run_headless_viewer(None) as (client, address):
            assert not client.get_state().recordings
            path = write_recording(run, tmp_path / "live.rrd", viewer=address)
            deadline = time.monotonic() + 30.0
            while not client.get_state().recordings and time.monotonic() < deadline:
                time.sleep(0.2)
            assert len(client.get_state().recordings) == 1
            assert [r for view in client.get_state().views for r in view.reports] == []
        assert read_recording(path) == run


def test_a_missing_recording_or_folder_is_said_before_any_viewer_starts(tmp_path: Path):
    with pytest.raises(RecordingError, match="no such recording"):
        take_screenshots_of_recording(tmp_path / "missing.rrd", tmp_path)
    path = write_recording(Run({}), tmp_path / "empty.rrd")
    with pytest.raises(OutputError, match="no such folder"):
        take_screenshots_of_recording(path, tmp_path / "nowhere")


def test_importing_the_package_loads_neither_the_viewer_nor_the_plots():
    code = "import sys, recordings; print([m for m in ('rerun', 'matplotlib') if m in sys.modules])"
    command = [sys.executable, "-c", code]
    shown = subprocess.run(command, capture_output=True, text=True, check=True)
    assert shown.stdout.strip() == "[]"
