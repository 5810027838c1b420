"""`payscope run` prints and stores the fingerprint of a run, the same on any number of threads."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from recordings import read_recording
from tests.replay.sledge import Payscope, sledge

#: Long enough that every method works on more than one thread where there are two.
LONG_S = 1400.0
ALL_METHODS = 'settings.trace.methods=["ls", "rls", "fgls", "tls", "rtls", "huber", "pooled"]'
THREADS = ("NUMBA_NUM_THREADS", "POLARS_MAX_THREADS", "OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")


@pytest.mark.heavy
def test_one_line_shows_it_and_json_and_recording_hold_it_whole(
    payscope: Payscope, log: Path, machine_file: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out.rrd"
    said = payscope("run", log, "-m", machine_file, "-o", out, "-v")
    (line,) = [line for line in said.out.splitlines() if line.startswith("fingerprint: ")]
    kept = read_recording(out)
    taken = kept.provenance.fingerprint
    assert taken is not None
    assert line == f"fingerprint: {taken}"
    assert kept.with_fingerprint() == kept
    assert list(taken.frames) == list(kept.frames)
    answer = json.loads(payscope("run", log, "-m", machine_file, "--json").out)
    assert answer["fingerprint"] == {
        "inputs": taken.inputs,
        "settings": taken.settings,
        "results": taken.results,
    }


@pytest.mark.heavy
def test_another_setting_and_another_name_of_the_log_change_what_they_should(
    payscope: Payscope, log: Path, machine_file: Path
) -> None:
    def taken(*words: object) -> dict[str, str]:
        return json.loads(payscope("run", *words, "-m", machine_file, "--json").out)["fingerprint"]

    first = taken(log)
    renamed = log.with_name("renamed.csv")
    renamed.write_bytes(log.read_bytes())
    assert taken(renamed) == first
    other = taken(log, "--set", "settings.gate.threshold_nat=0.9")
    assert [name for name in first if first[name] != other[name]] == ["settings", "results"]


@pytest.mark.heavy
@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="one core has one thread")
def test_one_thread_and_two_give_the_same_fingerprint(machine_file: Path, tmp_path: Path) -> None:
    log = tmp_path / "long.csv"
    sledge(seconds=LONG_S).write_csv(log)
    script = Path(sys.executable).with_name("payscope")
    command = [script, "run", log, "-m", machine_file, "--json", "--set", ALL_METHODS]
    taken = [
        json.loads(
            subprocess.run(
                command,
                capture_output=True,
                text=True,
                check=False,  # whether such a log can weigh is not asked
                env={**os.environ, **dict.fromkeys(THREADS, threads)},
            ).stdout
        )["fingerprint"]
        for threads in ("1", "2")
    ]
    assert taken[0] == taken[1]
