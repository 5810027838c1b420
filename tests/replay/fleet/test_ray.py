"""The engine on a cluster of three nodes here: what survives, what is given up, what is declared."""

import subprocess
import sys
from pathlib import Path

import pytest

REPO = Path(__file__).resolve().parents[3]


def test_a_worker_and_a_node_are_killed_and_every_result_is_there_once_bit_for_bit() -> None:
    """In a process of its own, which Ray fills with threads; `make fleet` does it with 300."""
    left = subprocess.run(
        [sys.executable, "-P", "benchmarks/fleet_cluster.py", "--recordings", "12"],
        capture_output=True,
        text=True,
        cwd=REPO,
        check=False,
        timeout=240,
    )
    assert left.returncode == 0, left.stdout[-3000:] + left.stderr[-3000:]
    assert "12 results of 12 recordings, 0 files differ" in left.stdout
    assert left.stdout.startswith("killed: worker ")
    assert "raylet" not in left.stdout


ENGINE = """
import os, sys, time
from replay.fleet.engine import Lost, Work
from replay.fleet.ray_engine import ray_engine

def work(what):
    if what == "die":
        os._exit(1)
    if what == "raise":
        raise ValueError("a fault of ours")
    if what == "threads":
        return [os.environ[n] for n in ("OPENBLAS_NUM_THREADS", "POLARS_MAX_THREADS")]
    return what

with ray_engine(None, 1) as engine:
    asked = [Work(w, 1 << 20) for w in ("die", "raise", "threads", "plain")] + [Work("large", 1 << 50)]
    found = dict(engine.run(work, asked))
    assert engine.slots() == 1
    import ray
    assert {n["NodeManagerAddress"] for n in ray.nodes()} == {"127.0.0.1"}
    print("printed")
for name in sorted(found):
    said = found[name]
    print(name, said.reason if isinstance(said, Lost) else said)
"""


def test_what_dies_raises_or_fits_no_node_is_given_up_with_the_reason() -> None:
    left = subprocess.run(
        [sys.executable, "-c", ENGINE],
        capture_output=True,
        text=True,
        cwd=REPO,
        check=False,
        timeout=240,
    )
    assert left.returncode == 0, left.stderr[-3000:]
    printed, *said = left.stdout.splitlines()
    assert printed == "printed"
    assert said[0].startswith("die its worker ended 4 times without a word")
    assert said[1].startswith("large declares 1048576.0 GiB of memory, and the largest node has")
    assert said[2:] == ["plain plain", "raise ValueError: a fault of ours", "threads ['1', '1']"]
    assert left.stderr == ""


@pytest.mark.parametrize("address", ["127.0.0.1:1"])
def test_a_cluster_that_does_not_answer_is_said_in_one_line(address: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("time_s\n0\n")
    (tmp_path / "f.toml").write_text(
        '[[machines]]\nlogs = "*.csv"\nname = "one"\nfile = "cat262c.toml"\n'
    )
    left = subprocess.run(
        [
            *(Path(sys.executable).with_name("payscope"), "fleet", "run", tmp_path),
            *("-m", tmp_path / "f.toml", "-o", tmp_path / "out", "--address", address),
        ],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert left.returncode == 2, left.stderr
    assert left.stdout == ""
    assert left.stderr.count("\n") == 1
    assert f"--address {address}: no cluster answers" in left.stderr
