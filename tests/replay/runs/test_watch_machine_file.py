"""`payscope run --watch`: a changed machine file is replayed; a fault in it is one line."""

import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from analysis.compare.run_comparison import ValueChange
from analysis.model.answer import Answer
from estimators.errors import PayscopeError
from recordings import read_provenance
from recordings.rrd.viewer import run_headless_viewer
from recordings.rrd.writer import LiveView
from replay.runs.run_logs import RecordingOutput, replay_and_record_logs, watch_machine_file
from tests.replay.sledge import MACHINE, Payscope, join_to_one_line
from tests.viewer_needed import VIEWER

SCRIPT = Path(sys.executable).with_name("payscope")
OTHER = f"{MACHINE}\n[settings.gate]\nthreshold_nat = 1.0\n"


class Watched:
    """The command as it runs, and what it has said on stderr so far."""

    def __init__(self, *words: object) -> None:
        self.process = subprocess.Popen(
            [SCRIPT, "run", *map(str, words), "--watch"],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def until(self, part: str) -> str:
        """The line that has `part` in it."""
        assert self.process.stderr is not None
        for line in self.process.stderr:
            if part in line:
                return line
        raise AssertionError(f"it ended without saying '{part}'")


@pytest.fixture
def watching() -> Iterator[Callable[..., Watched]]:
    """Start the command with these words; it is ended with the test."""
    started: list[Watched] = []

    def start(*words: object) -> Watched:
        started.append(Watched(*words))
        return started[-1]

    yield start
    for each in started:
        each.process.kill()
        each.process.communicate()


@pytest.fixture
def watched(
    watching: Callable[..., Watched], log: Path, machine_file: Path, tmp_path: Path
) -> Watched:
    return watching(log, "-m", machine_file, "-o", tmp_path / "out.rrd")


@pytest.mark.heavy
def test_a_change_is_replayed_a_fault_is_one_line_and_ctrl_c_ends_quietly(
    watched: Watched, machine_file: Path, tmp_path: Path
) -> None:
    watched.until("watching")
    machine_file.write_text(OTHER)
    assert "settings.gate.threshold_nat 0.7 → 1.0" in watched.until("changed")
    watched.until("watching")
    assert read_provenance(tmp_path / "out.rrd").settings.gate.threshold_nat == 1.0
    machine_file.write_text(OTHER.replace("threshold_nat", "treshold_nat"))
    assert "did you mean 'threshold_nat'" in watched.until("payscope: ")
    machine_file.write_text(MACHINE)
    watched.until("watching")
    watched.process.send_signal(signal.SIGINT)
    said, complained = watched.process.communicate(timeout=20)
    assert watched.process.returncode == 0
    assert "Traceback" not in complained
    assert said.count("Log usable: ") == 3
    assert read_provenance(tmp_path / "out.rrd").settings.gate.threshold_nat == 0.7
    assert not list(tmp_path.glob(".payscope-*"))


@pytest.mark.heavy
def test_a_machine_file_that_is_gone_is_said_and_waited_for(
    watching: Callable[..., Watched], log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # a shipped machine of this name is not the one that is gone
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "cat262c.toml"
    file.write_text(MACHINE)
    watched = watching(log, "-m", file.name, "-o", tmp_path / "out.rrd")
    watched.until("watching")
    away = file.rename(tmp_path / "away.toml")
    assert file.name in watched.until("payscope: ")
    away.rename(file)
    watched.until("watching")


def test_a_fault_before_the_first_replay_is_refused_as_without_a_watch(
    payscope: Payscope, log: Path, machine_file: Path
) -> None:
    machine_file.write_text(OTHER.replace("threshold_nat", "treshold_nat"))
    join_to_one_line(payscope("run", log, "-m", machine_file, "--watch"), "threshold_nat")


class TestViewer:
    pytestmark = VIEWER

    @pytest.mark.heavy
    def test_the_open_viewer_shows_the_next_replay_at_the_time_of_the_last(
        self, log: Path, machine_file: Path, tmp_path: Path
    ) -> None:
        with run_headless_viewer(None) as (client, address):

            def on_answer(_: Answer, changed: list[ValueChange]) -> None:
                held = client.get_state().recordings
                if not changed:
                    client.set_time("time", timestamp=7.0, play_state="paused")
                    time.sleep(0.5)
                    machine_file.write_text(OTHER)
                    return
                assert len(held) == 2
                new = max(held, key=lambda each: each.store_id != first)
                assert new.current_time == 7_000_000_000
                raise KeyboardInterrupt

            def on_error(error: PayscopeError) -> None:
                raise error

            def replay(to: RecordingOutput) -> Answer:
                nonlocal first
                answer = replay_and_record_logs([log], machine_file, to)
                first = first or client.get_state().recordings[0].store_id
                return answer

            first = None
            to = RecordingOutput(tmp_path / "out.rrd", viewer=LiveView(address))
            with pytest.raises(KeyboardInterrupt):
                watch_machine_file(machine_file, to, [], replay, on_answer, on_error)
