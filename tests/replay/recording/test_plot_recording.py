"""`payscope plot`: one figure a question, of a run, a stretch or a moment."""

from pathlib import Path

import pytest

from recordings.plots.run_plots import FIGURES
from replay.commands.plot import FigureName
from tests.replay.sledge import Payscope, join_to_one_line

pytestmark = pytest.mark.usefixtures("kept_replays")


@pytest.fixture
def recording(payscope: Payscope, log: Path, machine_file: Path, tmp_path: Path) -> Path:
    path = tmp_path / "out.rrd"
    assert payscope("run", log, "-m", machine_file, "-o", path).status == 0
    return path


def test_the_command_offers_the_figures_that_there_are() -> None:
    assert [each.value for each in FigureName] == list(FIGURES)


@pytest.mark.heavy
def test_a_moment_is_drawn_with_what_lies_around_it(
    payscope: Payscope, recording: Path, tmp_path: Path
) -> None:
    target = tmp_path / "gate.svg"
    said = payscope("plot", recording, "-o", target, "--figure", "gate", "--at", 20)
    assert (said.status, said.out.strip()) == (0, str(target))
    join_to_one_line(payscope("plot", recording, "-o", target, "--at", "nan", "--force"), "--at")
    join_to_one_line(
        payscope("plot", recording, "-o", target, "--at", 900, "--force"), "it has 0 to 40 s"
    )
    join_to_one_line(payscope("plot", recording, "-o", target), "exists already")


@pytest.mark.heavy
def test_a_moment_beyond_all_time_or_beside_the_stretch_is_one_line(
    payscope: Payscope, recording: Path, tmp_path: Path
) -> None:
    words = ("plot", recording, "-o", tmp_path / "page.png")
    join_to_one_line(payscope(*words, "--at", "1e300"), "it has 0 to 40 s")
    join_to_one_line(
        payscope(*words, "--at", 5, "--from", 20, "--to", 30), "--at 5", "change one of them"
    )
    assert not (tmp_path / "page.png").exists()


@pytest.mark.heavy
@pytest.mark.filterwarnings("error")
def test_a_stretch_of_one_sample_is_drawn(
    payscope: Payscope, recording: Path, tmp_path: Path
) -> None:
    said = payscope("plot", recording, "-o", tmp_path / "page.png", "--from", 20, "--to", 20)
    assert (said.status, said.err) == (0, "")
