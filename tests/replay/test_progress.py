"""What a person is told while waiting."""

import numpy as np
import pytest
from numba import njit

from replay.commands import progress_bar


def compile_something() -> None:
    @njit
    def doubled(x: float) -> float:
        return 2.0 * x

    assert doubled(np.float64(1.0)) == 2.0
    assert doubled(np.float32(1.0)) == 2.0


@pytest.mark.parametrize("long_s", [0.0, 1e6])
def test_long_compiling_is_told_in_one_line_on_stderr(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], long_s: float
) -> None:
    monkeypatch.setattr(progress_bar, "LONG_S", long_s)
    with progress_bar.StageProgress(1):
        compile_something()
    said = capsys.readouterr()
    assert said.out == ""
    line = (
        "payscope: compiling numerical code for this version, once; up to a minute "
        "(payscope warm-up does it ahead)\n"
    )
    assert said.err == (line if long_s == 0.0 else "")


def test_nothing_is_told_after_the_work(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(progress_bar, "LONG_S", 0.0)
    with progress_bar.StageProgress(1):
        pass
    compile_something()
    assert capsys.readouterr().err == ""
