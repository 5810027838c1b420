"""Two workers against one on this machine, and what a recording costs besides its replay.

    python -P benchmarks/fleet_speed.py [--recordings 120] [--write]

One node, local disk, one thread a task. Rates are taken once every worker has replayed two, so
that what a worker loads once is not in them. The engine's overhead is the time that a slot is not
in our function; ours is hashing, opening, summing up and writing, which the replay itself is not.
A machine that does other work at the time shows it in these figures; the load is printed, and the
efficiency by processor time, which other work hardly changes, stands beside that by the clock.
"""

import argparse
import os
import sys
import tempfile
import time
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Final

from benchmarks.fleet_logs import recordings, told
from benchmarks.page import markdown, put
from replay.fleet.last_run import TaskLimits
from replay.fleet.log_sources import FleetLog, list_logs_of_sources
from replay.fleet.machine_setups import load_fleet
from replay.fleet.ray_engine import start_ray_engine
from replay.fleet.recording_task import TaskOutcome
from replay.fleet.run_fleet import replay_logs_of_fleet

#: A fleet to reckon with: recordings, nodes, and what a node has.
_FLEET: Final = 100_000
_NODES: Final = 100
_CORES: Final = 16
_NODE_GIB: Final = 64.0
#: A recorded shift of eight hours: its bags, and the seconds of its replay (`make shift-speed`).
_SHIFT_GB: Final = 4.6
_SHIFT_S: Final = 182.0
#: Objects of a result, and the seconds that one takes from object storage, 16 at once.
_OBJECTS: Final = 7
_FETCH_S: Final = 0.03 / 16
#: Recordings of each worker before its rate counts.
_WARM: Final = 2
_LEAST: Final = 0.85
_MOST_S: Final = 0.1


@dataclass
class Watched:
    """When each recording was done, and what it cost on its node."""

    slots: int
    at: list[float] = field(default_factory=list)
    replay: list[float] = field(default_factory=list)
    ours: list[float] = field(default_factory=list)
    processor: list[float] = field(default_factory=list)

    def done(self, _log: FleetLog, outcome: TaskOutcome) -> None:
        """Take the time."""
        self.at.append(time.perf_counter())
        self.replay.append(outcome.seconds)
        self.ours.append(outcome.overhead_s)
        self.processor.append(outcome.processor_s)

    @property
    def rate(self) -> float:
        """Recordings a second, of warm workers."""
        first = _WARM * self.slots
        return (len(self.at) - 1 - first) / (self.at[-1] - self.at[first])

    @property
    def processor_s(self) -> float:
        """Processor time of a recording, of warm workers: without what others do at the time."""
        kept = self.processor[_WARM * self.slots + 1 :]
        return sum(kept) / len(kept)

    @property
    def means(self) -> tuple[float, float, float]:
        """Seconds of a recording: its replay, what is ours besides, what is the engine's."""
        first = _WARM * self.slots + 1
        replay, ours = (sum(x[first:]) / len(x[first:]) for x in (self.replay, self.ours))
        return replay, ours, self.slots / self.rate - replay - ours


def watched(folder: Path, workers: int, run: int) -> Watched:
    """Replay all with so many workers."""
    found = Watched(workers)
    replay_logs_of_fleet(
        list_logs_of_sources([str(folder / "logs")]),
        load_fleet(folder / "fleet.toml"),
        str(folder / f"results_{workers}_{run}"),
        partial(start_ray_engine, None, workers),
        found.done,
    )
    return found


def scaled(ours_s: float, engine_s: float) -> list[list[str]]:
    """A large fleet from these figures, step by step."""
    task_gib = TaskLimits().compute_memory_bytes_for_log(int(_SHIFT_GB * 1e9)) / 2**30
    by_memory = int(_NODE_GIB / task_gib)
    slots = _NODES * min(by_memory, _CORES)
    task_s = _SHIFT_S + ours_s + engine_s
    hours = _FLEET * task_s / slots / 3600.0
    a_second = slots / task_s
    read = _SHIFT_GB * 8.0 * a_second / _NODES
    gather_h = _FLEET * _OBJECTS * _FETCH_S / 3600.0
    return [
        ["memory that a recording declares", f"{task_gib:.1f} GiB"],
        [f"recordings at once on a node of {_CORES} cores, {_NODE_GIB:.0f} GiB", f"{by_memory}"],
        [f"recordings at once on {_NODES} nodes", f"{slots}"],
        [f"time for {_FLEET:,} recordings", f"{hours:.1f} h"],
        [
            f"the same, if all {_CORES} cores had the memory",
            f"{hours * slots / _NODES / _CORES:.1f} h",
        ],
        ["what a node reads meanwhile", f"{read:.2f} Gbit/s"],
        ["recordings a second, all nodes together", f"{a_second:.1f}"],
        [
            "what one command can hand out, by the engine's overhead",
            f"{1.0 / engine_s:.0f} a second",
        ],
        [f"gathering {_FLEET * _OBJECTS:,} objects at the end, once", f"{gather_h:.1f} h"],
    ]


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--recordings", type=int, default=120)
    parser.add_argument("--write", action="store_true")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="payscope-fleet-") as name:
        folder = Path(name)
        recordings(folder, asked.recordings)
        one, two = (watched(folder, workers, 0) for workers in (1, 2))
    efficiency = two.rate / (2.0 * one.rate)
    replay, ours, engine = one.means
    rows = [
        ["efficiency of two workers against one", f"{efficiency:.2f}", f"≥ {_LEAST}"],
        [
            "the same by processor time a recording",
            f"{one.processor_s / two.processor_s:.2f}",
            "",
        ],
        ["replay of a recording (11 s of log)", f"{1e3 * replay:.0f} ms", ""],
        ["ours beside it: hash, open, sum up, write", f"{1e3 * ours:.0f} ms", ""],
        [
            "the engine's overhead a recording",
            f"{1e3 * engine:.0f} ms",
            f"≤ {1e3 * _MOST_S:.0f} ms",
        ],
        ["load of the machine at the end", f"{os.getloadavg()[0]:.1f} of {os.cpu_count()}", ""],
    ]
    said = markdown(["what", "measured", "asked"], rows)
    told(said)
    large = markdown(["step", "figure"], scaled(ours, engine))
    told(large)
    if asked.write:
        put("fleet.md", "speed of a fleet", said)
        put("fleet.md", "a large fleet", large)
    return 0 if efficiency >= _LEAST and engine <= _MOST_S else 1


if __name__ == "__main__":
    sys.exit(main())
