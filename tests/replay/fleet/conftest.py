"""Six short recordings of three machines, their fleet file, and an engine that is none."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from benchmarks.fleet_logs import SerialEngine, recordings
from replay.fleet.log_sources import list_logs_of_sources
from replay.fleet.machine_setups import load_fleet
from replay.fleet.ray_engine import TaskEngine
from replay.fleet.run_fleet import FleetRun, replay_logs_of_fleet
from tests.replay.kept_replays import kept_replays

COUNT = 6
Run = Callable[..., FleetRun]


@pytest.fixture(scope="session")
def fleet_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`logs/unit-01/log_00000.mcap` and so on, and `fleet.toml`."""
    folder = tmp_path_factory.mktemp("fleet")
    recordings(folder, COUNT)
    return folder


@pytest.fixture(scope="session")
def run_in(fleet_folder: Path) -> Run:
    """Replay logs in this process, one after the other."""

    def call(
        destination: Path | str,
        source: Path | str = fleet_folder / "logs",
        fleet: Path = fleet_folder / "fleet.toml",
        *overrides: str,
        engine: Callable[[], TaskEngine] = SerialEngine,
        keeps_recordings: bool = False,
    ) -> FleetRun:
        logs = list_logs_of_sources([str(source)])
        return replay_logs_of_fleet(
            logs,
            load_fleet(fleet, overrides),
            str(destination),
            engine,
            keeps_recordings=keeps_recordings,
        )

    return call


@pytest.fixture(scope="session")
def kept(fleet_folder: Path, run_in: Run) -> Path:
    """Results of all six; not to be written to."""
    destination = fleet_folder / "results"
    with kept_replays():
        run_in(destination)
    return destination


@pytest.fixture
def results(kept: Path, tmp_path: Path) -> Path:
    """A copy of them."""
    return shutil.copytree(kept, tmp_path / "results")
