"""The demo: the paper's calibration campaign, simulated as real logs, through everything."""

import json
import shutil
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import polars as pl

from analysis.answer import answer
from analysis.calibrate import calibrate, rms_errors
from analysis.runs import run_estimates
from analysis.simulation import Scenario
from estimators.errors import OutputError
from recordings import plot_run, write_recording
from replay.commands.printing import plain_table
from replay.machine import load_machine, machine_path
from replay.pipeline import run
from replay.readers import open_log
from replay.simulate import simulate
from replay.write_log import truth_path

if TYPE_CHECKING:
    from rich.console import RenderableType

_MACHINE = Path("cat262c.toml")


@dataclass(frozen=True, slots=True)
class Demo:
    """What the demo found, and the files it made."""

    calibration: pl.DataFrame
    errors: pl.DataFrame
    answer: dict[str, Any]
    files: tuple[Path, ...]

    def to_dict(self) -> dict[str, Any]:
        """The same as plain values."""
        return {
            "calibration": self.calibration.to_dicts(),
            "errors": self.errors.to_dicts(),
            "answer": self.answer,
            "files": [str(path) for path in self.files],
        }


def demo(folder: Path, *, seed: int, force: bool, on_stage: Callable[[str], None]) -> Demo:
    """Simulate, replay, calibrate, record, draw.

    Args:
        folder: where the files go; made when it is not there.
        seed: of the simulated noise.
        force: whether files of an earlier demo may be replaced.
        on_stage: told the name of each stage as it begins.

    Raises:
        OutputError: a file is there already, or the folder cannot be written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made ({error.strerror})") from error
    on_stage("simulate")
    scenario = Scenario()
    scenario = scenario.model_copy(
        update={"sensors": scenario.sensors.model_copy(update={"seed": seed})}
    )
    logs = simulate(scenario, folder / "campaign.bag", force=force)
    machine_file = folder / _MACHINE.name
    shutil.copyfile(machine_path(_MACHINE), machine_file)
    machine = load_machine(machine_file)
    with ExitStack() as stack:
        replayed = run([stack.enter_context(open_log(path)) for path in logs], machine, on_stage)
    on_stage("calibrate")
    calibration = calibrate(run_estimates(replayed, _true_runs(logs)))
    replayed = replace(replayed, frames={**replayed.frames, "calibration": calibration})
    on_stage("record")
    recording = write_recording(replayed, folder / "campaign.rrd", force=force)
    picture = plot_run(replayed, folder / "campaign.png", force=force)
    return Demo(
        calibration,
        rms_errors(calibration),
        {**answer(replayed), "recording": str(recording)},
        (*logs, *map(truth_path, logs), machine_file, recording, picture),
    )


def _true_runs(logs: list[Path]) -> pl.DataFrame:
    """The truth of every run, in the logs' order, with unix times."""
    truths = [json.loads(truth_path(log).read_text(encoding="utf-8")) for log in logs]
    return pl.concat(pl.DataFrame(truth["runs"]) for truth in truths)


def render(result: Demo) -> "RenderableType":
    """Lay the result out for a terminal."""
    from rich.console import Group

    loads = plain_table(
        "load kg", "runs", "estimate kg", "± kg a run", "calibrated kg", "error kg", "left out kg"
    )
    loads.title = "Pooled least squares, means of nine runs, calibrated by (19)"
    for row in result.calibration.filter(pl.col("method") == "pooled").iter_rows(named=True):
        numbers = (
            row["estimate_kg"],
            row["estimate_std_kg"],
            row["calibrated_kg"],
            row["error_kg"],
            row["error_left_out_kg"],
        )
        loads.add_row(f"{row['load_kg']:.0f}", str(row["runs"]), *map(_kg, numbers))
    methods = plain_table("method", "in-sample kg", "one load left out kg", "of the load range")
    methods.title = "Root mean square errors of the load means"
    for table in (loads, methods):
        table.title_justify = "left"
    for row in result.errors.iter_rows(named=True):
        left_out = row["rmse_left_out_kg"]
        share = None if left_out is None else left_out / row["load_range_kg"]
        methods.add_row(
            row["method"],
            _kg(row["rmse_kg"]),
            _kg(left_out),
            "–" if share is None else f"{share:.1%}",
        )
    constant = result.errors["rmse_constant_kg"].drop_nulls()
    notes = [f"A constant predictor scores {constant[0]:.1f} kg."] if constant.len() else []
    made = [f"  {path}" for path in result.files]
    return Group(loads, "", methods, *notes, "", "Files:", *made)


def _kg(value: float | None) -> str:
    return "–" if value is None else f"{value:,.1f}"
