"""`payscope view`: pictures of the viewer without a screen."""

from pathlib import Path

import pytest

from tests.replay.sledge import Payscope
from tests.viewer_needed import VIEWER

pytestmark = VIEWER


@pytest.mark.heavy
def test_a_stretch_of_one_tab_is_photographed(
    payscope: Payscope, log: Path, machine_file: Path, tmp_path: Path
) -> None:
    out, folder = tmp_path / "out.rrd", tmp_path / "pictures"
    assert payscope("run", log, "-m", machine_file, "-o", out).status == 0
    said = payscope(
        *("view", out, "--screenshot", folder, "--tab", "motion", "--from", 5, "--to", 15)
    )
    assert (said.status, said.err) == (0, "")
    (picture,) = folder.iterdir()
    assert said.out.split() == [str(picture)]
    assert picture.name.endswith("-motion.png")
    assert picture.read_bytes().startswith(b"\x89PNG")
