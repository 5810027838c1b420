"""Killed at any moment and started again, `follow` goes on: nothing twice, a second lost."""

import json
import os
import resource
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any, TextIO

import numpy as np
import pytest
import rerun as rr
from mcap.reader import make_reader
from mcap.writer import CompressionType

from analysis.simulation import Scenario
from recordings.follow.growing_file import is_unfinished_recording, iter_complete_messages
from recordings.follow.growing_recording import read_end_of_recording
from replay.follow.report_file import TOPIC
from replay.simulation.simulate_logs import simulate_scenario_to_logs
from tests.one_line import assert_one_line
from tests.replay.follow.recorders import Recording, mcap_recorder, rosbag2_recorder
from tests.replay.sledge import Payscope
from tests.twins import mark_heavy_after, mark_slow_after

REPO = Path(__file__).resolve().parents[3]
DRIVE: dict[str, Any] = {"campaign": {"loads_kg": [150], "runs": 2}}
TWO_STARTS = Scenario.model_validate(DRIVE)
NOISE = [
    word
    for each in ("force_N=60", "acc_m_s2=0.01", "speed_m_s=0.005")
    for word in ("--set", f"settings.noise.{each}")
]
#: One that goes by windows and one that goes on from its last state: what a recording draws of each
#: further method takes a second a process.
METHODS = ("--set", 'settings.trace.methods=["pooled","rls"]')
#: Seconds between two looks of a slow recorder: it writes for half a minute.
SLOW_S = 0.06
#: Replays in the background, also those that ctrl-C ends, are the statement of
#: `test_background_replay.py`; here each would take longer than what is followed.
ALONE = ("-m", "cat262c.toml", *NOISE, *METHODS, "--replay-share", "0")


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("killed")
    return {
        suffix: simulate_scenario_to_logs(TWO_STARTS, folder / f"drive{suffix}")[0]
        for suffix in (".mcap", ".db3")
    }


@pytest.fixture(autouse=True)
def _in_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def started(
    log: str,
    *words: str,
    limit: Callable[[], None] | None = None,
    out: TextIO | int = subprocess.PIPE,
) -> subprocess.Popen[str]:
    """`payscope follow` in a process of its own."""
    return subprocess.Popen(
        [sys.executable, "-P", str(REPO / "payscope.py"), "follow", log, *ALONE, *words],
        stdout=out,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=limit,
        # under a limit, Python 3.11 would keep modules that it compiles cut short
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"} if limit else None,
    )


def kill_at(log: str, t_s: float) -> None:
    """Follow a log that grows no more until so many seconds of it, and kill."""
    process = started(log, "-o", "out.rrd", "--idle-s", "60", "--json")
    assert process.stdout is not None
    next(line for line in process.stdout if json.loads(line)["t_s"] > t_s)
    process.kill()
    process.communicate()


def rows_of(recording: Path) -> list[int]:
    """The `t_ns` of the rows of a recording that grows, as any reader of Rerun finds them."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        chunks = list(rr.chunk.RrdReader(recording).stream())
    times = [
        time.value
        for chunk in chunks
        if chunk.entity_path == "/display/excitation"
        for time in chunk.to_record_batch().column("t")
    ]
    return sorted(times)


def reports_of(topic: Path) -> list[dict[str, Any]]:
    with topic.open("rb") as file:
        messages = make_reader(file).iter_messages([TOPIC])
        return [json.loads(each.data) for *_, each in messages]


def printed_reports(out: str) -> list[dict[str, Any]]:
    """The lines but those of replays, which come when the processor is free."""
    reports = [json.loads(line) for line in out.splitlines()]
    return [report for report in reports if report["event"] != "replay"]


def assert_goes_on(
    log: str, recording: Recording, kills: int, seed: int, payscope: Payscope
) -> None:
    """Kill at random moments, each third time while it starts; compare with one never killed."""
    rng = np.random.default_rng(seed)
    words = ("-o", "out.rrd", "--reports", "mass.mcap", "--json")
    lines, resumed = Path("mass.jsonl"), 0
    recorded: list[int] = []
    with lines.open("a") as out:
        for number in range(kills):
            if recording.is_over:
                break  # a busy machine: the last follower would find a whole recording
            size = lines.stat().st_size
            process = started(log, *words, out=out)
            while number % 3 < 2 and lines.stat().st_size == size and process.poll() is None:
                time.sleep(0.01)
            time.sleep(rng.uniform(0.0, 2.0))
            process.kill()
            resumed += "without repeating what is on disc" in process.communicate()[1]
            if not Path("out.rrd").exists():
                continue
            data = Path("out.rrd").read_bytes()
            assert [*iter_complete_messages(data)][-1].end == len(data), "a message is cut"
            rows = rows_of(Path("out.rrd"))
            assert rows[: len(recorded)] == recorded
            assert len(set(rows)) == len(rows)
            recorded = rows
        last = started(log, *words, out=out)
        err = last.communicate()[1]
    assert last.returncode == 0, err
    assert "without repeating what is on disc" in err
    assert resumed
    assert "gate: " in err
    assert "differ" not in err
    whole = payscope("follow", log, *ALONE, "--json")
    reference = printed_reports(whole.out)
    assert reports_of(Path("mass.mcap")) == reference
    # a kill between disc and line costs the line
    printed = printed_reports(lines.read_text())
    assert len(reference) - kills <= len(printed) <= len(reference)
    stamps = [each["unix_ns"] for each in printed if each["event"] != "end"]
    assert stamps == sorted(set(stamps))
    assert all(each in reference for each in printed)


@pytest.mark.heavy
def test_a_killed_follower_goes_on(
    sources: dict[str, Path], tmp_path: Path, payscope: Payscope
) -> None:
    target = tmp_path / "drive.mcap"
    recorder = mcap_recorder(sources[".mcap"], target, CompressionType.ZSTD)
    with Recording(recorder, target, SLOW_S) as recording:
        assert_goes_on(target.name, recording, kills=3, seed=4, payscope=payscope)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_followers_killed_at_many_moments_go_on(
    seed: int, sources: dict[str, Path], tmp_path: Path, payscope: Payscope
) -> None:
    target = tmp_path / "drive"
    recorder = rosbag2_recorder(sources[".db3"], target, rows_a_file=1500)
    with Recording(recorder, target, SLOW_S) as recording:
        time.sleep(1.0)
        assert_goes_on(target.name, recording, kills=5, seed=seed, payscope=payscope)


@pytest.mark.heavy
def test_after_ctrl_c_a_log_that_has_grown_is_followed_on(
    sources: dict[str, Path], tmp_path: Path, payscope: Payscope
) -> None:
    data = sources[".mcap"].read_bytes()
    target = tmp_path / "drive.mcap"
    target.write_bytes(data[: 2 * len(data) // 3])
    first = started("drive.mcap", "-o", "out.rrd", "--json", "--idle-s", "60")
    assert first.stdout is not None
    for line in first.stdout:
        if json.loads(line)["t_s"] > 15:
            break
    first.send_signal(signal.SIGINT)
    out, err = first.communicate()
    assert first.returncode == 0
    assert "interrupted" in err
    assert not is_unfinished_recording(Path("out.rrd"))
    until_s = json.loads(out.splitlines()[-1])["t_s"]
    refused = payscope("follow", "drive.mcap", *ALONE, "-o", "out.rrd")
    assert "exists already" in refused.err, "nothing has come since"
    target.write_bytes(data)
    again = payscope("follow", "drive.mcap", *ALONE, "-o", "out.rrd", "--json")
    assert again.status == 0, again.err
    assert "without repeating what is on disc" in again.err
    assert "differ" not in again.err
    stamps = [json.loads(line)["t_s"] for line in again.out.splitlines()]
    assert min(stamps) > until_s
    assert [path.name for path in tmp_path.glob(".payscope*")] == []


@pytest.mark.heavy
def test_a_recording_of_another_log_or_of_other_settings_is_not_continued(
    sources: dict[str, Path], tmp_path: Path, payscope: Payscope
) -> None:
    (tmp_path / "drive.mcap").write_bytes(sources[".mcap"].read_bytes()[:-200_000])
    kill_at("drive.mcap", 5.0)
    for words in (["--set", "settings.gate.threshold_nat=0.5"], ["--set", "machine.name=other"]):
        said = payscope("follow", "drive.mcap", *ALONE, *words, "-o", "out.rrd")
        assert said.status == 2
        assert "out.rrd: was recorded from drive.mcap" in said.err
        assert said.error is not None
        assert_one_line(said.error)


@pytest.mark.heavy
@pytest.mark.parametrize("place", mark_slow_after(1, [0.6, 0.95]))
def test_a_recording_cut_anywhere_goes_on_behind_its_last_whole_second(
    place: float, sources: dict[str, Path], tmp_path: Path, payscope: Payscope
) -> None:
    (tmp_path / "drive.mcap").write_bytes(sources[".mcap"].read_bytes()[:-200_000])
    kill_at("drive.mcap", 15.0)
    data = Path("out.rrd").read_bytes()
    Path("out.rrd").write_bytes(data[: int(place * len(data))])
    end = read_end_of_recording(Path("out.rrd"))
    assert end is not None
    rows = rows_of_cut(data, end.size)
    assert rows[-1] == end.until_ns
    (tmp_path / "drive.mcap").write_bytes(sources[".mcap"].read_bytes())
    said = payscope("follow", "drive.mcap", *ALONE, "-o", "out.rrd", "--json")
    assert said.status == 0
    assert "differ" not in said.err
    assert min(json.loads(line)["t_s"] for line in said.out.splitlines()) > end.until_ns / 1e9


def rows_of_cut(data: bytes, size: int) -> list[int]:
    Path("cut.rrd").write_bytes(data[:size])
    return rows_of(Path("cut.rrd"))


@pytest.mark.slow
def test_a_disc_that_fills_ends_the_outputs_and_not_the_following(
    sources: dict[str, Path], tmp_path: Path, payscope: Payscope
) -> None:
    """With room for files of 400 kB, the recording ends whole; the lines go on."""
    (tmp_path / "drive.mcap").write_bytes(sources[".mcap"].read_bytes())

    def little_room() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (400_000, 400_000))

    process = started("drive.mcap", "-o", "out.rrd", "--json", limit=little_room)
    out, err = process.communicate()
    given_up = [line for line in err.splitlines() if "not continued" in line]
    assert len(given_up) == 1
    assert "out.rrd" in given_up[0]
    assert printed_reports(out)[-1]["event"] == "end", "following goes on"
    assert process.returncode == 2, "the replay does not fit either"
    assert "Traceback" not in err
    data = Path("out.rrd").read_bytes()
    assert 300_000 < len(data) == [*iter_complete_messages(data)][-1].end
    rows = rows_of(Path("out.rrd"))
    again = payscope("follow", "drive.mcap", *ALONE, "-o", "out.rrd", "--json")
    assert again.status == 0, again.err
    assert min(json.loads(line)["unix_ns"] for line in again.out.splitlines()) > 0
    assert json.loads(again.out.splitlines()[0])["t_s"] > rows[-1] / 1e9
    assert "differ" not in again.err


@pytest.mark.slow
def test_reports_that_do_not_fit_are_given_up_whole(
    sources: dict[str, Path], tmp_path: Path, payscope: Payscope
) -> None:
    (tmp_path / "drive.mcap").write_bytes(sources[".mcap"].read_bytes())

    def little_room() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (8_000, 8_000))

    process = started("drive.mcap", "--reports", "mass.mcap", "--json", limit=little_room)
    out, err = process.communicate()
    assert process.returncode == 0
    assert len([line for line in err.splitlines() if "not continued" in line]) == 1
    rest = payscope("follow", "drive.mcap", *ALONE, "--reports", "mass.mcap", "--json").out
    everything = printed_reports(out)
    assert reports_of(Path("mass.mcap")) == everything
    assert 0 < len(printed_reports(rest)) < len(everything)


@pytest.mark.heavy
def test_a_recorder_that_is_killed_loses_its_torn_chunk_and_the_next_file_goes_on(
    sources: dict[str, Path], tmp_path: Path, payscope: Payscope
) -> None:
    folder = tmp_path / "shift"
    folder.mkdir()
    data = sources[".mcap"].read_bytes()
    (folder / "shift_0.mcap").write_bytes(data[: len(data) // 2])
    (folder / "shift_1.mcap").write_bytes(later(tmp_path).read_bytes())
    said = payscope("follow", "shift", *ALONE, "--json", "--idle-s", "0.3")
    assert said.status == 0
    torn = [line for line in said.err.splitlines() if "ends inside a record" in line]
    assert len(torn) == 1
    assert "shift_0.mcap" in torn[0]
    last = printed_reports(said.out)[-1]
    assert last["t_s"] > 60
    assert last["manoeuvres"] >= 3


@pytest.mark.heavy
@pytest.mark.parametrize("step_s", mark_heavy_after(1, [-30.0, 30.0]))
def test_a_clock_that_is_set_costs_no_row_twice(
    step_s: float, sources: dict[str, Path], tmp_path: Path, payscope: Payscope
) -> None:
    """Set ahead, a gap; set back, samples that are left out until time is as late again."""
    folder = tmp_path / "shift"
    folder.mkdir()
    (folder / "shift_0.mcap").write_bytes(sources[".mcap"].read_bytes())
    after = later(tmp_path, 27.0 + step_s)
    (folder / "shift_1.mcap").write_bytes(after.read_bytes())
    said = payscope("follow", "shift", *ALONE, "--json", "--idle-s", "0.3")
    assert said.status == 0
    seconds = [
        r["unix_ns"] for r in map(json.loads, said.out.splitlines()) if r["event"] == "second"
    ]
    assert all(before < after for before, after in pairwise(seconds))


def later(folder: Path, seconds: float = 60.0) -> Path:
    """The same drive, recorded so many seconds later."""
    plan = {**DRIVE, "log": {"start_unix_s": 1_700_000_000 + round(seconds)}}
    return simulate_scenario_to_logs(Scenario.model_validate(plan), folder / "later.mcap")[0]
