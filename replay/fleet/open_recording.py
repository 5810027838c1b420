"""The command `fleet open`: show the recording of a result in the viewer."""

import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import polars as pl

from estimators.errors import FleetError
from recordings import write_recording
from replay.fleet.gathered_tables import FleetResults
from replay.fleet.log_sources import list_fleet_logs
from replay.fleet.machine_setups import make_machine_setups, setup_of_day
from replay.fleet.recording_task import fetch_log, replay_log_with_setup
from replay.fleet.results_layout import ResultName
from replay.logs import open_log
from replay.machines.machine_file import time_axis_of_machine


@contextmanager
def recording_of_result(results: FleetResults, key: str) -> Generator[Path]:
    """Context with the recording of a result, replayed from its log if it was not kept.

    Args:
        results: results of a fleet.
        key: key of the result, or its first characters.

    Raises:
        FleetError: no result or several match the key, or the log no longer exists.
        PayscopeError: the log cannot be replayed.
    """
    found = results.results.filter(pl.col("key").str.starts_with(key))
    if found.height != 1:
        said = "several results begin" if found.height else "no result begins"
        raise FleetError(f"{results.store.place}: {said} with '{key}'; keys are in table results")
    row = found.row(0, named=True)
    name = ResultName(row["machine"], row["day"], row["key"])
    store = results.store
    with tempfile.TemporaryDirectory(prefix="payscope-") as folder:
        recording = Path(folder) / f"{name.key}.rrd"
        if store.has_object(name.recording):
            store.fetch(name.recording, recording)
        else:
            _find_recording(results, row["source"], name.machine, recording)
        yield recording


def _find_recording(results: FleetResults, source: str, machine: str, recording: Path) -> None:
    known = results.last_run.machines.get(machine)
    if known is None:
        raise FleetError(f"{source}: the last run has no machine '{machine}'; run the fleet again")
    (log,) = list_fleet_logs([source])
    setups = make_machine_setups(machine, known.files, lenient=True)
    with (
        fetch_log(log) as path,
        open_log(path, time=time_axis_of_machine(setups[-1].machine)) as opened,
    ):
        first = opened.topics()["start_ns"].min()
        day = setups[-1].local_day_or_none(first if isinstance(first, int) else None)
        write_recording(replay_log_with_setup(opened, setup_of_day(setups, day), source), recording)
