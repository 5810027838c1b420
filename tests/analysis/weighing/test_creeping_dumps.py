"""A bucket that is emptied while the machine creeps is in neither load."""

from pathlib import Path

import pytest

from analysis.model.run_record import Run
from benchmarks.independent.machine_file import write_machine_file
from benchmarks.independent.mcap_log import write_mcap
from benchmarks.independent.shift_logs import ShiftLog, shift_log
from replay import load_machine, open_log
from replay.pipeline import run


@pytest.fixture(scope="module")
def creeping() -> ShiftLog:
    """Twenty minutes of hauling in reverse; each load is tipped out over a metre or two."""
    log = shift_log(95013, 0.4)
    assert "creeps to dump" in log.truth.habits
    return log


@pytest.fixture(scope="module")
def replayed(creeping: ShiftLog, tmp_path_factory: pytest.TempPathFactory) -> Run:
    folder: Path = tmp_path_factory.mktemp("creeping")
    paths = [folder / f"{number}.mcap" for number in range(len(creeping.files))]
    for topics, path in zip(creeping.files, paths, strict=True):
        write_mcap(topics, path)
    machine = folder / "machine.toml"
    write_machine_file(machine, creeping.stated, creeping.known)
    return run([open_log(path) for path in paths], load_machine(machine))


def test_the_tonnes_of_the_shift_hold(creeping: ShiftLog, replayed: Run) -> None:
    (shift,) = replayed.frames["shift"].to_dicts()
    assert shift["cycles_counted"] == len(creeping.truth.dump_s)
    error_kg = shift["payload_kg"] - 1e3 * creeping.truth.tonnes
    # without the rule a third of them, 11 U off
    assert abs(error_kg) < 2.0 * shift["payload_u_kg"]
