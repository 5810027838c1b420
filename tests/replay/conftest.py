"""Small logs and machine files for the tests of the command line."""

import sys
from pathlib import Path
from typing import Any

import pytest

from replay.commands import progress
from replay.commands.cli import main
from tests.replay.sledge import MACHINE, Payscope, Said, sledge


@pytest.fixture
def payscope(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Payscope:
    """Run the command line as a user would; the exit status, stdout and stderr."""

    app = main.__globals__["app"]
    raised: list[Exception] = []

    def noted(**options: Any) -> Any:
        try:
            return app(**options)
        except Exception as error:
            raised.append(error)
            raise

    monkeypatch.setitem(main.__globals__, "app", noted)
    # whether the loops are compiled already depends on the tests before
    monkeypatch.setattr(progress, "LONG_S", float("inf"))

    def call(*words: object) -> Said:
        raised.clear()
        monkeypatch.setattr(sys, "argv", ["payscope", *map(str, words)])
        with pytest.raises(SystemExit) as left:
            main()
        captured = capsys.readouterr()
        error = raised[0] if raised else None
        return Said(int(left.value.code or 0), captured.out, captured.err, error)

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
