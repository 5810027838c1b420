"""However following ends, no row is lost between its step and its line, and the end says why."""

import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from analysis.online.follower import FollowedRow, Follower
from recordings import read_provenance
from replay import load_machine
from replay.follow.agreement import Agreement, iter_agreement_lines
from replay.follow.follow_logs import FollowedLogState, MachineFileChange, follow_logs
from tests.replay.sledge import MACHINE, Payscope, sledge
from tests.twins import mark_slow_after

IDLE_S = 0.3
#: Of replays in the background nothing is said here.
FOLLOW = ("follow", "drive.csv", "-m", "sledge.toml", "--replay-share", "0")
NOISE = [f"settings.noise.{each}" for each in ("force_N=1.0", "acc_m_s2=0.01", "speed_m_s=0.001")]


@pytest.fixture(autouse=True)
def _in_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("sledge.toml").write_text(MACHINE)
    sledge(seconds=20.0).write_csv("drive.csv")


def after_rows(monkeypatch: pytest.MonkeyPatch, number: int, do: Callable[[], None]) -> None:
    """Do something in the middle of a poll."""
    note, noted = Follower._note_step, [0]

    def note_and_do(follower: Follower, *args: Any) -> FollowedRow:
        noted[0] += 1
        if noted[0] == number:
            do()
        return note(follower, *args)

    monkeypatch.setattr(Follower, "_note_step", note_and_do)


def interrupt() -> None:
    os.kill(os.getpid(), signal.SIGINT)


def followed() -> tuple[FollowedLogState, list[FollowedRow]]:
    rows: list[FollowedRow] = []
    log = [Path("drive.csv")]
    following = follow_logs(log, load_machine("sledge.toml"), lambda _, n: rows.extend(n), idle_s=9)
    return following, [row for row in rows if row.gate is not None]


@pytest.mark.heavy
def test_ctrl_c_in_the_middle_of_a_poll_loses_no_row(monkeypatch: pytest.MonkeyPatch) -> None:
    before = signal.getsignal(signal.SIGINT)
    after_rows(monkeypatch, 1000, interrupt)
    following, rows = followed()
    assert following.is_interrupted
    assert len(rows) == following.follower.rows_stepped > 1500
    assert signal.getsignal(signal.SIGINT) == before


@pytest.mark.heavy
def test_ctrl_c_again_ends_a_poll_and_each_row_that_was_stepped_is_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def interrupt_twice() -> None:
        interrupt()
        interrupt()

    after_rows(monkeypatch, 1000, interrupt_twice)
    following, rows = followed()
    assert following.end_reason == "interrupted"
    assert len(rows) == following.follower.rows_stepped == 1000


@pytest.mark.heavy
def test_half_a_line_of_a_table_that_is_recorded_is_no_row_after_ctrl_c(
    monkeypatch: pytest.MonkeyPatch, payscope: Payscope
) -> None:
    """Nor in the replay: what is recorded has the rows that were followed."""
    data = Path("drive.csv").read_bytes()
    Path("drive.csv").write_bytes(data[:-7])
    after_rows(monkeypatch, 1000, interrupt)
    words = [word for each in NOISE for word in ("--set", each)]
    said = payscope(*FOLLOW, *words, "-o", "out.rrd")
    assert said.status == 0, said.err
    assert "interrupted: " in said.err
    assert "differ" not in said.err
    assert "gate: " in said.err


@pytest.mark.heavy
def test_one_run_has_one_machine_file(monkeypatch: pytest.MonkeyPatch, payscope: Payscope) -> None:
    other = MACHINE.replace("empty_mass_kg = 100.0", "empty_mass_kg = 50.0")
    after_rows(monkeypatch, 1000, lambda: void(Path("sledge.toml").write_text(other)))
    words = (*FOLLOW, "--idle-s", IDLE_S, "-o", "out.rrd")
    said = payscope(*words, "--json")
    assert said.status == 0, said.err
    assert said.err.count("sledge.toml: has changed") == 1
    assert read_provenance(Path("out.rrd")).machine["machine"]["empty_mass_kg"] == 100.0


def void(_: object) -> None:
    """Of what is done, no result."""


def test_a_machine_file_that_is_touched_or_replaced_by_the_same_has_not_changed() -> None:
    change = MachineFileChange(Path("sledge.toml"))
    os.utime("sledge.toml", ns=(1, 1))
    assert not change.has_file_changed()
    Path("sledge.toml").unlink()
    assert not change.has_file_changed()
    Path("sledge.toml").write_text(MACHINE)
    assert not change.has_file_changed()
    Path("sledge.toml").write_text(MACHINE + "\n")
    assert change.has_file_changed()
    assert not change.has_file_changed()


@pytest.mark.heavy
@pytest.mark.parametrize("becomes", mark_slow_after(1, ["shorter", "gone"]))
def test_a_log_that_does_not_grow_because_it_shrank_or_is_gone_says_so(
    becomes: str,
) -> None:
    path = Path("drive.csv")
    size = path.stat().st_size
    following = follow_logs(
        [path],
        load_machine("sledge.toml"),
        lambda _, rows: spoil(path, becomes) if rows and path.exists() else None,
        idle_s=IDLE_S,
    )
    if becomes == "gone":
        assert following.end_reason == "drive.csv is no longer there"
    else:
        assert following.end_reason == f"drive.csv has shrunk from {size:,} to 100 bytes"


def spoil(path: Path, becomes: str) -> None:
    if becomes == "gone":
        path.unlink()
    else:
        os.truncate(path, 100)


@pytest.mark.heavy
@pytest.mark.parametrize("becomes", mark_slow_after(1, ["shorter", "gone"]))
def test_a_log_that_is_lost_leaves_what_was_recorded(
    becomes: str, monkeypatch: pytest.MonkeyPatch, payscope: Payscope
) -> None:
    """It is not replaced by the replay of what is left of the log."""
    after_rows(monkeypatch, 1000, lambda: spoil(Path("drive.csv"), becomes))
    words = (*FOLLOW, "--idle-s", IDLE_S, "-o", "out.rrd")
    said = payscope(*words)
    assert said.status == 2
    assert "whole log" not in said.out
    assert "no such file" not in said.err
    assert "out.rrd keeps what was recorded while following, without the final replay" in said.err
    assert Path("out.rrd").stat().st_size > 100_000


def test_differences_that_must_be_are_one_line_with_the_reason() -> None:
    differing = [Agreement(name, 5, 5, 0.0, False) for name in ("gate", "ls", "tls")]
    same = Agreement("rls", 5, 5, None, True)
    settings = load_machine("sledge.toml").settings
    lines = [*iter_agreement_lines([*differing, same], settings, is_growing=False)]
    assert lines[0] == "rls: 5 rows, as in the replay bit for bit"
    assert len(lines) == 2
    assert lines[1].startswith("gate, ls, tls: differ from the replay")
    assert "[settings.noise]" in lines[1]
    stated = load_machine("sledge.toml", NOISE).settings
    assert len([*iter_agreement_lines(differing, stated, is_growing=False)]) == 3
