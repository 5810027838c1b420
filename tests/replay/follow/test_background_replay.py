"""Replays in the background of a followed log give the answer of `run`, at a bounded cost."""

import json
import os
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import polars as pl
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType

from analysis.online.replay_report import LoadReport, ReplayReport, select_fit_with_inertia
from analysis.simulation import Scenario
from replay import load_machine
from replay.follow.background_replay import (
    BackgroundReplays,
    is_text_table,
    read_log_sizes_and_modification_times,
    serve_replay_request,
)
from replay.follow.report_file import (
    REPLAY_TOPIC,
    describe_load_state,
    format_replay_markdown,
    iter_closed_load_lines,
)
from replay.simulation.simulate_logs import simulate_scenario_to_logs
from tests.replay.follow.recorders import Recording, bag_recorder, csv_recorder, mcap_recorder
from tests.replay.sledge import MACHINE, Payscope, sledge
from tests.twins import mark_slow_after

REPO = Path(__file__).resolve().parents[3]
THREE_STARTS = Scenario.model_validate({"campaign": {"loads_kg": [150], "runs": 3}})
#: Seconds within which a process that has lost its parent is gone, on a busy machine.
PATIENCE_S = 60.0


def record_mcap(source: Path, target: Path) -> Iterator[None]:
    return mcap_recorder(source, target, CompressionType.ZSTD)


RECORDERS: dict[str, Callable[[Path, Path], Iterator[None]]] = {
    ".bag": bag_recorder,
    ".mcap": record_mcap,
    ".csv": csv_recorder,
}


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("replayed")
    found = {
        suffix: simulate_scenario_to_logs(THREE_STARTS, folder / f"drive{suffix}")[0]
        for suffix in (".bag", ".mcap")
    }
    found[".csv"] = folder / "drive.csv"
    sledge().write_csv(found[".csv"])
    return found


@pytest.fixture(autouse=True)
def _in_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("sledge.toml").write_text(MACHINE)


def machine_of(suffix: str) -> str:
    return "sledge.toml" if suffix == ".csv" else "cat262c.toml"


def started(log: Path, *words: str) -> subprocess.Popen[str]:
    """`payscope follow` in a process of its own."""
    machine = ("-m", machine_of(log.suffix), "--json")
    return subprocess.Popen(
        [sys.executable, "-P", str(REPO / "payscope.py"), "follow", str(log), *machine, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def replays_of(out: str) -> list[dict[str, Any]]:
    reports = [json.loads(line) for line in out.splitlines()]
    return [report for report in reports if report["event"] == "replay"]


def replays_in(reports: Path) -> list[dict[str, Any]]:
    """As a topic has them."""
    with reports.open("rb") as file:
        messages = make_reader(file).iter_messages([REPLAY_TOPIC])
        return [json.loads(each.data) for *_, each in messages]


def children_of(process: int) -> list[int]:
    return [
        int(word) for word in Path(f"/proc/{process}/task/{process}/children").read_text().split()
    ]


def is_running(process: int) -> bool:
    try:
        state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state != "Z"


def wait_until(is_true: Callable[[], object]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not is_true():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def assert_no_number_without_validity(report: dict[str, Any]) -> None:
    for load in report["loads"]:
        assert (load["mass_kg"] is not None) == (load["validity"] == "valid")
        assert (load["mass_u_kg"] is None) == (load["mass_kg"] is None)
        if load["validity"] != "valid":
            assert load["payload_kg"] is load["friction_x_N_s_m"] is None
            assert load["withheld_by"]
    assert (report["inertia_z_kg_m2"] is not None) == (report["turning_validity"] == "valid")


# a log of messages and a table; a bag is another log of messages
@pytest.mark.heavy
@pytest.mark.parametrize("suffix", mark_slow_after(1, [".mcap", ".csv", ".bag"]))
def test_the_last_replay_of_a_recorded_log_is_what_run_says(
    suffix: str, logs: dict[str, Path], tmp_path: Path, payscope: Payscope
) -> None:
    target = tmp_path / f"growing{suffix}"
    with Recording(RECORDERS[suffix](logs[suffix], target), target):
        following = started(target, "--idle-s", "5", "--replay-share", "0.5")
        out, err = following.communicate()
    assert following.returncode == 0, err
    *before, last = replays_of(out)
    assert last["is_whole"]
    assert not any(report["is_whole"] for report in before)
    for report in (*before, last):
        assert_no_number_without_validity(report)
    said = json.loads(payscope("run", target, "-m", machine_of(suffix), "--json").out)
    assert last["fingerprint"] == said["fingerprint"]["results"], "of every frame, bit for bit"
    assert len(last["loads"]) == len(said["loads"])
    for mine, theirs in zip(last["loads"], said["loads"], strict=True):
        assert mine["mass_kg"] == theirs["mass_kg"]
        assert mine["mass_u_kg"] == theirs["u_kg"]
        assert mine["payload_kg"] == theirs["payload_kg"]
        assert mine["manoeuvres"] == theirs["manoeuvres"]
    assert last["loads"][0]["mass_kg"] is not None


@pytest.mark.heavy
def test_load_states_are_there_while_the_log_grows(
    logs: dict[str, Path], tmp_path: Path, payscope: Payscope
) -> None:
    """Half of a log, of which no more comes for now; then the rest."""
    data = logs[".mcap"].read_bytes()
    target = tmp_path / "growing.mcap"
    target.write_bytes(data[: len(data) // 2])
    following = started(target, "--idle-s", "600", "--reports", "mass.mcap")
    assert following.stdout is not None
    early = next(line for line in following.stdout if '"event": "replay"' in line)
    (first,) = replays_of(early)
    assert not first["is_whole"]
    assert first["validity"] == "valid"
    with target.open("ab") as file:
        file.write(data[len(data) // 2 :])
    out, _ = following.communicate()
    last = replays_of(out)[-1]
    assert last["is_whole"]
    assert last["t_s"] > first["t_s"] + 5.0
    assert last["loads"][0]["manoeuvres"] > first["loads"][0]["manoeuvres"]
    assert replays_in(Path("mass.mcap")) == replays_of(early + out)
    again = payscope("follow", target, "-m", "cat262c.toml", "--json", "--reports", "mass.mcap")
    assert again.out == "", "what is on disc is not said again"


@pytest.mark.heavy
def test_a_log_that_cannot_weigh_names_the_check_that_withholds(payscope: Payscope) -> None:
    table = sledge()
    table.with_columns(force_N=-table["force_N"]).write_csv("inverted.csv")
    words = ("follow", "inverted.csv", "-m", "sledge.toml", "--idle-s", "0.2")
    said = payscope(*words, "--reports", "mass.mcap")
    last = replays_in(Path("mass.mcap"))[-1]
    assert last["validity"] == "withheld"
    assert "force_sign" in last["withheld_by"]
    assert_no_number_without_validity(last)
    assert "no mass, withheld by force_sign" in said.out


def test_a_replay_is_told_with_its_age_and_loads_with_their_validity() -> None:
    numbers = {"mass_kg": 3763.0, "mass_u_kg": 21.0, "payload_kg": 156.2, "payload_u_kg": 4.7}
    friction = {"friction_x_N_s_m": 2890.0, "friction_u_N_s_m": 28.0}
    known = LoadReport(1, 2 * 10**9, 9 * 10**9, 4, "valid", "", False, **numbers, **friction)
    unknown = replace(
        known,
        load_id=2,
        validity="withheld",
        withheld_by="relative_u",
        **dict.fromkeys((*numbers, *friction)),
    )
    report = ReplayReport("replay", 10 * 10**9, 10.0, 0.0, False, "valid", (), (known, unknown))
    assert ReplayReport.from_dict(json.loads(json.dumps(report.to_dict()))) == report
    assert format_replay_markdown(report.copy_with_age_at(25 * 10**9)).splitlines() == [
        "## replayed up to 00:00:10.0, 15 s ago: 2 loads",
        "",
        "- load 1, 00:00:02.0 to 00:00:09.0, 4 manoeuvres: 3763 ± 21 kg, payload 156.2 ± 4.7 kg",
        "- load 2, 00:00:02.0 to 00:00:09.0, 4 manoeuvres: no mass, withheld by relative_u",
    ]
    assert [*iter_closed_load_lines(report, None)] == [describe_load_state(known)], (
        "load 2 may go on"
    )
    assert [*iter_closed_load_lines(report, report)] == []
    whole = replace(report, is_whole=True)
    assert [*iter_closed_load_lines(whole, report)][1:] == [
        describe_load_state(known),
        describe_load_state(unknown),
    ]


def test_the_inertia_is_of_arcs_where_the_joint_fit_has_none() -> None:
    arcs, joint, refused = (
        {"kind": kind, "inertia_z_kg_m2": inertia}
        for kind, inertia in (("arcs", 5.0), ("joint", 4.0), ("joint", None))
    )
    assert select_fit_with_inertia([arcs, joint]) is joint
    assert select_fit_with_inertia([arcs, refused]) is arcs
    assert select_fit_with_inertia([refused]) is refused
    assert select_fit_with_inertia([]) is None


@pytest.mark.heavy
def test_a_log_that_is_too_short_has_no_load(payscope: Payscope) -> None:
    sledge(seconds=3.0).write_csv("short.csv")
    words = ("follow", "short.csv", "-m", "sledge.toml", "--idle-s", "0.2", "--json")
    last = replays_of(payscope(*words).out)[-1]
    assert last["validity"] in ("withheld", "none_yet")
    assert last["is_whole"]
    assert_no_number_without_validity(last)


def test_without_a_share_there_is_no_replay(logs: dict[str, Path]) -> None:
    told: list[str] = []
    with BackgroundReplays(
        [logs[".mcap"]], load_machine("cat262c.toml"), told.append, share=0.0
    ) as replays:
        replays.request_replay_of_log_so_far()
        assert replays.take_result_and_start_next() is None
        assert replays.process_id is None
        assert replays.wait_for_replay_of_whole_log(lambda: None) is None
    assert not told


@pytest.mark.heavy
def test_replays_keep_to_their_share_of_one_core(logs: dict[str, Path], tmp_path: Path) -> None:
    """The processor time of all but the last is within the share of the time until the last."""
    target, data = tmp_path / "growing.mcap", logs[".mcap"].read_bytes()
    size = len(data) // 2
    target.write_bytes(data[:size])
    share, took = 0.5, list[float]()
    began = time.monotonic()
    with BackgroundReplays(
        [target], load_machine("cat262c.toml"), lambda _: None, share=share
    ) as each:
        while len(took) < 3:
            size += 2_000
            target.write_bytes(data[:size])
            each.request_replay_of_log_so_far()
            if report := each.take_result_and_start_next():
                took.append(report.processor_s)
                assert sum(took[:-1]) <= share * (time.monotonic() - began)
            time.sleep(0.02)
        assert each.processor_s == pytest.approx(sum(took))


@pytest.mark.heavy
def test_a_killed_process_is_said_in_a_line_and_the_last_replay_is_the_same(
    logs: dict[str, Path], payscope: Payscope
) -> None:
    told: list[str] = []
    report: ReplayReport | None = None
    with BackgroundReplays([logs[".bag"]], load_machine("cat262c.toml"), told.append) as replays:
        replays.request_replay_of_log_so_far()
        assert replays.take_result_and_start_next() is None
        assert replays.process_id is not None
        os.kill(replays.process_id, signal.SIGKILL)
        wait_until(lambda: replays.take_result_and_start_next() or told)
        assert len(told) == 1
        assert "signal 9" in told[0]
        assert "following goes on" in told[0]
        report = replays.wait_for_replay_of_whole_log(lambda: None)
    assert report is not None
    assert report.is_whole
    said = json.loads(payscope("run", logs[".bag"], "-m", "cat262c.toml", "--json").out)
    assert report.fingerprint == said["fingerprint"]["results"]


@pytest.mark.heavy
def test_a_log_that_grows_on_when_following_ends_is_replayed_once_more(
    logs: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By ctrl-C while it is recorded: what was there then is the answer."""
    target, data = tmp_path / "growing.mcap", logs[".mcap"].read_bytes()
    target.write_bytes(data[:-200_000])
    rest = iter(data[-200_000:])

    def grow(_seconds: float) -> None:
        with target.open("ab") as file:
            file.write(bytes([next(rest)]))
        sleep(0.02)

    sleep = time.sleep
    monkeypatch.setattr("replay.follow.background_replay.time.sleep", grow)
    told: list[str] = []
    with BackgroundReplays([target], load_machine("cat262c.toml"), told.append) as replays:
        first = replays.wait_for_replay_of_whole_log(lambda: None)
        assert first is not None
        assert first.is_whole
        assert first.validity == "valid"
        assert replays.processor_s == first.processor_s, "one replay"
    assert not told


def test_a_process_that_cannot_start_does_not_end_following(
    logs: dict[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse() -> NoReturn:
        raise BlockingIOError(11, "Resource temporarily unavailable")

    monkeypatch.setattr("replay.follow.background_replay.start_replay_process", refuse)
    told: list[str] = []
    with BackgroundReplays([logs[".bag"]], load_machine("cat262c.toml"), told.append) as replays:
        replays.request_replay_of_log_so_far()
        assert replays.take_result_and_start_next() is None
        assert told == [
            "the process of the replay could not be started: Resource temporarily unavailable; "
            "following goes on, the next replay starts another"
        ]
        assert replays.wait_for_replay_of_whole_log(lambda: None) is None
    assert told[-1].startswith("the process of the last replay could not be started")


def test_a_fault_that_nobody_foresaw_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> NoReturn:
        raise pl.exceptions.ComputeError("torn")

    monkeypatch.setattr("replay.follow.background_replay.replay_log_so_far", fail)
    machine = load_machine("sledge.toml").model_dump(mode="json", exclude_unset=True)
    asked = {"logs": ["a.csv"], "machine": machine, "is_copied": False}
    report = serve_replay_request(asked)
    assert (report.validity, report.fault) == ("failed", "ComputeError: torn")


def test_rows_that_a_database_keeps_beside_itself_are_news(tmp_path: Path) -> None:
    """SQLite in its mode WAL leaves the database as it is until it has many rows."""
    path = tmp_path / "growing.db3"
    with closing(sqlite3.connect(path, isolation_level=None)) as database:
        database.execute("PRAGMA journal_mode = WAL")
        database.execute("CREATE TABLE messages (data BLOB)")
        before, size = read_log_sizes_and_modification_times([path]), path.stat().st_size
        database.execute("INSERT INTO messages VALUES (x'00')")
        assert path.stat().st_size == size
        assert read_log_sizes_and_modification_times([path]) != before


@pytest.mark.parametrize("name", ["a.MCAP", "a.bag", "a.bag.active", "a.db3"])
def test_a_format_of_messages_is_not_cut_at_its_last_line(name: str) -> None:
    Path(name).write_bytes(b"")
    assert not is_text_table(Path(name))


@pytest.mark.heavy
@pytest.mark.skipif(sys.platform != "linux", reason="/proc tells the children of a process")
@pytest.mark.parametrize("ending", mark_slow_after(1, [signal.SIGINT, signal.SIGKILL]))
def test_the_process_ends_with_its_follower(
    ending: signal.Signals, logs: dict[str, Path], tmp_path: Path
) -> None:
    """Killed, it leaves no process; by ctrl-C it ends with status 0 and the replay of all."""
    target = tmp_path / "growing.mcap"
    target.write_bytes(logs[".mcap"].read_bytes()[:-200_000])
    with started(target, "--idle-s", "600") as following:
        assert following.stdout is not None
        lines = [next(line for line in following.stdout if '"event": "manoeuvre"' in line)]
        wait_until(lambda: children_of(following.pid))
        children = children_of(following.pid)
        wait_until(lambda: all(os.getpriority(os.PRIO_PROCESS, child) == 19 for child in children))
        following.send_signal(ending)
        # not by communicate, which misses what was read ahead for the first line
        lines += following.stdout
        wait_until(lambda: not any(map(is_running, children)))
        if ending == signal.SIGINT:
            assert following.wait() == 0, following.stderr and following.stderr.read()
            assert replays_of("".join(lines))[-1]["is_whole"]
