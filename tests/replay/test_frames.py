"""Every frame of a real run, and of the recording kept of it, is the one that is declared."""

from pathlib import Path

import polars as pl
import pytest

from analysis.model.run_record import Run
from analysis.model.schema import FRAMES, find_frame_declaration
from recordings import read_recording, write_recording
from replay import load_machine, open_log, run
from replay.demo.run_demo import replay_simulated_campaign
from replay.simulation.scenario_file import load_scenario_file
from replay.simulation.simulate_logs import simulate_scenario_to_logs

PLANAR = Path(__file__).parents[2] / "examples" / "planar.toml"
METHODS = ("ls", "rls", "fgls", "tls", "huber", "rtls")


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Straight drives, spins, arcs and both at once, by every method and gate."""
    scenario = load_scenario_file(PLANAR)
    (path,) = simulate_scenario_to_logs(scenario, tmp_path_factory.mktemp("planar") / "planar.mcap")
    machine = load_machine(
        "cat262c.toml",
        [
            "channels.yaw_acc_rad_s2.derive=d/dt yaw_rate_rad_s",
            f"settings.trace.methods={list(METHODS)}".replace("'", '"'),
        ],
    )
    with open_log(path) as log:
        return run(log, machine)


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The smallest campaign that is calibrated."""
    campaign = ["campaign.loads_kg=[0,250]", "campaign.runs=2"]
    scenario = load_scenario_file(PLANAR.with_name("campaign.toml"), campaign)
    logs = simulate_scenario_to_logs(scenario, tmp_path_factory.mktemp("campaign") / "campaign.bag")
    return replay_simulated_campaign(logs, load_machine("cat262c.toml"))


@pytest.fixture(params=["whole", "campaign"])
def replayed(request: pytest.FixtureRequest) -> Run:
    return request.getfixturevalue(request.param)


def undeclared(frames: dict[str, pl.DataFrame]) -> list[str]:
    """Each column whose place or dtype is not the declared one."""
    wrong = []
    for name, frame in frames.items():
        if name.startswith("raw/"):
            begins = list(frame.schema.items())[:2]
            if begins != [("log_time_ns", pl.Int64), ("header_stamp_ns", pl.Int64)]:
                wrong.append(f"{name}: {begins}")
            continue
        declared = [
            (c.name, c.dtype) for c in find_frame_declaration(name).columns if c.name in frame
        ]
        pairs = zip(frame.schema.items(), declared, strict=True)
        wrong += [f"{name}: {here}, not {there}" for here, there in pairs if here != there]
    return wrong


@pytest.mark.heavy
def test_every_column_of_a_run_has_its_declared_place_and_dtype(replayed: Run) -> None:
    assert undeclared(dict(replayed.frames)) == []


@pytest.mark.heavy
def test_a_recording_gives_back_the_declared_dtypes(replayed: Run, tmp_path: Path) -> None:
    write_recording(replayed, tmp_path / "run.rrd")
    assert undeclared(dict(read_recording(tmp_path / "run.rrd").frames)) == []


def test_the_runs_hold_every_declared_frame_and_none_of_all_manoeuvres_is_empty(
    whole: Run, campaign: Run
) -> None:
    stages = {name.partition("/")[0] for run in (whole, campaign) for name in run.frames}
    # these are of a calibration's own recording
    of_evidence = {"line", "points", "readings", "runs"}
    # and these of logs that are weighed under one
    of_evidence |= {"responses", "learnt_errors"}
    assert stages - {"raw"} == set(FRAMES) - of_evidence
    assert {f"estimates/{method}" for method in METHODS} <= set(whole.frames)
    # nobody digs in these runs
    empty = {name for name, frame in whole.frames.items() if frame.is_empty()}
    assert empty == {"digging", "cycles"}
