"""A large fleet's results: how long a query and the report take, and how large the page is.

    python -P benchmarks/fleet_size.py [--machines 50] [--days 200] [--in FOLDER]

The results are written as tasks write them (seven objects each), with drawn numbers: 100 to 110
cycles a recording, a recording a day and machine; some machines drift, some recordings cannot
weigh. The commands are then timed as a user starts them; with --in, what is there is used again.
"""

import argparse
import datetime as dt
import hashlib
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl

from analysis.model.schema import QUALITY
from benchmarks.fleet_logs import told
from replay.fleet.gathered_tables import FleetResults
from replay.fleet.last_run import LastRun, LastRunMachine, NamedFiles
from replay.fleet.object_store import ObjectStore
from replay.fleet.results_layout import ResultName, write_result_tables

_SEED: Final = 5
_FIRST: Final = dt.datetime(2025, 1, 6, 6, tzinfo=dt.UTC)
_NS: Final = 10**9
_PAYSCOPE: Final = Path(sys.executable).with_name("payscope")
_SQL: Final = (
    "SELECT machine, count(*) AS loads, sum(payload_kg) / 1000 AS tonnes, "
    "avg(haul_s) AS haul_s FROM cycles WHERE counted GROUP BY machine ORDER BY tonnes DESC"
)


def make(destination: Path, machines: int, days: int) -> None:
    """Write the results of so many machines and days."""
    store = ObjectStore(str(destination))
    for number in range(machines):
        draw = np.random.default_rng([_SEED, number])
        for day in range(days):
            _result(store, f"unit-{number + 1:02}", day, number, draw)
    results = FleetResults(store)
    machine = LastRunMachine(files=NamedFiles("cat262c.toml"), bases=("b",))
    names = [f"unit-{number + 1:02}" for number in range(machines)]
    results.store_last_run(LastRun(fleet="benchmark", machines=dict.fromkeys(names, machine)))
    results.update_gathered_tables()


def _result(
    store: ObjectStore, machine: str, day: int, number: int, draw: np.random.Generator
) -> None:
    at = _FIRST + dt.timedelta(days=day)
    name = ResultName(
        machine, str(at.date()), hashlib.sha256(f"{number} {day}".encode()).hexdigest()[:32]
    )
    # one machine in ten has a zero that creeps, one in ten a friction that grows
    zero_kg = 3600.0 + draw.normal(0.0, 10.0) + (0.4 * day if number % 10 == 3 else 0.0)
    wear = 1.0 + (day / 365.0 if number % 10 == 7 else 0.0)
    friction = 2900.0 * wear * np.exp(draw.normal(0.0, 0.03))
    count = int(draw.integers(100, 111))
    cycles = _cycles(count, zero_kg, draw)
    can_weigh = bool(draw.random() > 0.01)
    lost = int(draw.random() < 0.02)
    payload_kg = float(cycles["payload_kg"].sum())
    row: dict[str, Any] = {
        "source": f"s3://yard/{machine}/{at.date()}.mcap",
        "log_sha256": f"{number:032x}{day:032x}",
        "size_bytes": 600_000_000,
        "stamp": "1",
        "basis": "b",
        "payscope": "0.1.0",
        "status": "replayed",
        "reason": "",
        "can_weigh": can_weigh,
        "failed_checks": "" if can_weigh else "partial_correlation",
        "losses": lost,
        "first_loss": "a.mcap: breaks off after byte 1234, without a footer" if lost else "",
        "duration_s": 28_800.0,
        "gap_s": 12.0,
        "idle_s": 3_000.0,
        "longest_gap_at_s": 9_000.0,
        "accepted_1": 0.3,
        "cycles": count,
        "cycles_counted": count,
        "cycles_without_mass": 0,
        "payload_kg": payload_kg,
        "payload_u_random_kg": 150.0,
        "payload_u_common_kg": 0.01 * payload_kg,
        "payload_u_kg": float(np.hypot(150.0, 0.01 * payload_kg)),
        "lost_cycles": 0.0,
        "lost_kg": 0.0,
        "friction_x_N_s_m": float(friction),
        "friction_x_std_N_s_m": 10.0,
        "calibration": "",
        "not_calibrated_for": "",
        "results_fingerprint": "0" * 64,
        "made_unix_ns": int(at.timestamp()) * _NS,
    }
    frames = {
        "loads": pl.DataFrame(
            {
                "load_id": np.arange(2 * count),
                "mass_kg": draw.normal(4000.0, 300.0, 2 * count),
                "u_kg": np.full(2 * count, 40.0),
            }
        ),
        "segments": pl.DataFrame(
            {"segment_id": np.arange(4 * count), "mass_kg": draw.normal(4000.0, 300.0, 4 * count)}
        ),
        "cycles": cycles,
        "findings": pl.DataFrame({"cause": ["drift"], "severity": ["tell"], "rank": [1]}),
        "gate_shares": pl.DataFrame(
            {"reason": ["accepted", "standstill", "braking"], "share_1": [0.3, 0.5, 0.2]}
        ),
        "quality": pl.DataFrame({"topic": ["/imu/data"], "messages": [2_880_000]}),
    }
    write_result_tables(store, name, int(at.timestamp()) * _NS, frames, row)


def _cycles(count: int, zero_kg: float, draw: np.random.Generator) -> pl.DataFrame:
    begins = np.sort(draw.uniform(0.0, 28_000.0, count)) * _NS
    payload = draw.normal(700.0, 80.0, count)
    times = {name: draw.uniform(5.0, 60.0, count) for name in ("return_s", "load_s", "haul_s")}
    empty = draw.normal(zero_kg, 20.0, count)
    return pl.DataFrame(
        {
            "cycle": np.arange(1, count + 1),
            "start_t_ns": begins.astype(np.int64),
            "end_t_ns": begins.astype(np.int64) + 100 * _NS,
            **times,
            "dump_s": draw.uniform(5.0, 15.0, count),
            "manoeuvres": np.full(count, 2),
            "loaded_kg": empty + payload,
            "loaded_u_kg": np.full(count, 15.0),
            "empty_after_kg": empty,
            "empty_after_u_kg": np.full(count, 15.0),
            "payload_kg": payload,
            "payload_u_random_kg": np.full(count, 20.0),
            "payload_u_common_kg": 0.01 * payload,
            "payload_u_shared_kg": 0.01 * payload,
            "payload_u_kg": np.full(count, 21.0),
            "carry_back_kg": draw.uniform(0.0, 30.0, count),
            "quality": pl.Series(["good"] * count, dtype=QUALITY),
            "counted": np.ones(count, dtype=bool),
        }
    )


def timed(*words: object) -> tuple[float, str]:
    """Seconds that a command takes, and what it says."""
    began = time.perf_counter()
    left = subprocess.run(
        [_PAYSCOPE, "fleet", *map(str, words)], capture_output=True, text=True, check=True
    )
    return time.perf_counter() - began, left.stdout


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--machines", type=int, default=50)
    parser.add_argument("--days", type=int, default=200)
    parser.add_argument("--in", dest="folder", type=Path)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="payscope-fleet-") as name:
        folder: Path = asked.folder or Path(name)
        results, page = folder / "results", folder / "fleet.html"
        if not results.exists():
            began = time.perf_counter()
            make(results, asked.machines, asked.days)
            told(f"written and gathered in {time.perf_counter() - began:.0f} s")
        _, counted = timed("query", results, "SELECT count(*) AS n FROM cycles", "--format", "csv")
        query_s = min(timed("query", results, _SQL)[0] for _ in range(3))
        report_s, _ = timed("report", results, "-o", page, "--force")
        size = page.stat().st_size / 1e6
        told(f"{counted.split()[-1]} cycles: query {query_s:.2f} s, report {report_s:.2f} s")
        told(f"page {size:.2f} MB")
    return 0 if query_s <= 2.0 and report_s <= 20.0 and size <= 3.0 else 1


if __name__ == "__main__":
    sys.exit(main())
