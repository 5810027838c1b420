"""What a first run would compile comes ready, also where two processes make it at once."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numba
import pytest
from typer.testing import CliRunner

from estimators import compile_cache
from estimators.interpreted import CompiledLoop
from replay.commands.cli import app
from replay.warm_up.compile_loops import compile_all_loops
from tests.golden.golden import LOGS, replay
from tests.twins import mark_slow_after

COMMAND = Path(sys.executable).with_name("payscope")
#: A loop that calls others, and one that only the reader of logs has.
TWO_LOOPS = """
import numpy as np
from estimators.interpreted import compile_even_short_loops
from estimators.numerics.small_systems import compute_condition_numbers
from replay.logs.blocks.block_groups import find_indices_of_values
with compile_even_short_loops():
    keys = find_indices_of_values(np.arange(3), np.arange(2))
    print(compute_condition_numbers(np.ones((1, 2)), 1, 1).tolist(), keys)
"""


@pytest.mark.heavy
@pytest.mark.parametrize("log", mark_slow_after(1, LOGS))
def test_a_run_compiles_nothing_that_was_not_compiled_ahead(
    log: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: set[tuple[str, str]] = set()

    def call(loop: CompiledLoop, *arguments: Any) -> Any:
        asked.add((loop.__name__, str(tuple(map(numba.typeof, arguments)))))
        return loop.compiled(*arguments)

    monkeypatch.setattr(CompiledLoop, "__call__", call)
    compile_all_loops()
    ready = asked.copy()
    replay(log)
    assert len(ready) > 50
    # readings of other rates than the grid's are averaged
    assert sum(name == "_fill_averages" for name, _ in ready) == 1
    assert asked - ready == set()


@pytest.mark.heavy
def test_two_processes_that_compile_at_once_do_each_other_no_harm(tmp_path: Path) -> None:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}

    def start() -> "subprocess.Popen[str]":
        return subprocess.Popen(
            [sys.executable, "-c", TWO_LOOPS],
            cwd=compile_cache._HOUSE,
            env=environment,
            stdout=subprocess.PIPE,
            text=True,
        )

    both = [start(), start()]
    said = [process.communicate()[0] for process in both]
    kept = {path: path.read_bytes() for path in tmp_path.rglob("*.nb?")}
    after = start()
    assert [after.communicate()[0], *said] == [said[0]] * 3
    assert said[0] == "[1.0, 1.0] [ 0  1 -1]\n"
    assert [process.returncode for process in (*both, after)] == [0, 0, 0]
    assert kept
    assert {path: path.read_bytes() for path in tmp_path.rglob("*.nb?")} == kept


@pytest.fixture
def chosen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder that the user has chosen for compiled code."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "chosen"))
    monkeypatch.setattr(
        compile_cache, "known_folder_of", lambda source: compile_cache.make_cache_folder(source)
    )
    return tmp_path / "chosen"


@pytest.mark.heavy
def test_what_is_ready_is_not_gone_through_again(
    chosen: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stages: list[str] = []
    monkeypatch.setattr(
        "replay.warm_up.compile_loops.compile_all_loops", lambda _: stages.append("compiled")
    )
    for words in (["warm-up"], ["warm-up"], ["warm-up", "--force"]):
        result = CliRunner().invoke(app, words)
        assert result.exit_code == 0
        assert result.stdout == f"everything is compiled: {chosen / 'payscope-numba'}\n"
    assert stages == ["compiled", "compiled"]
    compile_cache.remove_compile_cache()
    assert not compile_cache.are_all_loops_cached()


def test_where_nothing_can_be_kept_it_says_so_at_once(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    said = subprocess.run(
        [COMMAND, "warm-up"],
        env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "file")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert said.returncode == 2
    assert said.stderr.count("\n") == 1
    assert "set NUMBA_CACHE_DIR to a writable folder" in said.stderr
