"""The command `explain`: why an estimate is bad, and a corrected machine file."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

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
from recordings.rrd.recording_table import list_drawn_columns
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
        force: whether to replace existing files.
    """

    path: Path
    machine_file: Path | None = None
    overrides: tuple[str, ...] = ()
    at_s: float | None = None
    picture: Path | None = None
    corrected_file: Path | None = None
    force: bool = False


def explain_run(
    request: ExplainRequest, on_stage: Callable[[str], None] = lambda _: None
) -> "tuple[Explanation, CorrectedMachine | None]":
    """Explain a recording or a log; optionally draw it and write a corrected machine file.

    Args:
        request: the request.
        on_stage: called with each stage of the replays when it begins.

    Returns:
        The explanation, and the effect of the corrected machine file; None if no proposal helps, or
        if it was not requested.

    Raises:
        PayscopeError: the input is wrong; nothing has been written then.
    """
    _check_request(request)
    whole = load_run_to_explain(request, on_stage)
    _check_time_of_interest(request, whole)
    explained = make_explanation(whole, request.at_s)
    if request.picture is not None:
        from recordings.explain.explanation_view import plot_explanation

        plot_explanation(whole, explained, request.picture, force=request.force)
    if request.corrected_file is None or request.machine_file is None:
        return explained, None
    from replay.explain.try_proposals import MachineText, write_corrected_machine_file

    source = MachineText(request.machine_file, request.overrides)
    output = (request.corrected_file, request.force)
    return explained, write_corrected_machine_file(request.path, source, whole, output, on_stage)


def _check_request(request: ExplainRequest) -> None:
    if request.at_s is not None and not math.isfinite(request.at_s):
        raise RecordingError(f"--at {request.at_s}: is not a time; name seconds since the start")
    if request.machine_file is None and request.path.suffix != SUFFIX:
        raise MachineError(
            f"{request.path}: is not a recording ({SUFFIX}); to replay a log, name its machine "
            "file with -m"
        )
    inputs = [request.path, *([request.machine_file] if request.machine_file else [])]
    if request.picture is not None:
        refuse_input_as_output(request.picture, inputs)
        require_writable_picture(request.picture, force=request.force)
    if request.corrected_file is not None:
        if request.machine_file is None:
            raise MachineError(
                f"{request.corrected_file}: --apply corrects a machine file; name that file with -m"
            )
        refuse_input_as_output(request.corrected_file, inputs)
        require_writable_output(request.corrected_file, force=request.force)


def _check_time_of_interest(request: ExplainRequest, run: Run) -> None:
    gate = run.frames.get("gate")
    if request.at_s is None or gate is None or gate.is_empty():
        return
    first_s, last_s = (round(int(gate["t_ns"][place]) / 1e9, 1) for place in (0, -1))
    if not first_s <= round(request.at_s, 1) <= last_s:
        raise RecordingError(
            f"{request.path}: has no data at {request.at_s:g} s; it has {first_s:g} to {last_s:g} s"
        )


def load_run_to_explain(request: ExplainRequest, on_stage: Callable[[str], None]) -> Run:
    """The frames to explain, from the recording or from a replay."""
    if request.machine_file is None:
        with open_recording(request.path) as held:
            return read_frames_for_explanation(held, pictured=request.picture is not None)
    machine = load_machine(request.machine_file, request.overrides)
    if request.path.suffix == SUFFIX and request.path.is_file():
        with open_recording(request.path) as held:
            if "findings" in held.stages and not _differs_from_recorded_machine(held, machine):
                return read_frames_for_explanation(held, pictured=request.picture is not None)
    # a recording is explained without what replays a log
    from replay.pipeline import run

    with open_log(request.path, time=find_time_axis_of_machine(machine)) as log:
        try:
            return run(log, machine, on_stage)
        except DataError as error:
            raise DataError(f"{request.path} with {request.machine_file}: {error}") from None


def _differs_from_recorded_machine(recording: OpenRecording, machine: Machine) -> bool:
    """Whether the machine file differs from that of the recording."""
    about = recording.provenance
    recorded = Machine.model_validate({**about.machine, "settings": about.settings})
    return bool(list_changed_settings_and_keys(recorded, machine))


def read_frames_for_explanation(recording: OpenRecording, *, pictured: bool) -> Run:
    """Read the frames needed for an explanation or a picture."""
    recording.refuse_without_frames()
    wanted: dict[str, Sequence[str]] = {}
    for name, columns in recording.stages.items():
        if name in SMALL:
            wanted[name] = columns
        elif name in COLUMNS:
            kept = {*COLUMNS[name], *(list_drawn_columns(name, columns) if pictured else ())}
            wanted[name] = [column for column in columns if column in kept]
        elif pictured and name in _RECURSIVE:
            wanted[name] = [column for column in columns if column in _SETTLING]
    frames = {name: recording.read(name, columns) for name, columns in wanted.items()}
    # what a recovered recording has lost must not pass for what its log does not show
    lost = [each for each in recording.manifest.frames if each.name in frames]
    lost = [each for each in lost if frames[each.name].height != each.rows]
    if lost:
        more = f" (and {len(lost) - 1} more stages miss rows)" if len(lost) > 1 else ""
        raise RecordingError(
            f"{recording.path}: is incomplete: '{lost[0].name}' has "
            f"{frames[lost[0].name].height} of {lost[0].rows} rows{more}; replay the log"
        )
    return Run(frames, recording.provenance)
