"""The command `explain`: say why an estimate is bad, and write a corrected machine file."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

from analysis.compare.run_comparison import list_changed_settings_and_keys
from analysis.explain import Explanation, make_explanation
from analysis.explain.explanation import COLUMNS, SMALL
from analysis.model.machine import Machine
from analysis.model.methods import RECURSIVE_METHODS
from analysis.model.run_record import Run
from estimators.errors import DataError, MachineError, RecordingError
from recordings.report.atomic_output import refuse_input_as_output, require_writable_output
from recordings.report.picture import require_writable_picture
from recordings.rrd.reader import OpenRecording, open_recording
from recordings.rrd.recording_table import list_columns_needed_for_drawing
from recordings.rrd.writer import SUFFIX
from replay.logs import open_log
from replay.machines.machine_file import find_time_axis_of_machine, load_machine

if TYPE_CHECKING:
    from replay.explain.try_proposals import CorrectedMachine

_SETTLING: Final = ("t_ns", "mass_kg", "mass_std_kg")
_RECURSIVE: Final = tuple(f"estimates/{name}" for name in RECURSIVE_METHODS)


@dataclass(frozen=True, slots=True)
class ExplainRequest:
    """Request for an explanation.

    Attributes:
        path: a recording, or a log.
        machine_file: machine file for a replay; None uses a recording as it is.
        overrides: `key=value` overrides of the machine file.
        at_s: time in s to explain; None for the whole run.
        picture: picture to write; None draws none.
        corrected_file: corrected machine file to write; None writes none.
        overwrites: whether to replace existing files.
    """

    path: Path
    machine_file: Path | None = None
    overrides: tuple[str, ...] = ()
    at_s: float | None = None
    picture: Path | None = None
    corrected_file: Path | None = None
    overwrites: bool = False


class ExplainedRun(NamedTuple):
    """Explanation of a run, and the corrected machine file if one was requested."""

    explanation: "Explanation"
    corrected_machine: "CorrectedMachine | None"


def explain_run_and_correct_machine(
    explain_request: ExplainRequest, on_stage: Callable[[str], None] = lambda _: None
) -> "ExplainedRun":
    """Explain a recording or a log; optionally draw it and write a corrected machine file.

    Args:
        explain_request: the request.
        on_stage: called with each stage of the replays when it begins.

    Returns:
        The explanation, and the corrected machine file with its effect; None if not requested.

    Raises:
        PayscopeError: the input is invalid; nothing has been written.
    """
    _refuse_contradictory_request(explain_request)
    whole = load_run_to_explain(explain_request, on_stage)
    _refuse_time_outside_run(explain_request, whole)
    explained = make_explanation(whole, explain_request.at_s)
    if explain_request.picture is not None:
        from recordings.explain.explanation_view import plot_explanation

        plot_explanation(
            whole, explained, explain_request.picture, overwrites=explain_request.overwrites
        )
    if explain_request.corrected_file is None or explain_request.machine_file is None:
        return ExplainedRun(explained, None)
    from replay.explain.try_proposals import MachineText, write_corrected_machine_file

    source = MachineText(explain_request.machine_file, explain_request.overrides)
    output = (explain_request.corrected_file, explain_request.overwrites)
    return ExplainedRun(
        explained,
        write_corrected_machine_file(explain_request.path, source, whole, output, on_stage),
    )


def _refuse_contradictory_request(explain_request: ExplainRequest) -> None:
    if explain_request.at_s is not None and not math.isfinite(explain_request.at_s):
        raise RecordingError(
            f"--at {explain_request.at_s}: is not a time; give seconds since the start"
        )
    if explain_request.machine_file is None and explain_request.path.suffix != SUFFIX:
        raise MachineError(
            f"{explain_request.path}: is not a recording ({SUFFIX}); to replay a log, give its "
            "machine file with -m"
        )
    inputs = [
        explain_request.path,
        *([explain_request.machine_file] if explain_request.machine_file else []),
    ]
    if explain_request.picture is not None:
        refuse_input_as_output(explain_request.picture, inputs)
        require_writable_picture(explain_request.picture, overwrites=explain_request.overwrites)
    if explain_request.corrected_file is not None:
        if explain_request.machine_file is None:
            raise MachineError(
                f"{explain_request.corrected_file}: --apply corrects a machine file; give that "
                "file with -m"
            )
        refuse_input_as_output(explain_request.corrected_file, inputs)
        require_writable_output(
            explain_request.corrected_file, overwrites=explain_request.overwrites
        )


def _refuse_time_outside_run(explain_request: ExplainRequest, run: Run) -> None:
    gate = run.frames.get("gate")
    if explain_request.at_s is None or gate is None or gate.is_empty():
        return
    first_s, last_s = (round(int(gate["t_ns"][place]) / 1e9, 1) for place in (0, -1))
    if not first_s <= round(explain_request.at_s, 1) <= last_s:
        raise RecordingError(
            f"{explain_request.path}: has no data at {explain_request.at_s:g} s; it has "
            f"{first_s:g} to {last_s:g} s"
        )


def load_run_to_explain(explain_request: ExplainRequest, on_stage: Callable[[str], None]) -> Run:
    """Load the frames to explain, from the recording or by replaying the log."""
    if explain_request.machine_file is None:
        with open_recording(explain_request.path) as held:
            return read_frames_for_explanation(
                held, is_picture_drawn=explain_request.picture is not None
            )
    machine = load_machine(explain_request.machine_file, explain_request.overrides)
    if explain_request.path.suffix == SUFFIX and explain_request.path.is_file():
        with open_recording(explain_request.path) as held:
            if "findings" in held.columns_by_frame and not _does_machine_differ_from_recorded(
                held, machine
            ):
                return read_frames_for_explanation(
                    held, is_picture_drawn=explain_request.picture is not None
                )
    # to explain a recording, nothing that replays a log is imported
    from replay.pipeline import run

    with open_log(explain_request.path, time=find_time_axis_of_machine(machine)) as log:
        try:
            return run(log, machine, on_stage)
        except DataError as error:
            raise DataError(
                f"{explain_request.path} with {explain_request.machine_file}: {error}"
            ) from None


def _does_machine_differ_from_recorded(recording: OpenRecording, machine: Machine) -> bool:
    """Whether the machine file differs from the machine that the recording was made with."""
    about = recording.provenance
    recorded = Machine.model_validate({**about.machine, "settings": about.settings})
    return bool(list_changed_settings_and_keys(recorded, machine))


def read_frames_for_explanation(recording: OpenRecording, *, is_picture_drawn: bool) -> Run:
    """Read the frames needed for an explanation or a picture."""
    recording.refuse_recording_without_frames()
    wanted: dict[str, Sequence[str]] = {}
    for name, columns in recording.columns_by_frame.items():
        if name in SMALL:
            wanted[name] = columns
        elif name in COLUMNS:
            kept = {
                *COLUMNS[name],
                *(list_columns_needed_for_drawing(name, columns) if is_picture_drawn else ()),
            }
            wanted[name] = [column for column in columns if column in kept]
        elif is_picture_drawn and name in _RECURSIVE:
            wanted[name] = [column for column in columns if column in _SETTLING]
    frames = {name: recording.read_frame(name, columns) for name, columns in wanted.items()}
    # rows that a recovered recording has lost must not pass for rows that the log never had
    lost = [each for each in recording.manifest.frames if each.name in frames]
    lost = [each for each in lost if frames[each.name].height != each.rows]
    if lost:
        more = f" (and {len(lost) - 1} more stages miss rows)" if len(lost) > 1 else ""
        raise RecordingError(
            f"{recording.path}: is incomplete: '{lost[0].name}' has "
            f"{frames[lost[0].name].height} of {lost[0].rows} rows{more}; replay the log"
        )
    return Run(frames, recording.provenance)
