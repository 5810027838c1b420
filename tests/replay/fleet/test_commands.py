"""`payscope fleet` as a user calls it; the engine is Ray in `test_ray.py`, here it is none."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from benchmarks.fleet_logs import SerialEngine
from replay.fleet import ray_engine as module
from tests.replay.sledge import Payscope, join_to_one_line
from tests.twins import mark_heavy_after

SQL = "SELECT machine, count(*) AS n FROM loads GROUP BY machine"


@pytest.fixture
def serial(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "start_ray_engine", lambda *_: SerialEngine())


@pytest.mark.heavy
@pytest.mark.usefixtures("serial", "kept_replays")
def test_run_again_query_report_compare_open(
    payscope: Payscope, fleet_folder: Path, tmp_path: Path
) -> None:
    logs, fleet = fleet_folder / "logs/unit-02", fleet_folder / "fleet.toml"
    results = tmp_path / "results"
    said = payscope("fleet", "run", logs, "-m", fleet, "-o", results)
    assert said.out.startswith("2 recordings: 2 replayed, 0 up to date, 0 refused")
    assert (said.status, said.err) == (0, "")
    again = payscope("fleet", "run", f"{logs}/*.mcap", "-m", fleet, "-o", results, "--json")
    assert json.loads(again.out)["there"] == 2

    asked = payscope("fleet", "query", results, SQL, "--format", "csv")
    assert asked.out == "machine,n\nunit-02,2\n"
    page = tmp_path / "fleet.html"
    report = payscope("fleet", "report", results, "-o", page)
    assert "No tonnes" in report.out
    assert page.exists()
    join_to_one_line(payscope("fleet", "report", results, "-o", page), "exists already")

    same = payscope("fleet", "compare", results, results)
    assert (same.status, same.err) == (0, "")
    assert "+0.000 t (no tonnes in A), by 0 of 2 recordings" in same.out
    other = payscope(
        "fleet", "compare", results, "--set", "settings.gate.threshold_nat=0.9", "--json"
    )
    assert json.loads(other.out)["sum"]["logs"] == 2
    # beside the results, which it does not change
    assert payscope("fleet", "query", results, SQL, "--format", "csv").out == asked.out

    key = payscope("fleet", "query", results, "SELECT key FROM results", "--format", "csv")
    rrd = tmp_path / "one.rrd"
    opened = payscope("fleet", "open", results, key.out.split()[1][:12], "-o", rrd)
    assert opened.status == 0
    assert "loads" in payscope("show", rrd).out


@pytest.mark.heavy
@pytest.mark.usefixtures("serial", "kept_replays")
def test_a_run_with_a_recording_that_has_no_result_leaves_with_1(
    payscope: Payscope, fleet_folder: Path, tmp_path: Path
) -> None:
    (tmp_path / "fleet.toml").write_text(
        '[[machines]]\nlogs = "nowhere/*.mcap"\nname = "x"\nfile = "cat262c.toml"\n'
    )
    log = fleet_folder / "logs/unit-01/log_00000.mcap"
    said = payscope("fleet", "run", log, "-m", tmp_path / "fleet.toml", "-o", tmp_path / "out")
    assert said.status == 1
    assert "without a result: " in said.out
    assert "no rule in" in said.out


@pytest.mark.heavy
@pytest.mark.parametrize(
    ("words", "part"),
    [
        (["run", "nowhere", "-m", "FLEET", "-o", "out"], "contains no log"),
        (["run", "LOGS", "-m", "nowhere.toml", "-o", "out"], "no such fleet file"),
        (["run", "LOGS", "-m", "FLEET", "-o", "out", "--set", "settings.gate.x=1"], "unknown key"),
        (["query", "nowhere", SQL], "no such folder"),
        (["query", "KEPT", "SELECT 1 FROM nothing"], "no table 'nothing'"),
        (["report", "nowhere", "-o", "x.html"], "no such folder"),
        (["compare", "KEPT"], "give either other results (B) or other settings"),
        (["compare", "KEPT", "KEPT", "--from", "monday"], "is not a date"),
        (["compare", "KEPT", "KEPT", "--from", "2030-01-01"], "no log in common"),
        (["open", "KEPT", "zzz"], "no result begins with 'zzz'"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(
    payscope: Payscope,
    fleet_folder: Path,
    kept: Path,
    words: list[str],
    part: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    named: dict[str, Any] = {
        "LOGS": fleet_folder / "logs",
        "FLEET": fleet_folder / "fleet.toml",
        "KEPT": kept,
    }
    said = payscope("fleet", *(named.get(word, word) for word in words))
    if part == "unknown key":
        # of every log, which are listed
        assert said.status == 1
        assert part in said.out
    else:
        join_to_one_line(said, part)


WITHOUT = """
import importlib.util, sys
found = importlib.util.find_spec
importlib.util.find_spec = lambda name, *a: None if name in ("ray", "obstore") else found(name, *a)
sys.argv = ["payscope", *sys.argv[1:]]
from replay.commands.cli import main
main()
"""


@pytest.mark.parametrize(
    "words",
    mark_heavy_after(
        1, [[], ["query", "x", "y"], ["run", "x", "-m", "y", "-o", "z"], ["report", "x", "-o", "y"]]
    ),
)
def test_without_the_extra_it_says_in_one_line_what_to_install(words: list[str]) -> None:
    left = subprocess.run(
        [sys.executable, "-c", WITHOUT, "fleet", *words],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (left.returncode, left.stdout) == (2, "")
    assert left.stderr == ("payscope: fleet: ray is not installed; pip install 'payscope[fleet]'\n")


@pytest.mark.heavy
def test_nothing_but_a_fleets_run_imports_ray() -> None:
    code = (
        "import sys, replay.commands.cli, replay.fleet.gathered_tables\n"
        "import replay.fleet.write_fleet_page, replay.fleet.compare_results\n"
        "import replay.fleet.run_fleet, replay.fleet.recording_task, replay.fleet.ray_engine\n"
        "print([name for name in ('ray', 'obstore') if name in sys.modules])"
    )
    left = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert left.stdout.strip() == "[]"
