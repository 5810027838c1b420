"""The command `run`: logs and a machine file in, the answer and a recording out."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

import recordings  # its names are imported when first used
from analysis.model.answer import Answer, answer
from estimators.errors import DataError, LogError
from recordings.report.atomic_output import refuse_input_as_output
from replay.logs import open_log
from replay.machines.machine_file import load_machine, time_axis_of_machine
from replay.pipeline import STAGES, run

if TYPE_CHECKING:
    from recordings.rrd.writer import LiveView
    from replay.calibration.apply_evidence import CalibrationRequest, MachineCalibration


@dataclass(frozen=True, slots=True)
class RecordTo:
    """Output of a replay's recording.

    Attributes:
        path: path of the recording; None records nothing.
        force: whether to replace an existing recording.
        live: whether to show it in the viewer while it is written.
        viewer: open viewer to use for that.
    """

    path: Path | None = None
    force: bool = False
    live: bool = False
    viewer: "LiveView | None" = None


#: What `on_stage` is told, in order, of a replay that is recorded.
STEPS: Final = ("open", *STAGES, "record")


_NOWHERE: Final = RecordTo()


def replay_logs(
    logs: Sequence[Path],
    machine_file: Path,
    output: RecordTo = _NOWHERE,
    overrides: Sequence[str] = (),
    *,
    strict: bool = False,
    calibration: "CalibrationRequest | None" = None,
    on_stage: Callable[[str], None] = lambda _: None,
) -> Answer:
    """Replay logs in one time line and record the run.

    Args:
        logs: the logs.
        machine_file: the machine file, or the name of a shipped one.
        output: recording to write.
        overrides: `key=value`, of the machine file.
        strict: whether to refuse logs with any loss.
        calibration: request for calibrated masses.
        on_stage: called with the name of each of `STEPS` as it begins.

    Raises:
        PayscopeError: the input is invalid; raised before anything is written.
    """
    machine = load_machine(machine_file, overrides)
    by: MachineCalibration | None = None
    if calibration is not None:
        # a run begins without what it may not need
        from replay.calibration.apply_evidence import load_calibration

        by = load_calibration(calibration)
        machine = by.require_calibrated_machine(by.weighing_machine(machine), machine_file)
    if output.path is not None:
        recordings.require_writable_recording(output.path, force=output.force)
        refuse_input_as_output(output.path, (path for path in logs if path.exists()))
    # before the work: without a screen there is nothing to wait for
    viewer = open_live_view(output)
    with ExitStack() as stack:
        on_stage("open")
        opened = [
            stack.enter_context(open_log(path, time=time_axis_of_machine(machine))) for path in logs
        ]
        if by is not None:
            by.require_logs_of_machine(opened)
        try:
            result = run(opened, machine, on_stage)
        except DataError as error:
            names = ", ".join(map(str, logs))
            raise DataError(f"{names} with {machine_file}: {error}") from None
        if strict and result.provenance.losses:
            first, *more = result.provenance.losses
            others = f"and {len(more)} more; " if more else ""
            raise LogError(f"{first} ({others}leave out --strict to accept)")
        if by is not None:
            result = by.calibrate_run(result)
        if output.path is not None:
            on_stage("record")
            recordings.write_recording(result, output.path, force=output.force, viewer=viewer)
    return answer(result, str(output.path) if output.path else None)


def open_live_view(output: RecordTo) -> "LiveView | None":
    """The viewer that shows the recording: the open one, or a new one where it is asked for."""
    if output.viewer is not None or not output.live:
        return output.viewer
    from recordings.rrd.viewer import start_viewer
    from recordings.rrd.writer import LiveView

    return LiveView(start_viewer())
