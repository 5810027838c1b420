"""A review against the script that a user would write; and where a long shift's time goes.

    python -P benchmarks/review.py [--rounds 3] [--hours 1] [--shift-hours 8] [--write]

Of one simulated hour, both are processes of their own, in turn; the ratio is the median of those of
each round. "With page and recording" is `payscope review`, "without" `payscope run` with nothing
written. A shift of eight bags, one torn, is then reviewed once, and once more with one of its bags
gone; not with `--shift-hours 0`. `--write` puts the tables into docs/reviewing-a-shift.md.
"""

import re
import resource
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


_STAGE: Final = re.compile(r"^(\w+) +([\d.]+) s$", re.M)


def _timed(*command: object, highest: int = 1) -> float:
    """Seconds of a command whose exit status is at most `highest`; 1 means: it cannot weigh."""
    begin = time.perf_counter()
    done = subprocess.run(command, check=False, capture_output=True, text=True)  # pyright: ignore[reportArgumentType]
    if done.returncode > highest:
        raise SystemExit(done.stderr)
    return time.perf_counter() - begin


def _against_script(folder: Path, rounds: int, hours: float) -> str:
    logs = _simulated(folder / "hour.bag", hours, logs=1, torn=0)
    # what is compiled once is not of an hour's time
    _timed(_PAYSCOPE, "review", *logs, "-m", _MACHINE, "-o", folder / "compiled")
    script: list[float] = []
    ours: dict[str, list[float]] = {name: [] for name in _TARGETS}
    for number in range(rounds):
        script.append(_timed(sys.executable, _SCRIPT, *logs, highest=0))
        out = folder / f"review{number}"
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
    return markdown(["payscope", "script (s)", "payscope (s)", "ratio", "target", "met"], rows)


def _whole_shift(folder: Path, hours: float) -> str:
    logs = _simulated(folder / "shift.bag", hours, logs=8, torn=1)
    out = folder / "review"
    review = (_PAYSCOPE, "review", "-m", _MACHINE, "-o", out, "--timing")
    first = _stages(*review, *logs)
    # of all children so far: none of the others is as large
    peak_gib = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 2.0**20
    again = _stages(*review, *logs[:-1])
    size = sum(log.stat().st_size for log in logs)
    rows = [[stage, f"{seconds:.1f}", f"{again[stage]:.1f}"] for stage, seconds in first.items()]
    total = [f"**{sum(each.values()):.1f}**" for each in (first, again)]
    head = ["stage", "all bags (s)", "one bag less (s)"]
    recording = (out / "shift.rrd").stat().st_size
    return (
        markdown(head, [*rows, ["**sum**", *total]])
        + f"\n\n{len(logs)} bags of {size / 1e9:.1f} GB, peak memory {peak_gib:.2f} GiB, "
        f"`shift.rrd` {recording / 1e6:.0f} MB."
    )


def _simulated(path: Path, hours: float, logs: int, torn: int) -> list[Path]:
    sizes = (f"shift.duration_h={hours}", f"shift.logs={logs}", f"shift.damaged_logs={torn}")
    settings = [word for size in sizes for word in ("--set", size)]
    _timed(_PAYSCOPE, "simulate", _REPO / "examples" / "shift.toml", "-o", path, *settings)
    return sorted(path.parent.glob(f"{path.stem}*.bag"))


def _stages(*command: object) -> dict[str, float]:
    """Seconds of each stage, as `--timing` prints them."""
    done = subprocess.run(command, check=False, capture_output=True, text=True)  # pyright: ignore[reportArgumentType]
    if done.returncode > 1:
        raise SystemExit(done.stderr)
    return {name: float(value) for name, value in _STAGE.findall(done.stderr)}


def main(
    rounds: int = 3, hours: float = 1.0, shift_hours: float = 8.0, write: bool = False
) -> None:
    """Time both."""
    with tempfile.TemporaryDirectory() as folder:
        tables = {"review against a script": _against_script(Path(folder), rounds, hours)}
        if shift_hours:
            tables["review of a shift"] = _whole_shift(Path(folder), shift_hours)
    for name, table in tables.items():
        print(table)
        if write:
            put("reviewing-a-shift.md", name, table)


if __name__ == "__main__":
    typer.run(main)
