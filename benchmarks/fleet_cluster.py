"""A fleet on a cluster of three nodes on this machine, of which a worker and a node are killed.

    python -P benchmarks/fleet_cluster.py [--recordings 300]

Every node listens on 127.0.0.1. When a third of the recordings is done, a worker that replays is
killed, when half is, a node with all its processes. Every result has to be there once, equal bit
for bit to that of a serial replay in this process.
"""

import argparse
import os
import signal
import sys
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import Any

# before Ray is imported: no node listens elsewhere
os.environ["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"] = "0"
os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
os.environ["RAY_DEDUP_LOGS"] = "0"

from benchmarks.fleet_logs import SerialEngine, recordings, same_results, told
from replay.fleet.log_sources import FleetLog, list_logs_of_sources
from replay.fleet.machine_setups import load_fleet
from replay.fleet.ray_engine import start_ray_engine
from replay.fleet.recording_task import TaskOutcome, replay_and_store_result
from replay.fleet.run_fleet import FleetRun, replay_logs_of_fleet

_WORKER = f"ray::{replay_and_store_result.__name__}".encode()
_WAIT_S = 60.0


class Killer:
    """Kills a worker, then a node, when so many recordings are done."""

    def __init__(self, cluster: Any, victim: Any, count: int) -> None:
        self._cluster, self._victim, self._count = cluster, victim, count
        self._done = 0
        self.killed: list[str] = []

    def done(self, _log: FleetLog, _outcome: TaskOutcome) -> None:
        """Count a recording, and kill what is due."""
        self._done += 1
        if len(self.killed) == 0 and self._done * 3 >= self._count:
            raylets = {n.all_processes["raylet"][0].process.pid for n in self._nodes()}
            pid = _worker_of(raylets)
            os.kill(pid, signal.SIGKILL)
            self.killed.append(f"worker {pid} after {self._done} recordings")
        elif len(self.killed) == 1 and self._done * 2 >= self._count:
            self._cluster.remove_node(self._victim, allow_graceful=False)
            self.killed.append(f"a node after {self._done} recordings")

    def _nodes(self) -> list[Any]:
        return [n for n in self._cluster.list_all_nodes() if n is not self._victim]


def _worker_of(raylets: set[int]) -> int:
    """A process of ours that replays a recording now."""
    end = time.monotonic() + _WAIT_S
    while time.monotonic() < end:
        for stat in Path("/proc").glob("[0-9]*/stat"):
            try:
                parent = int(stat.read_text().rpartition(")")[2].split()[1])
                if parent in raylets and (stat.parent / "cmdline").read_bytes().startswith(_WORKER):
                    return int(stat.parent.name)
            except OSError:
                continue
        time.sleep(0.01)
    raise SystemExit("no worker replays anything")


def on_cluster(logs: Path, fleet: Path, destination: Path, count: int) -> tuple[FleetRun, Killer]:
    """Replay on three nodes, and kill a worker and a node."""
    from ray.cluster_utils import Cluster

    here: dict[str, Any] = {
        "node_ip_address": "127.0.0.1",
        "num_cpus": 1,
        "include_dashboard": False,
        "object_store_memory": 100 * 2**20,
    }
    cluster = Cluster(initialize_head=True, head_node_args=here)
    try:
        nodes = [cluster.add_node(**here) for _ in range(2)]
        killer = Killer(cluster, nodes[-1], count)
        did = replay_logs_of_fleet(
            list_logs_of_sources([str(logs)]),
            load_fleet(fleet),
            str(destination),
            partial(start_ray_engine, cluster.address, None),
            killer.done,
        )
    finally:
        cluster.shutdown()
    return did, killer


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--recordings", type=int, default=300)
    count: int = parser.parse_args().recordings
    with tempfile.TemporaryDirectory(prefix="payscope-fleet-") as name:
        folder = Path(name)
        logs = recordings(folder, count)
        began = time.perf_counter()
        did, killer = on_cluster(logs, folder / "fleet.toml", folder / "cluster", count)
        took = time.perf_counter() - began
        told(f"killed: {', '.join(killer.killed)}")
        told(f"on the cluster: {did.replayed} replayed in {took:.0f} s, {len(did.failed)} failed")
        for source, why in did.failed.items():
            told(f"failed: {source}: {why}")
        began = time.perf_counter()
        fleet = load_fleet(folder / "fleet.toml")
        replay_logs_of_fleet(
            list_logs_of_sources([str(logs)]), fleet, str(folder / "serial"), SerialEngine
        )
        told(f"serially: {time.perf_counter() - began:.0f} s")
        there, differ = same_results(folder / "serial", folder / "cluster")
        told(f"{there} results of {count} recordings, {len(differ)} files differ")
        for each in differ[:10]:
            told(each)
    good = there == count and not differ and len(killer.killed) == 2 and not did.failed
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
