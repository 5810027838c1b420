"""`payscope plot`: one figure a question, of a run, a stretch or a moment."""

from pathlib import Path

import pytest

from recordings.plot import FIGURES
from replay.commands.plot import Question
from tests.replay.sledge import Payscope, one_line


@pytest.fixture
def recording(payscope: Payscope, log: Path, machine_file: Path, tmp_path: Path) -> Path:
    path = tmp_path / "out.rrd"
    assert payscope("run", log, "-m", machine_file, "-o", path).status == 0
    return path


def test_the_command_offers_the_figures_that_there_are() -> None:
    assert [each.value for each in Question] == list(FIGURES)


def test_a_moment_is_drawn_with_what_lies_around_it(
    payscope: Payscope, recording: Path, tmp_path: Path
) -> None:
    target = tmp_path / "gate.svg"
    said = payscope("plot", recording, "-o", target, "--figure", "gate", "--at", 20)
    assert (said.status, said.out.strip()) == (0, str(target))
    one_line(payscope("plot", recording, "-o", target, "--at", "nan", "--force"), "--at")
    one_line(payscope("plot", recording, "-o", target, "--at", 900, "--force"), "it has 0 to 40 s")
    one_line(payscope("plot", recording, "-o", target), "exists already")
