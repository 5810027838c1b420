"""Two workers against one on this machine, and what a recording costs besides its replay.

    python -P benchmarks/fleet_speed.py [--recordings 120] [--write]

One node, local disk, one thread a task. Rates are taken once every worker has replayed two, so
that what a worker loads once is not in them. The engine's overhead is the time that a slot is not
in our function; ours is hashing, opening, summing up and writing, which the replay itself is not.
A machine that does other work at the time shows it in these figures; the load is printed.
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
from replay.fleet.fleet_file import load_fleet
from replay.fleet.ray_engine import ray_engine
from replay.fleet.run import fleet_run
from replay.fleet.sources import FleetLog, fleet_logs
from replay.fleet.task import Outcome

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

    def done(self, _log: FleetLog, outcome: Outcome) -> None:
        """Take the time."""
        self.at.append(time.perf_counter())
        self.replay.append(outcome.seconds)
        self.ours.append(outcome.overhead_s)

    @property
    def rate(self) -> float:
        """Recordings a second, of warm workers."""
        first = _WARM * self.slots
        return (len(self.at) - 1 - first) / (self.at[-1] - self.at[first])

    @property
    def means(self) -> tuple[float, float, float]:
        """Seconds of a recording: its replay, what is ours besides, what is the engine's."""
        first = _WARM * self.slots + 1
        replay, ours = (sum(x[first:]) / len(x[first:]) for x in (self.replay, self.ours))
        return replay, ours, self.slots / self.rate - replay - ours


def watched(folder: Path, workers: int, run: int) -> Watched:
    """Replay all with so many workers."""
    found = Watched(workers)
    fleet_run(
        fleet_logs([str(folder / "logs")]),
        load_fleet(folder / "fleet.toml"),
        str(folder / f"results_{workers}_{run}"),
        partial(ray_engine, None, workers),
        found.done,
    )
    return found


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
    if asked.write:
        put("fleet.md", "speed of a fleet", said)
    return 0 if efficiency >= _LEAST and engine <= _MOST_S else 1


if __name__ == "__main__":
    sys.exit(main())
