"""Compiled code that is kept may be damaged: that is said in one line, and mended."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import REPO
from tests.replay.sledge import MACHINE, sledge

#: One compiled function, by which a run stands or falls like by all of them.
ONE_LOOP = """
from estimators.compile_cache import remove_unreadable_compiled_code
import numpy as np
from estimators.interpreted import compile_even_short_loops
from estimators.methods.ls import compute_mean_sample_weights
try:
    with compile_even_short_loops():
        compute_mean_sample_weights(np.ones((4, 2)), np.ones((2, 2, 1)), np.array([3]), 2)
    print("done")
except Exception as error:
    print(*remove_unreadable_compiled_code(error))
"""


def damage(kept: Path) -> None:
    for code in kept.rglob("*.nbc"):
        code.write_bytes(code.read_bytes()[:100])


@pytest.mark.heavy
def test_a_loop_that_cannot_be_read_is_removed_and_compiled_anew(tmp_path: Path) -> None:
    said = []
    for _ in range(3):
        left = subprocess.run(
            [sys.executable, "-c", ONE_LOOP],
            env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)},
            capture_output=True,
            text=True,
            check=True,
        )
        said.append(left.stdout.strip())
        if len(said) == 1:
            damage(tmp_path)
    assert said == ["done", str(tmp_path / "payscope-numba"), "done"]


def test_a_module_cut_short_by_a_full_disk_is_removed_and_the_next_command_works(
    tmp_path: Path,
) -> None:
    sledge(seconds=4.0).write_csv(tmp_path / "sledge.csv")
    words = [sys.executable, "-P", str(REPO / "payscope.py"), "info", "sledge.csv"]
    environment = {**os.environ, "PYTHONPYCACHEPREFIX": str(tmp_path / "kept")}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)

    def look() -> "subprocess.CompletedProcess[str]":
        return subprocess.run(
            words, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )

    assert look().returncode == 0
    (cut,) = (tmp_path / "kept").rglob("describe_log*.pyc")
    cut.write_bytes(cut.read_bytes()[:1000])
    damaged = look()
    assert damaged.returncode == 2
    assert damaged.stderr == (
        f"payscope: {cut}: compiled code kept there cannot be read and was removed; run it again\n"
    )
    assert look().returncode == 0


#: The command, which interprets no short log.
COMMAND = """
from estimators.interpreted import compile_even_short_loops
from replay.commands.cli import main
with compile_even_short_loops():
    main()
"""


@pytest.mark.slow
def test_compiled_code_that_cannot_be_read_is_removed_and_the_next_run_works(
    tmp_path: Path,
) -> None:
    sledge().write_csv(tmp_path / "sledge.csv")
    (tmp_path / "sledge.toml").write_text(MACHINE)
    kept = tmp_path / "kept"
    words = [sys.executable, "-c", COMMAND, "run", "sledge.csv", "-m", "sledge.toml", "--json"]
    words += ["--set", 'settings.trace.methods=["ls"]']
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(kept)}

    def run() -> "subprocess.CompletedProcess[str]":
        return subprocess.run(
            words, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )

    first = run()
    assert first.returncode == 0, first.stderr
    damage(kept)
    damaged = run()
    assert damaged.returncode == 2
    assert damaged.stderr.count("\n") == 1
    assert "cannot be read and was removed; run it again" in damaged.stderr
    again = run()
    assert again.returncode == 0, again.stderr
    assert again.stdout == first.stdout
