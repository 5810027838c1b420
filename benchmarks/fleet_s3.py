"""A fleet in object storage: a real server of S3 on loopback, stopped in the middle of a run.

    python -P benchmarks/fleet_s3.py [--recordings 60]

Logs and results lie in a bucket of `rclone serve s3`. A run is made, the server ended half-way and
started again some seconds later; then the same run again, which must change nothing; then a query,
and every result compared bit for bit with those of the same logs in folders.
"""

import argparse
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.fleet_logs import SerialEngine, recordings, same_results, told
from replay.fleet.gathered_tables import open_results_of_fleet, query_fleet_tables
from replay.fleet.log_sources import FleetLog, list_logs_of_sources
from replay.fleet.machine_setups import load_fleet
from replay.fleet.ray_engine import start_ray_engine
from replay.fleet.recording_task import TaskOutcome
from replay.fleet.run_fleet import replay_logs_of_fleet

#: Shorter keys are refused by the server.
_ID, _SECRET = "payscope-benchmark-access-key", "payscope-benchmark-secret-access-key"
_WAIT_S = 30.0


class Server:
    """`rclone serve s3` of a folder, whose folders are buckets."""

    def __init__(self, folder: Path) -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self._port: int = probe.getsockname()[1]
        self._folder = folder
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def environment(self) -> dict[str, str]:
        """What a client needs."""
        return {
            "AWS_ENDPOINT_URL": f"http://127.0.0.1:{self._port}",
            "AWS_ACCESS_KEY_ID": _ID,
            "AWS_SECRET_ACCESS_KEY": _SECRET,
            "AWS_REGION": "us-east-1",
        }

    def start(self) -> None:
        """Start it, and wait until it listens."""
        self._process = subprocess.Popen(
            [
                Path(sys.executable).with_name("rclone"),
                *("serve", "s3", "--addr", f"127.0.0.1:{self._port}"),
                *("--auth-key", f"{_ID},{_SECRET}", self._folder),
            ],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        end = time.monotonic() + _WAIT_S
        while time.monotonic() < end:
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", self._port)) == 0:
                    return
            time.sleep(0.05)
        raise SystemExit("rclone does not listen")

    def stop(self) -> None:
        """End it at once."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()


def checked(
    folder: Path, bucket: str, count: int, away_s: float, engine: Callable[[], Any]
) -> list[str]:
    """Run, stop and start, run again, query, compare; what is wrong.

    Args:
        folder: for everything.
        bucket: name of the bucket.
        count: recordings.
        away_s: for which the server is away.
        engine: opens one.
    """
    logs = recordings(folder, count)
    home = folder / "served" / bucket
    home.mkdir(parents=True)
    shutil.copytree(logs, home / "logs")
    server = Server(folder / "served")
    os.environ.update(server.environment)
    server.start()
    done = 0
    back: list[threading.Timer] = []

    def on_done(_log: FleetLog, _outcome: TaskOutcome) -> None:
        nonlocal done
        done += 1
        if done == count // 2:
            server.stop()
            back.append(threading.Timer(away_s, server.start))
            back[0].start()

    fleet = load_fleet(folder / "fleet.toml")
    place = f"s3://{bucket}/results"
    try:
        source = list_logs_of_sources([f"s3://{bucket}/logs"])
        did = replay_logs_of_fleet(source, fleet, place, engine, on_done)
        for each in back:
            each.join()
        before = _listed(home)
        again = replay_logs_of_fleet(
            list_logs_of_sources([f"s3://{bucket}/logs/*/*.mcap"]), fleet, place, engine
        )
        sql = "SELECT machine, count(*) AS number FROM results GROUP BY machine"
        asked = query_fleet_tables(open_results_of_fleet(place), sql)
    finally:
        server.stop()
    replay_logs_of_fleet(
        list_logs_of_sources([str(logs)]), fleet, str(folder / "beside"), SerialEngine
    )
    there, differ = _same(folder / "beside", home / "results")
    wrong = [f"failed: {source}: {why}" for source, why in did.failed.items()]
    wrong += [] if did.replayed == count else [f"{did.replayed} replayed of {count}"]
    wrong += (
        []
        if again.up_to_date == count
        else [f"the second run has {again.up_to_date} there of {count}"]
    )
    wrong += [] if _listed(home) == before else ["the second run changed something"]
    wrong += [] if asked["number"].sum() == count else [f"the query counts {asked['number'].sum()}"]
    wrong += [] if there == count else [f"{there} results of {count}"]
    wrong += [] if len(back) == 1 else ["the server was never away"]
    return wrong + differ


def _same(beside: Path, served: Path) -> tuple[int, list[str]]:
    """As `same_results`, where sources and stamps differ, of storage and of files."""
    return same_results(beside, served, ("source", "stamp"))


def _listed(folder: Path) -> dict[str, tuple[int, bytes]]:
    return {
        str(path): (path.stat().st_mtime_ns, path.read_bytes())
        for path in folder.rglob("*")
        if path.is_file()
    }


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--recordings", type=int, default=60)
    count: int = parser.parse_args().recordings
    with tempfile.TemporaryDirectory(prefix="payscope-fleet-") as name:
        began = time.perf_counter()
        wrong = checked(Path(name), "benchmark", count, 8.0, partial(start_ray_engine, None, 2))
        told(f"{count} recordings in {time.perf_counter() - began:.0f} s, {len(wrong)} faults")
        for each in wrong[:10]:
            told(each)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
