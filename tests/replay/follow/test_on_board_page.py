"""The example of docs/on-board.md runs as it is written, and reports say what they are worth."""

import json
import os
import pty
import re
import shutil
import subprocess
import sys
import threading
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from analysis.online.online_report import (
    OnlineReport,
    PooledEstimate,
    judge_mass_validity,
    judge_spin_validity,
)
from analysis.simulation import Scenario
from estimators.estimate import Estimate
from replay import load_machine, open_log
from replay.follow.report_file import ReportFile
from replay.simulation.simulate_logs import simulate_scenario_to_logs
from tests.one_line import assert_one_line
from tests.replay.follow.test_killed_follower import printed_reports
from tests.replay.sledge import Payscope

REPO = Path(__file__).resolve().parents[3]
#: Of replays in the background nothing is said here; `test_background_replay.py` does.
ALONE = ("--replay-share", "0")
STARTS = {
    runs: Scenario.model_validate({"campaign": {"loads_kg": [150], "runs": runs}})
    for runs in (1, 2)
}


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    """A drive of one start, and of two."""
    folder = tmp_path_factory.mktemp("bags")
    return {
        runs: simulate_scenario_to_logs(scenario, folder / f"{runs}.bag")[0]
        for runs, scenario in STARTS.items()
    }


def lay_out(bag: Path, folder: Path) -> None:
    folder.mkdir()
    shutil.copy(bag, folder / "campaign_150kg.bag")
    shutil.copy(REPO / "replay/machines/cat262c.toml", folder)


@pytest.fixture
def demo(bags: dict[int, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What the page calls `demo`, smaller."""
    lay_out(bags[2], tmp_path / "demo")
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def one_start(bags: dict[int, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same of half the rows, where one manoeuvre is enough."""
    lay_out(bags[1], tmp_path / "demo")
    monkeypatch.chdir(tmp_path)


@pytest.mark.heavy
@pytest.mark.usefixtures("demo")
def test_the_example_weighs_in_a_loop(capsys: pytest.CaptureFixture[str]) -> None:
    text = (REPO / "docs/on-board.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert len(example.splitlines()) < 60
    names: dict[str, object] = {}
    exec(example, names)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2
    for line in lines:
        mass_kg = float(line.split()[2].replace(",", ""))
        assert abs(mass_kg - 3764.0) < 40.0


@pytest.mark.heavy
@pytest.mark.usefixtures("demo")
def test_json_lines_give_no_number_without_validity(payscope: Payscope) -> None:
    said = payscope(
        *("follow", "demo/campaign_150kg.bag", "-m", "demo/cat262c.toml", "--json"), *ALONE
    )
    assert said.status == 0
    reports = printed_reports(said.out)
    assert [report["event"] for report in reports].count("manoeuvre") == 2
    assert reports[-1]["event"] == "end"
    seconds = [int(report["t_s"]) for report in reports if report["event"] == "second"]
    assert seconds == sorted(set(seconds))
    for report in reports:
        assert (report["mass_kg"] is None) == (report["validity"] not in ("valid", "old"))
        assert (report["mass_u_kg"] is None) == (report["mass_kg"] is None)
    assert reports[0]["validity"] == "none_yet"
    assert reports[-1]["validity"] == "valid"


@pytest.mark.heavy
@pytest.mark.usefixtures("one_start")
def test_reports_are_a_topic_that_others_read(payscope: Payscope) -> None:
    words = ("demo/campaign_150kg.bag", "-m", "demo/cat262c.toml", "--json")
    said = payscope("follow", *words, "--reports", "mass.mcap")
    printed = [json.loads(line) for line in said.out.splitlines()]
    with Path("mass.mcap").open("rb") as file:
        messages = [json.loads(each.data) for *_, each in make_reader(file).iter_messages()]
    assert messages == printed
    printed = [report for report in printed if report["event"] != "replay"]
    with open_log("mass.mcap") as log:
        frame = log.read("/payscope/mass", ["validity", "mass_kg", "age_s", "manoeuvres"])
    assert frame["mass_kg"].to_list() == [report["mass_kg"] for report in printed]
    assert frame["validity"].to_list() == [report["validity"] for report in printed]
    again = payscope("follow", *words, *ALONE, "--reports", "mass.mcap")
    assert (again.status, again.out) == (0, "")
    assert "without repeating what is on disc" in again.err
    with Path("mass.mcap").open("rb") as file:
        assert len(list(make_reader(file).iter_messages())) == len(messages)
    other = payscope(
        "follow", *words, "--set", "settings.gate.threshold_nat=0.5", "--reports", "mass.mcap"
    )
    assert other.status == 2
    assert "mass.mcap" in other.err
    over_the_log = payscope("follow", *words, "--reports", words[0], "--force")
    assert over_the_log.status == 2
    assert Path(words[0]).stat().st_size > 100_000


def test_the_topic_of_a_follower_that_was_killed_has_every_report(tmp_path: Path) -> None:
    report = OnlineReport(
        *("manoeuvre", 10**18, 1.0, "cruising", "accepted", 0.9, "valid"),
        *(3600.0, 5.0, 900.0, 3.0, 0.2, 1),
    )
    file = ReportFile(tmp_path / "mass.mcap", [], "a log", overwrites=False)
    file.append_new_reports([report, report])
    (tmp_path / "killed.mcap").write_bytes((tmp_path / "mass.mcap").read_bytes())
    file.close_with_index()
    with open_log(tmp_path / "killed.mcap") as log:
        assert log.read("/payscope/mass", ["mass_kg"])["mass_kg"].to_list() == [3600.0, 3600.0]


@pytest.mark.heavy
@pytest.mark.usefixtures("one_start")
def test_a_mass_grows_old(payscope: Payscope) -> None:
    words = ("-m", "demo/cat262c.toml", "--json", "--valid-s", "1", *ALONE)
    said = payscope("follow", "demo/campaign_150kg.bag", *words)
    last = printed_reports(said.out)[-1]
    assert last["validity"] == "old"
    assert last["age_s"] > 1.0
    assert last["mass_kg"] is not None


@pytest.mark.parametrize(
    ("mass_kg", "u_kg", "validity"),
    [
        (3600.0, 5.0, "valid"),
        (3600.0, 500.0, "uncertain"),
        (float("nan"), 5.0, "uncertain"),
        (1000.0, 5.0, "implausible"),
        (20_000.0, 5.0, "implausible"),
    ],
)
def test_a_mass_that_is_not_worth_its_name_is_not_valid(
    mass_kg: float, u_kg: float, validity: str
) -> None:
    estimate = Estimate(np.array([mass_kg, 900.0]), np.array([u_kg, 3.0]), 60.0, 3.0)
    body = load_machine("cat262c.toml").machine
    assert judge_mass_validity(PooledEstimate(0, estimate), 10**9, body, 60.0) == validity
    assert judge_mass_validity(None, 10**9, body, 60.0) == "none_yet"


@pytest.mark.parametrize(
    ("inertia_kg_m2", "u_kg_m2", "at_s", "validity"),
    [
        (4300.0, 80.0, 1.0, "valid"),
        (4300.0, 80.0, 61.0, "old"),
        (4300.0, 500.0, 1.0, "uncertain"),
        (-4300.0, 80.0, 1.0, "implausible"),
    ],
)
def test_an_inertia_that_is_not_worth_its_name_is_not_valid(
    inertia_kg_m2: float, u_kg_m2: float, at_s: float, validity: str
) -> None:
    estimate = Estimate(np.array([inertia_kg_m2, 5000.0]), np.array([u_kg_m2, 40.0]), 37.0, 1.9)
    assert judge_spin_validity(PooledEstimate(0, estimate), int(at_s * 1e9), 60.0) == validity
    assert judge_spin_validity(None, 10**9, 60.0) == "none_yet"


@pytest.mark.heavy
@pytest.mark.usefixtures("one_start")
def test_what_cannot_be_followed_is_said_in_a_line(payscope: Payscope, tmp_path: Path) -> None:
    (tmp_path / "shift.parquet").write_bytes(b"PAR1")
    (tmp_path / "hello.mcap").write_text("hello")
    bag = "demo/campaign_150kg.bag"
    for log, more, fault in (
        ("nowhere.bag", (), "no such file"),
        ("shift.parquet", (), "cannot be followed"),
        ("hello.mcap", (), "not an MCAP file"),
        (bag, ("--set", "channels.yaw_rate_rad_s.topic=/imu/dta"), "it has /imu/data"),
        (bag, ("--set", "channels.yaw_rate_rad_s.field=angular.z"), "angular_velocity.z"),
    ):
        said = payscope("follow", log, "-m", "demo/cat262c.toml", "--idle-s", "0.1", *more)
        assert said.status == 2
        assert fault in said.err
        assert said.error is not None
        assert_one_line(said.error)


@pytest.mark.heavy
@pytest.mark.usefixtures("one_start")
def test_the_recording_is_the_causal_replays_and_agrees(payscope: Payscope) -> None:
    noise = ("force_N=60", "acc_m_s2=0.01", "speed_m_s=0.005")
    words = [word for each in noise for word in ("--set", f"settings.noise.{each}")]
    bag = "demo/campaign_150kg.bag"
    said = payscope("follow", bag, "-m", "demo/cat262c.toml", *words, *ALONE, "-o", "followed.rrd")
    assert said.status == 0
    agreed = [line for line in said.err.splitlines() if "bit for bit" in line]
    assert [line.partition(":")[0] for line in agreed] == [
        *("gate", "ls", "rls", "fgls", "tls", "pooled")
    ]
    again = payscope("follow", bag, "-m", "demo/cat262c.toml", "-o", "followed.rrd")
    assert again.status == 2
    assert "followed.rrd" in again.err


@pytest.mark.heavy
@pytest.mark.usefixtures("one_start")
def test_json_lines_go_to_stdout_also_where_a_panel_is_drawn() -> None:
    """On a terminal, `follow --json > FILE` draws on stderr and writes lines into the file."""
    master, terminal = pty.openpty()
    words = ["follow", "demo/campaign_150kg.bag", "-m", "demo/cat262c.toml", "--json", *ALONE]
    with subprocess.Popen(
        [sys.executable, "-P", str(REPO / "payscope.py"), *words],
        stdout=subprocess.PIPE,
        stderr=terminal,
        text=True,
    ) as following:
        os.close(terminal)
        drawn = threading.Thread(target=_drain, args=(master,))
        drawn.start()
        out, _ = following.communicate()
        drawn.join()
    os.close(master)
    assert following.returncode == 0
    assert [json.loads(line)["event"] for line in out.splitlines()].count("manoeuvre") == 1


def _drain(terminal: int) -> None:
    """Read what is drawn, or the terminal fills up."""
    with suppress(OSError):  # nobody draws any more
        while os.read(terminal, 65_536):
            pass
