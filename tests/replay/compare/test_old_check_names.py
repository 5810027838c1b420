"""A recording with former names of checks is read, compared and explained as one of today."""

import json
from pathlib import Path

import polars as pl
import pytest

from recordings import read_frame, read_recording, write_recording
from replay import load_machine, open_log, run
from replay.machines.machine_file import find_time_axis_of_machine
from tests.replay.former_checks import run_with_former_names
from tests.replay.sledge import MACHINE, Payscope, sledge


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Recordings of one log whose force is late: with present names, and with former ones."""
    folder = tmp_path_factory.mktemp("names")
    late = sledge().with_columns(pl.col("force_N").shift(25, fill_value=0.0))
    late.write_csv(folder / "late.csv")
    (folder / "sledge.toml").write_text(MACHINE)
    machine = load_machine(folder / "sledge.toml")
    with open_log(folder / "late.csv", time=find_time_axis_of_machine(machine)) as log:
        replayed = run(log, machine)
    write_recording(replayed, folder / "now.rrd")
    write_recording(run_with_former_names(replayed), folder / "former.rrd")
    return folder


@pytest.mark.heavy
def test_the_former_names_are_in_the_file_and_its_fingerprint(folder: Path) -> None:
    stored = read_recording(folder / "former.rrd", stored_names=True)
    assert {"lag", "gated"} <= set(stored.frames["verdict"]["check"])
    assert "lag" in stored.frames["loads"]["withheld_for"][0].split(", ")
    assert stored.with_fingerprint() == stored


@pytest.mark.heavy
def test_it_compares_equal_in_both_orders(folder: Path, payscope: Payscope) -> None:
    for pair in (("now.rrd", "former.rrd"), ("former.rrd", "now.rrd")):
        said = payscope("compare", *(folder / name for name in pair), "--json")
        found = json.loads(said.out)
        assert said.status == 0, found
        assert found["equal"] is True
        assert found["checks"] == found["stages"] == []


def test_it_is_read_with_the_present_names(folder: Path) -> None:
    now, former = (read_recording(folder / f"{name}.rrd").frames for name in ("now", "former"))
    assert all(former[name].equals(frame) for name, frame in now.items())
    assert "force_delay_s" in set(read_frame(folder / "former.rrd", "verdict", ["check"])["check"])


@pytest.mark.heavy
def test_explain_show_and_query_say_the_present_names(folder: Path, payscope: Payscope) -> None:
    for words in (
        ("explain", "{}", "--json"),
        ("show", "{}", "verdict"),
        ("query", "{}", 'SELECT "check", value FROM verdict WHERE "check" LIKE \'%delay%\''),
    ):
        now, former = (
            payscope(*(word.format(folder / f"{name}.rrd") for word in words))
            for name in ("now", "former")
        )
        assert "force_delay_s" in now.out
        assert former.out == now.out
