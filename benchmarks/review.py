"""A review against the script that a user would write, on one simulated hour.

    python -P benchmarks/review.py [--rounds 3] [--hours 1] [--write]

Both are processes of their own, in turn; the ratio is the median of those of each round. "With page
and recording" is `payscope review`, "without" `payscope run` with nothing written. `--write` puts
the table into docs/reviewing-a-shift.md.
"""

import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Final

import typer

from benchmarks.page import markdown, put

_REPO: Final = Path(__file__).resolve().parent.parent
_SCRIPT: Final = _REPO / "benchmarks" / "review_script.py"
_PAYSCOPE: Final = Path(sys.executable).with_name("payscope")
_MACHINE: Final = _REPO / "examples" / "yard.toml"
_TARGETS: Final = {"with page and recording": 5.0, "without": 15.0}


def _timed(*command: object) -> float:
    begin = time.perf_counter()
    done = subprocess.run(command, check=False, capture_output=True, text=True)  # pyright: ignore[reportArgumentType]
    # 1 is an answer: it cannot weigh
    if done.returncode > 1:
        raise SystemExit(done.stderr)
    return time.perf_counter() - begin


def main(rounds: int = 3, hours: float = 1.0, write: bool = False) -> None:
    """Time both."""
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder, "hour.bag")
        size = f"shift.duration_h={hours}"
        whole = ("--set", size, "--set", "shift.logs=1", "--set", "shift.damaged_logs=0")
        scenario = _REPO / "examples" / "shift.toml"
        _timed(_PAYSCOPE, "simulate", scenario, "-o", bag, *whole)
        logs = sorted(Path(folder).glob("hour*.bag"))
        script: list[float] = []
        ours: dict[str, list[float]] = {name: [] for name in _TARGETS}
        for number in range(rounds):
            script.append(_timed(sys.executable, _SCRIPT, *logs))
            out = Path(folder, f"review{number}")
            commands = (
                (_PAYSCOPE, "review", *logs, "-m", _MACHINE, "-o", out),
                (_PAYSCOPE, "run", *logs, "-m", _MACHINE),
            )
            for name, command in zip(ours, commands, strict=True):
                ours[name].append(_timed(*command))
    rows: list[list[str]] = []
    for name, took in ours.items():
        ratio = statistics.median(a / b for a, b in zip(script, took, strict=True))
        target = _TARGETS[name]
        seconds = [f"{statistics.median(each):.1f}" for each in (script, took)]
        met = "yes" if ratio >= target else "no"
        rows.append([name, *seconds, f"{ratio:.1f}×", f"≥ {target:g}×", met])
    table = markdown(["payscope", "script (s)", "payscope (s)", "ratio", "target", "met"], rows)
    print(table)
    if write:
        put("reviewing-a-shift.md", "review against a script", table)


if __name__ == "__main__":
    typer.run(main)
