"""Small logs and machine files for the tests of the command line."""

import sys
from pathlib import Path

import pytest

from replay.commands.cli import main
from tests.replay.sledge import MACHINE, Payscope, Said, sledge


@pytest.fixture
def payscope(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Payscope:
    """Run the command line as a user would; the exit status, stdout and stderr."""

    def call(*words: object) -> Said:
        monkeypatch.setattr(sys, "argv", ["payscope", *map(str, words)])
        with pytest.raises(SystemExit) as left:
            main()
        captured = capsys.readouterr()
        return Said(int(left.value.code or 0), captured.out, captured.err)

    return call


@pytest.fixture
def machine_file(tmp_path: Path) -> Path:
    path = tmp_path / "sledge.toml"
    path.write_text(MACHINE)
    return path


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "sledge.csv"
    sledge().write_csv(path)
    return path
