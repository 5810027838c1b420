"""Recordings for the benchmarks of a fleet: one start each, with different loads."""

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from analysis.fleet.fleet_tables import TABLES
from analysis.simulation import Scenario
from replay.fleet.gathered_tables import FleetResults
from replay.fleet.ray_engine import Result, Task, TaskWithMemory
from replay.fleet.results_layout import MARK
from replay.simulation.simulate_logs import simulate_scenario_to_logs

FLEET = """
[fleet]
name = "benchmark"

[[machines]]
logs = "{machine}/*.mcap"
file = "cat262c.toml"
"""


def recordings(folder: Path, count: int, machines: int = 3) -> Path:
    """Write so many logs of 11 s and a fleet file; the folder of the logs."""
    logs = folder / "logs"
    for number in range(count):
        home = logs / f"unit-{number % machines + 1:02}"
        home.mkdir(parents=True, exist_ok=True)
        content: dict[str, Any] = {
            "campaign": {"loads_kg": [50.0 * (number % 6)], "runs": 1},
            "sensors": {"seed": number + 1},
        }
        simulate_scenario_to_logs(Scenario.model_validate(content), home / f"log_{number:05}.mcap")
    (folder / "fleet.toml").write_text(FLEET, encoding="utf-8")
    return logs


class SerialEngine:
    """One task after the other, in this process: what an engine is compared with."""

    def __enter__(self) -> "SerialEngine":
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def count_parallel_slots(self) -> int:
        """One."""
        return 1

    def run_tasks(
        self, function: Any, work: Sequence[TaskWithMemory[Task]]
    ) -> Iterator[tuple[Task, Result]]:
        """Run them in their order."""
        for each in work:
            yield each.task, function(each.task)


def same_results(a: Path, b: Path, apart: Sequence[str] = ()) -> tuple[int, list[str]]:
    """How many results B has, and what differs: a file that one lacks, or other bytes.

    Of table `results`, the time when it was made is not compared, nor columns `apart`.
    """
    import polars as pl

    files = [{p.relative_to(x) for t in TABLES for p in (x / t).rglob("*.parquet")} for x in (a, b)]
    differ = [f"only in one: {each}" for each in sorted(files[0] ^ files[1])]
    for name in sorted(files[0] & files[1]):
        if name.parts[0] == MARK:
            frames = [pl.read_parquet(x / name).drop("made_unix_ns", *apart) for x in (a, b)]
            if not frames[0].equals(frames[1], null_equal=True):
                differ.append(f"other row: {name}")
        elif (a / name).read_bytes() != (b / name).read_bytes():
            differ.append(f"other bytes: {name}")
    from replay.fleet.object_store import ObjectStore

    names = FleetResults(ObjectStore(str(b))).result_names_by_machine
    return sum(map(len, names.values())), differ


def told(line: str) -> None:
    """Print a line at once."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()
