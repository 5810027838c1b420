"""The demo: the paper's calibration campaign, simulated as real logs, through everything."""

import shutil
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import polars as pl

from analysis import Machine, Run
from analysis.answer import Answer, answer
from analysis.calibration.straight_line import calibrate, rms_errors
from analysis.calibration.trials import run_estimates
from analysis.simulation import Scenario
from estimators.errors import OutputError
from recordings import plot_run, write_recording
from recordings.output import check_output, whole_file
from replay.machine_file import load_machine, machine_path, time_axis
from replay.pipeline import STAGES, run
from replay.readers import open_log
from replay.simulate import simulate
from replay.truth import true_trials, truth_path

_MACHINE = Path("cat262c.toml")
#: What `on_stage` is told, in order.
STEPS: Final = ("simulate", *STAGES, "record")


@dataclass(frozen=True, slots=True)
class Demo:
    """What the demo found, and the files it made."""

    calibration: pl.DataFrame
    errors: pl.DataFrame
    answer: Answer
    files: tuple[Path, ...]

    def to_dict(self) -> dict[str, Any]:
        """The same as plain values."""
        return {
            "calibration": self.calibration.to_dicts(),
            "errors": self.errors.to_dicts(),
            "answer": self.answer.to_dict(),
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
    machine_file = folder / _MACHINE.name
    recording, picture = folder / "campaign.rrd", folder / "campaign.png"
    for output in (machine_file, recording, picture):
        check_output(output, force=force)
    with whole_file(machine_file, force=force) as partial:
        shutil.copyfile(machine_path(_MACHINE), partial)
    on_stage("simulate")
    logs = simulate(Scenario().seeded(seed), folder / "campaign.bag", force=force)
    replayed = replay_campaign(logs, load_machine(machine_file), on_stage)
    on_stage("record")
    write_recording(replayed, recording, force=force)
    plot_run(replayed, picture, force=force)
    return Demo(
        replayed.frames["calibration"],
        rms_errors(replayed.frames["calibration"]),
        answer(replayed, str(recording)),
        (*logs, *map(truth_path, logs), machine_file, recording, picture),
    )


def replay_campaign(
    logs: Sequence[Path], machine: Machine, on_stage: Callable[[str], None] = lambda _: None
) -> Run:
    """Replay simulated logs in one time line and calibrate by their truth: a run with (19)."""
    with ExitStack() as stack:
        opened = [stack.enter_context(open_log(path, time=time_axis(machine))) for path in logs]
        replayed = run(opened, machine, on_stage)
    calibration = calibrate(run_estimates(replayed, true_trials(logs)))
    frames = {**replayed.frames, "calibration": calibration}
    return replace(replayed, frames=frames).fingerprinted()
