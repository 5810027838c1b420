"""The command `run`: replay logs with a machine file, once or after each change of it."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import recordings  # its names are imported when first used
from analysis.compare.run_comparison import ValueChange, list_changed_settings_and_keys
from analysis.model.answer import Answer, make_answer
from analysis.model.machine import Machine
from estimators.errors import DataError, LogError, PayscopeError
from recordings.report.atomic_output import refuse_input_as_output
from replay.logs import open_log
from replay.machines.machine_file import (
    find_machine_file_or_shipped_one,
    find_time_axis_of_machine,
    load_machine,
    read_file_state,
)
from replay.pipeline import STAGES, run
from replay.runs.run_limits import LIMITS

if TYPE_CHECKING:
    from recordings.rrd.writer import LiveView
    from replay.calibration.apply_evidence import CalibrationRequest, MachineCalibration


@dataclass(frozen=True, slots=True)
class RecordingOutput:
    """Where a replay records to, and whether a viewer shows it.

    Attributes:
        path: path of the recording; None records nothing.
        overwrites: whether to replace an existing recording.
        live: whether to show it in the viewer while it is written.
        viewer: viewer that is already open; None starts one if `live`.
    """

    path: Path | None = None
    overwrites: bool = False
    live: bool = False
    viewer: "LiveView | None" = None


#: Stages of a recorded replay, in the order in which `on_stage` is called.
STEPS: Final = ("open", *STAGES, "record")

_NOWHERE: Final = RecordingOutput()


def replay_and_record_logs(
    logs: Sequence[Path],
    machine_file: Path,
    output: RecordingOutput = _NOWHERE,
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
        overrides: `key=value` overrides of the machine file.
        strict: whether to refuse logs with any loss.
        calibration: request for calibrated masses.
        on_stage: called with the name of each of `STEPS` as it begins.

    Raises:
        PayscopeError: the input is invalid; raised before anything is written.
    """
    machine = load_machine(machine_file, overrides)
    by: MachineCalibration | None = None
    if calibration is not None:
        # imported only when needed, so that a run begins sooner
        from replay.calibration.apply_evidence import load_and_verify_calibration

        by = load_and_verify_calibration(calibration)
        machine = by.require_calibrated_machine(
            by.copy_machine_with_calibrated_settings(machine), machine_file
        )
    if output.path is not None:
        recordings.require_writable_recording(output.path, overwrites=output.overwrites)
        refuse_input_as_output(output.path, (path for path in logs if path.exists()))
    # opened before the work, so that a missing display is reported at once
    viewer = open_requested_live_viewer(output)
    with ExitStack() as stack:
        on_stage("open")
        opened = [
            stack.enter_context(open_log(path, time=find_time_axis_of_machine(machine)))
            for path in logs
        ]
        if by is not None:
            by.refuse_logs_of_other_machine(opened)
        try:
            result = run(opened, machine, on_stage)
        except DataError as error:
            names = ", ".join(map(str, logs))
            raise DataError(f"{names} with {machine_file}: {error}") from None
        if strict and result.provenance.losses:
            first, *more = result.provenance.losses
            others = f" (and {len(more)} more)" if more else ""
            raise LogError(f"{first}{others}; leave out --strict to replay despite such losses")
        if by is not None:
            result = by.calibrate_masses_of_run(result)
        if output.path is not None:
            on_stage("record")
            recordings.write_recording(
                result, output.path, overwrites=output.overwrites, viewer=viewer
            )
    return make_answer(result, str(output.path) if output.path else None)


def open_requested_live_viewer(output: RecordingOutput) -> "LiveView | None":
    """Return the open viewer, or open one if it is requested; None if not."""
    if output.viewer is not None or not output.live:
        return output.viewer
    from recordings.rrd.viewer import start_waiting_viewer
    from recordings.rrd.writer import LiveView

    return LiveView(start_waiting_viewer())


def watch_machine_file(
    machine_file: Path,
    output: RecordingOutput,
    overrides: list[str],
    replay: Callable[[RecordingOutput], Answer],
    on_answer: Callable[[Answer, list[ValueChange]], None],
    on_error: Callable[[PayscopeError], None],
) -> None:
    """Replay now and after each change of the machine file, until interrupted.

    A viewer stays open in between: it keeps its tabs and its time cursor, and also shows the
    previous replay.

    Args:
        machine_file: file to watch.
        output: recording, replaced by each replay.
        overrides: `key=value` overrides of the file.
        replay: function that replays once and records as requested.
        on_answer: called with each answer and the keys changed since the previous replay.
        on_error: called with the error in a changed file; watching continues.

    Raises:
        PayscopeError: the first replay failed; raised as from `replay`.
    """
    from recordings.rrd.viewer import list_ids_of_shown_recordings, replace_recording_in_viewer

    # absolute, so that a removed file is not replaced by the shipped one of that name
    path = find_machine_file_or_shipped_one(machine_file).absolute()
    view = open_requested_live_viewer(output)
    last: Machine | None = None
    failed = False
    for _ in iter_machine_file_changes(path):
        try:
            machine = load_machine(path, overrides)
            changed = [] if last is None else list_changed_settings_and_keys(last, machine)
            if last is not None and not changed and not failed:
                continue  # a comment, or the file was touched
            before = list_ids_of_shown_recordings(view.address) if view else ()
            answer = replay(replace(output, viewer=view))
            if view:
                replace_recording_in_viewer(view.address, before)
        except PayscopeError as error:
            if last is None:
                raise
            failed = True
            on_error(error)
            continue
        last, failed = machine, False
        # our own recording may be replaced, and the viewer has its layout already
        output = replace(output, overwrites=True)
        view = view and replace(view, laid_out=True)
        on_answer(answer, changed)


def iter_machine_file_changes(path: Path) -> Iterator[None]:
    """Yield once at the start, after each change that has settled, and when the file vanishes."""
    seen, missed = read_file_state(path), 0
    yield
    while True:
        time.sleep(LIMITS.check_interval_s)
        now = read_file_state(path)
        missed = missed + 1 if now is None else 0
        if missed == LIMITS.checks_until_removed:
            seen = None  # if the same file reappears, it has changed
            yield
        if now in (None, seen):
            continue
        while True:
            time.sleep(LIMITS.check_interval_s)
            settled = read_file_state(path)
            if settled == now:
                break
            now = settled
        if now is not None:
            seen = now
            yield
