"""Compiled code that is kept may be damaged: that is said in one line, and mended."""

import os
import subprocess
import sys
from pathlib import Path

from tests.replay.sledge import MACHINE, sledge

COMMAND = Path(sys.executable).with_name("payscope")


def test_compiled_code_that_cannot_be_read_is_removed_and_the_next_run_works(
    tmp_path: Path,
) -> None:
    sledge().write_csv(tmp_path / "sledge.csv")
    (tmp_path / "sledge.toml").write_text(MACHINE)
    kept = tmp_path / "kept"
    words = [COMMAND, "run", "sledge.csv", "-m", "sledge.toml", "--json"]
    words += ["--set", 'settings.trace.methods=["ls"]']
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(kept)}

    def run() -> "subprocess.CompletedProcess[str]":
        return subprocess.run(
            words, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )

    first = run()
    assert first.returncode == 0, first.stderr
    for code in kept.rglob("*.nbc"):
        code.write_bytes(code.read_bytes()[:100])
    damaged = run()
    assert damaged.returncode == 2
    assert damaged.stderr.count("\n") == 1
    assert "cannot be read and was removed; run it again" in damaged.stderr
    again = run()
    assert again.returncode == 0, again.stderr
    assert again.stdout == first.stdout
