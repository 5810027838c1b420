"""Writing simulated logs by columns against writing them message by message, and a whole shift.

    python -P benchmarks/simulate.py [--minutes 20] [--shift-hours 8] [--write]

Pairs in turn, the medians of three ratios. Messages are those of a shift with
all topics; files must be equal byte for byte where the library's writer makes the same container.
"simulated and written" adds to both the time that simulating takes today. A shift is then simulated
as eight logs from the command line. `--write` puts the table into docs/speed.md.
"""

import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, NamedTuple

import typer

from analysis.simulation import Scenario, SimulatedLog
from analysis.simulation.logs.shift_logs import ShiftSimulation
from benchmarks import simulate_peers as peers
from benchmarks.page import markdown, put
from replay.logs.writers.bag_writer import write_bag
from replay.logs.writers.mcap_writer import write_mcap
from replay.logs.writers.rosbag2_writer import write_db3, write_rosbag2

_ROUNDS: Final = 3
_TARGET: Final = 20.0
_WHOLE_TARGET: Final = 6.0
_EXAMPLE: Final = Path(__file__).resolve().parent.parent / "examples" / "shift.toml"
_Writer = Callable[[SimulatedLog, Path], None]


class _Format(NamedTuple):
    name: str
    ours: _Writer
    theirs: _Writer
    #: whether both make the same file
    same: bool


_FORMATS: Final = (
    _Format("shift.bag", write_bag, peers.write_bag, True),
    _Format("shift.mcap", write_mcap, peers.write_mcap, True),
    _Format("shift (rosbag2, MCAP)", write_rosbag2, peers.write_directory, False),
    _Format("shift.db3", write_db3, peers.write_database, False),
)


def _scenario(hours: float) -> Scenario:
    topics = ["boom", "odometry", "gnss"]
    return Scenario.model_validate({"shift": {"duration_h": hours, "topics": topics}})


def _simulated(scenario: Scenario) -> SimulatedLog:
    assert scenario.shift is not None
    return next(ShiftSimulation(scenario, scenario.shift).simulate_logs())


class _Taken(NamedTuple):
    clock_s: float
    processor_s: float


def _taken(work: Callable[[], Any]) -> _Taken:
    begin = time.perf_counter(), time.process_time()
    work()
    return _Taken(time.perf_counter() - begin[0], time.process_time() - begin[1])


def _row(each: _Format, log: SimulatedLog, simulating: _Taken, folder: Path) -> list[str]:
    count = sum(frame.height for frame in log.topics.values())
    ours: list[_Taken] = []
    theirs: list[_Taken] = []
    for number in range(_ROUNDS):
        paths = [folder / f"{who}_{number}" for who in ("ours", "theirs")]
        theirs.append(_taken(lambda path=paths[1]: each.theirs(log, path)))
        ours.append(_taken(lambda path=paths[0]: each.ours(log, path)))
        if each.same and paths[0].read_bytes() != paths[1].read_bytes():
            raise SystemExit(f"{each.name}: the files differ")
        subprocess.run(["rm", "-r", *map(str, paths)], check=True)
    pairs = list(zip(ours, theirs, strict=True))
    clock = statistics.median(b.clock_s / a.clock_s for a, b in pairs)
    processor = statistics.median(b.processor_s / a.processor_s for a, b in pairs)
    whole = statistics.median(
        (b.clock_s + simulating.clock_s) / (a.clock_s + simulating.clock_s) for a, b in pairs
    )
    return [
        each.name,
        f"{count / statistics.median(a.clock_s for a in ours) / 1e6:.2f}",
        f"{count / statistics.median(b.clock_s for b in theirs) / 1e3:.0f}",
        f"{clock:.0f}×",
        f"{processor:.0f}×",
        "yes" if clock >= _TARGET else "no",
        f"{whole:.1f}×",
        "yes" if whole >= _WHOLE_TARGET else "no",
    ]


def _shift(hours: float, folder: Path) -> str:
    command = [
        str(Path(sys.executable).parent / "payscope"),
        "simulate",
        str(_EXAMPLE),
        "-o",
        str(folder / "shift.bag"),
        *("--set", f"shift.duration_h={hours}", "--set", "shift.logs=8"),
    ]
    begin = time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    seconds = time.perf_counter() - begin
    size_GB = sum(path.stat().st_size for path in folder.glob("*.bag")) / 1e9
    return (
        f"`payscope simulate examples/shift.toml` of {hours:g} hours in eight bags takes "
        f"{seconds:.0f} s and makes {size_GB:.1f} GB."
    )


def main(minutes: float = 20.0, shift_hours: float = 8.0, write: bool = False) -> None:
    """Measure, print, and perhaps write down."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        warm = _simulated(_scenario(0.02))
        for each in _FORMATS:
            each.ours(warm, folder / "warm")
            subprocess.run(["rm", "-r", str(folder / "warm")], check=True)
        scenario = _scenario(minutes / 60.0)
        simulating = min(_taken(lambda: _simulated(scenario)) for _ in range(_ROUNDS))
        log = _simulated(scenario)
        head = [
            "log",
            "ours M/s",
            "message by message k/s",
            "wall",
            "CPU",
            f"wall ≥ {_TARGET:.0f}×",
        ]
        head += ["simulated and written", f"≥ {_WHOLE_TARGET:.0f}×"]
        table = markdown(head, [_row(each, log, simulating, folder) for each in _FORMATS])
        text = f"{table}\n\n{_shift(shift_hours, folder)}"
    print(text)
    if write:
        put("speed.md", "writing", text)


if __name__ == "__main__":
    typer.run(main)
