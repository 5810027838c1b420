"""The engine on a cluster of three nodes here: what survives, what is given up and why."""

import subprocess
import sys
from pathlib import Path

import pytest

from estimators.errors import FleetError
from replay.fleet.ray_engine import start_ray_engine
from tests.one_line import assert_one_line

REPO = Path(__file__).resolve().parents[3]


@pytest.mark.slow
def test_of_a_fleet_with_a_worker_and_a_node_killed_every_result_is_there_bit_for_bit() -> None:
    """In a process of its own, which Ray fills with threads; `make fleet` does it with 300."""
    said = run([sys.executable, "-P", "benchmarks/fleet_cluster.py", "--recordings", "30"])
    assert "30 results of 30 recordings, 0 files differ" in said
    assert said.startswith("killed: worker ")


#: Tasks small enough that nothing but the engine takes time.
ENGINE = """
import os, signal, sys, time

os.environ["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"] = "0"
os.environ["RAY_USAGE_STATS_ENABLED"] = os.environ["RAY_DEDUP_LOGS"] = "0"
import ray
from ray.cluster_utils import Cluster

from replay.fleet.ray_engine import LostTask, TaskWithMemory
from replay.fleet.ray_engine import start_ray_engine

def work(what):
    if what == "die":
        os._exit(1)
    if what == "raise":
        raise ValueError("a fault of ours")
    if what == "threads":
        return [os.environ[n] for n in ("OPENBLAS_NUM_THREADS", "POLARS_MAX_THREADS")]
    time.sleep(0.2)
    return os.getpid()

node = {"node_ip_address": "127.0.0.1", "num_cpus": 1, "include_dashboard": False,
        "object_store_memory": 100 * 2**20}
cluster = Cluster(initialize_head=True, head_node_args=node)
victim = [cluster.add_node(**node) for _ in range(2)][-1]
done = {}
with start_ray_engine(cluster.address, None) as engine:
    assert engine.count_parallel_slots() == 3
    assert {n["NodeManagerAddress"] for n in ray.nodes()} == {"127.0.0.1"}
    tasks = [*range(40), "die", "raise", "threads"]
    asked = [TaskWithMemory("large", 1 << 50), *(TaskWithMemory(task, 1 << 20) for task in tasks)]
    for task, result in engine.run_tasks(work, asked):
        assert task not in done
        done[task] = result
        if len(done) == 8:
            os.kill(result, signal.SIGKILL)
        elif len(done) == 16:
            cluster.remove_node(victim, allow_graceful=False)
            print("killed both")
cluster.shutdown()
assert all(isinstance(done[number], int) for number in range(40))
for name in ("die", "large", "raise", "threads"):
    print(name, done[name].reason if isinstance(done[name], LostTask) else done[name])
"""


@pytest.mark.heavy
def test_nodes_and_workers_may_die_and_what_is_given_up_has_its_reason() -> None:
    first, *said = run([sys.executable, "-c", ENGINE]).splitlines()
    assert first == "killed both"
    assert said[0].startswith("die its worker ended 4 times without a message")
    assert said[1].startswith("large declares 1048576.0 GiB of memory, and the largest node has")
    assert said[2:] == ["raise ValueError: a fault of ours", "threads ['1', '1']"]


def run(words: list[str]) -> str:
    """In a process of its own, which Ray fills with threads; what it prints."""
    left = subprocess.run(words, capture_output=True, text=True, cwd=REPO, check=False, timeout=500)
    assert left.returncode == 0, left.stdout[-2000:] + left.stderr[-2000:]
    return left.stdout


def test_a_cluster_that_does_not_answer_is_said_in_one_line() -> None:
    for address, part in (("127.0.0.1:1", "no cluster answers"), ("there", "host:port")):
        with pytest.raises(FleetError, match=part) as fault, start_ray_engine(address, None):
            pass
        assert_one_line(fault.value)
