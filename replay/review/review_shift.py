"""The command `review`: write ledger, recording and page of a shift from its logs."""

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import polars as pl

from analysis.calibration.line.shared_errors import SharedErrors
from analysis.calibration.use.apply_calibration import LATER_LOG_FRAMES
from analysis.calibration.use.learnt_priors import describe_contradicted_learnt_priors
from analysis.cycles.calibrated_payloads import calibrate_cycles
from analysis.cycles.cycle_energy import ShiftEnergy, compute_shift_energy
from analysis.cycles.cycles_lost_in_gaps import find_spans_of_missing_channels_ns
from analysis.cycles.empty_machine import find_machine_change_by_empty_mass
from analysis.model.machine import Machine
from analysis.model.physical_units import NS_PER_S
from analysis.model.run_record import Provenance, Run
from analysis.weighing.empty_mass_step import find_empty_mass_step_of_manoeuvres
from estimators.errors import DataError, RecordingError
from estimators.file_digest import file_sha256
from estimators.threads import map_in_threads
from recordings import list_columns_by_frame, read_frame, write_recording
from recordings.report.atomic_output import stage_output_files
from recordings.review.review_state import (
    FORMAT,
    RECORDING,
    ChangedSetting,
    ReviewState,
    collect_review_state,
    list_changed_settings,
    read_review_state,
)
from recordings.review.reviewer_verdicts import parse_verdicts, read_verdict_text
from recordings.review.truncated_logs import TruncatedLog
from replay.calibration.apply_evidence import (
    CalibrationRequest,
    MachineCalibration,
    load_and_verify_calibration,
)
from replay.inputs.channel_inputs import (
    collect_versions_of_packages,
    convert_machine_without_settings_to_dict,
    list_channel_fields,
    list_input_files,
)
from replay.inputs.decode_cache import FOLDER as DECODED
from replay.inputs.decode_cache import decode_logs_in_parallel
from replay.inputs.time_line import compute_log_starts_ns, sort_logs_by_time
from replay.logs import Log, expand_log_folders, open_log
from replay.machines.machine_file import find_time_axis_of_machine, load_machine
from replay.pipeline import run
from replay.review.review_folder import lock_review_folder, refuse_review_of_other_shift
from replay.review.write_review import (
    OUTPUTS,
    ShiftCount,
    ShiftReview,
    decimate_position_track,
    write_review_files,
)

#: The recording of a shift keeps one row in this many of the frames that it thins.
_THINNED: Final = 10
_OF_THE_GRID: Final = ("excitation", "gate")
#: Frames that a shift's recording keeps unthinned.
_WHOLE: Final = (
    *("digging", "segments", "loads", "manoeuvres", "cycles", "shift", "findings"),
    *("nuisances", "responses", "learnt_errors", "budget", "masses", "verdict"),
)
#: Phrases by which readers report a file that ends before it was closed.
_TORN: Final = (
    *("breaks off", "did not finish it", "bytes at the end are lost", "incomplete chunk"),
    "is cut off and was not read",
)


@dataclass(frozen=True)
class ReviewOptions:
    """Options of a review.

    Attributes:
        overrides: `key=value` overrides of the machine file.
        calibration: request for calibrated masses.
        target_kg: target mass of a load.
        full: whether the recording keeps every sample of every frame.
        decimal_comma: whether ledger_table.csv is for a locale with decimal commas.
        replaces_other_shift: whether to replace a review in the folder that is of other logs.
    """

    overrides: Sequence[str] = ()
    calibration: CalibrationRequest | None = None
    target_kg: float | None = None
    full: bool = False
    decimal_comma: bool = False
    replaces_other_shift: bool = False


def review_shift(
    logs: Sequence[Path],
    machine_file: Path,
    folder: Path,
    options: ReviewOptions,
    on_stage: Callable[[str], None] = lambda _: None,
) -> ShiftReview:
    """Review a shift.

    All logs are on one time line and fitted together, so that the whole shift determines friction
    and nuisances. If a log is added or changes by a byte, all logs are replayed and fitted again;
    an unchanged shift is not. Decoded logs are kept in the folder.

    Args:
        logs: logs of the shift, in any order; a folder means all logs in it.
        machine_file: the machine file, or the name of a shipped one.
        folder: folder to write; an earlier review of any of these logs is replaced.
        options: see `ReviewOptions`.
        on_stage: called with the name of each stage as it begins.

    Raises:
        PayscopeError: the input is invalid; raised before anything is written.
    """
    machine, by, logged = load_machine(machine_file, options.overrides), None, ""
    if options.calibration is not None:
        by = load_and_verify_calibration(options.calibration)
        machine = by.require_calibrated_machine(
            by.copy_machine_with_calibrated_settings(machine), machine_file
        )
    logs = expand_log_folders(logs)
    with lock_review_folder(folder), ExitStack() as stack:
        verdicts = read_verdict_text(folder)
        parse_verdicts(verdicts, folder)  # errors in it are raised before the logs are read
        on_stage("open")
        opened = sort_logs_by_time(
            [
                stack.enter_context(open_log(path, time=find_time_axis_of_machine(machine)))
                for path in logs
            ],
            list_channel_fields(machine),
        )
        if by is not None:
            logged = by.refuse_logs_of_other_machine(opened)
        map_in_threads(lambda log: log.digests, opened)
        plain = _convert_review_inputs_to_dict(machine, options, by)
        key = digest_replay_inputs(opened, machine, is_full_recording=options.full)
        before = read_review_state(folder)
        if before is not None and not options.replaces_other_shift:
            refuse_review_of_other_shift(folder, before, opened)
        kept = read_replay_of_earlier_review(folder, before, key)
        made = kept or _replay_opened_shift(opened, machine, folder, (logs, machine_file), on_stage)
        cycles, against = made.cycles, ""
        if by is not None:
            stored_frames = read_frames_for_calibration(made, folder)
            against = describe_contradicted_learnt_priors(stored_frames["nuisances"])
            shared_errors = SharedErrors.from_frames(stored_frames)
            cycles = cycles if against else calibrate_cycles(cycles, by.calibration, shared_errors)
        shift = ShiftCount.count_cycles_with_verdicts(
            cycles, made.shift, made.t0_unix_ns, verdicts, folder
        )
        on_stage("write")
        targets = [folder / name for name in (RECORDING, *OUTPUTS)]
        if kept is not None:
            del targets[0]
        with stage_output_files(targets, overwrites=True) as stage:
            if made.run is not None:
                write_recording(
                    select_frames_for_recording(made.run, is_full_recording=options.full),
                    stage / RECORDING,
                )
                digest = file_sha256(stage / RECORDING)
                torn = find_truncated_logs(
                    opened, list_channel_fields(machine), made.run.provenance
                )
                energy = _compute_shift_energy_of_run(made.run, machine)
                state = collect_review_state(made.run, key, digest, plain, made.mixed, torn, energy)
            else:
                assert before is not None
                state = before
            says = "" if by is None else by.describe_calibration_in_sentence(logged)
            state = state.model_copy(update={"resolved": plain, "calibration": (says, against)})
            changes = None if before is None else _list_changes_since_earlier_review(before, state)
            page = shift.make_review_page(state, changes, made.track)
            write_review_files(page, stage)
    return ShiftReview.from_replay(folder, page, is_newly_replayed=kept is None)


@dataclass(frozen=True)
class ReplayedShift:
    """Replay of a shift, or what an earlier review has kept of it."""

    cycles: pl.DataFrame
    shift: pl.DataFrame
    t0_unix_ns: int
    track: pl.DataFrame | None
    run: Run | None = None
    mixed: str = ""


def _replay_opened_shift(
    opened_logs: list[Log],
    machine: Machine,
    folder: Path,
    named_logs: tuple[Sequence[Path], Path],
    on_stage: Callable[[str], None],
) -> ReplayedShift:
    count = len(opened_logs)
    own = decode_logs_in_parallel(
        opened_logs, machine, folder / DECODED, lambda done: on_stage(f"decode {done} of {count}")
    )
    try:
        made = run(own, machine, on_stage)
    except DataError as error:
        logs, machine_file = named_logs
        names = ", ".join(map(str, logs))
        raise DataError(f"{names} with {machine_file}: {error}") from None
    frames = made.frames
    return ReplayedShift(
        frames["cycles"],
        frames["shift"],
        made.provenance.t0_unix_ns,
        decimate_position_track(frames["aligned"]),
        made,
        make_empty_mass_warning(made, opened_logs, machine),
    )


def make_empty_mass_warning(run: Run, opened_logs: list[Log], machine: Machine) -> str:
    """Warn of logs that may be of two machines, or of a step of the empty mass; "" if neither."""
    starts = compute_log_starts_ns(
        opened_logs, list_channel_fields(machine), run.provenance.t0_unix_ns
    )
    found = find_machine_change_by_empty_mass(run.frames["manoeuvres"], list(starts.values()))
    if found is not None:
        return found.make_warning_text(list(starts)[found.log].path.name)
    step = find_empty_mass_step_of_manoeuvres(run.frames["manoeuvres"])
    return "" if step is None else step.text


def _compute_shift_energy_of_run(run: Run, machine: Machine) -> ShiftEnergy:
    """Compute the energy of the shift with the settings of its replay."""
    frames, settings = run.frames, run.provenance.settings
    gaps = find_spans_of_missing_channels_ns(frames["excitation"], frames["aligned"])
    return compute_shift_energy(frames, machine.model_copy(update={"settings": settings}), gaps)


def read_replay_of_earlier_review(
    folder: Path, earlier_review: ReviewState | None, inputs_digest: str
) -> ReplayedShift | None:
    """Read what an earlier review kept of its replay; None if its logs or settings differ."""
    recording = folder / RECORDING
    if earlier_review is None or earlier_review.key != inputs_digest or not recording.is_file():
        return None
    if file_sha256(recording) != earlier_review.recording_sha256:
        return None
    try:
        cycles, shift = (read_frame(recording, name) for name in ("cycles", "shift"))
        track = decimate_position_track(read_frame(recording, "aligned"))
    except RecordingError:
        return None
    return ReplayedShift(cycles, shift, earlier_review.t0_unix_ns, track)


def select_frames_for_recording(run: Run, *, is_full_recording: bool) -> Run:
    """Copy the run with the frames that a shift's recording keeps, thinned unless it is full."""
    if is_full_recording:
        return run
    frames: dict[str, pl.DataFrame] = {}
    for name, frame in run.frames.items():
        if name in _OF_THE_GRID:
            frames[name] = frame.gather_every(_THINNED)
        elif name == "aligned":
            places = ("t_ns", "latitude_deg", "longitude_deg", "boom_rad", "gap")
            frames[name] = frame.select(n for n in places if n in frame.columns).gather_every(
                _THINNED
            )
        elif name in _WHOLE:
            frames[name] = frame
    return Run(frames, run.provenance)


def read_frames_for_calibration(shift: ReplayedShift, folder: Path) -> Mapping[str, pl.DataFrame]:
    """Read the frames that calibrating the masses needs, from the replay or its recording."""
    if shift.run is not None:
        return shift.run.frames
    there = list_columns_by_frame(folder / RECORDING)
    return {
        name: read_frame(folder / RECORDING, name) for name in LATER_LOG_FRAMES if name in there
    }


def digest_replay_inputs(logs: list[Log], machine: Machine, *, is_full_recording: bool) -> str:
    """SHA-256 in hex of everything that a replay and its recording depend on."""
    whole = {
        "format": FORMAT,
        "inputs": [each.sha256 for log in logs for each in list_input_files(log)],
        "machine": convert_machine_without_settings_to_dict(machine),
        "settings": machine.settings.model_dump(mode="json"),
        "versions": collect_versions_of_packages(),
        "full": is_full_recording,
    }
    return hashlib.sha256(json.dumps(whole, sort_keys=True).encode()).hexdigest()


def _convert_review_inputs_to_dict(
    machine: Machine, options: ReviewOptions, calibration: MachineCalibration | None
) -> dict[str, Any]:
    """Everything that a review depends on besides its logs, as JSON values by name."""
    return {
        **convert_machine_without_settings_to_dict(machine),
        "settings": machine.settings.model_dump(mode="json"),
        "versions": collect_versions_of_packages(),
        "target_kg": options.target_kg,
        "decimal_comma": options.decimal_comma,
        "calibration": "none" if calibration is None else f"evidence {calibration.document.id}",
    }


def _list_changes_since_earlier_review(
    earlier_state: ReviewState, state: ReviewState
) -> list[ChangedSetting]:
    """Settings, options and logs that differ from the earlier review."""
    was, now = ({f"{x.name}: {x.sha256[:12]}" for x in s.inputs} for s in (earlier_state, state))
    logs = [ChangedSetting(f"log {name}", "there", "gone") for name in sorted(was - now)]
    logs += [ChangedSetting(f"log {name}", "–", "there") for name in sorted(now - was)]
    return [*logs, *list_changed_settings(earlier_state, state.resolved)]


def find_truncated_logs(
    logs: Sequence[Log], wanted_fields: Mapping[str, Sequence[str]], provenance: Provenance
) -> tuple[TruncatedLog, ...]:
    """Find the logs that end abruptly, in order of time.

    Args:
        logs: logs of the shift.
        wanted_fields: fields used by channels, by topic.
        provenance: provenance of the replay, with its losses and the origin of its times.
    """
    starts = compute_log_starts_ns(logs, wanted_fields, provenance.t0_unix_ns)
    ordered = list(starts)
    found: list[TruncatedLog] = []
    for number, log in enumerate(ordered, 1):
        losses = [
            str(loss)
            for loss in provenance.losses
            if any(words in loss.what for words in _TORN)
            and (loss.source == log.path.name or (log.path / loss.source).exists())
        ]
        topics = log.topics().filter(pl.col("topic").is_in(list(wanted_fields)))
        first, last = topics["start_ns"].min(), topics["end_ns"].max()
        if losses and isinstance(first, int) and isinstance(last, int):
            following = ordered[number : number + 1]
            found.append(
                TruncatedLog(
                    name=log.path.name,
                    number=number,
                    logs=len(ordered),
                    ends_s=(starts[log] + last - first) / NS_PER_S,
                    next_s=starts[following[0]] / NS_PER_S if following else None,
                    losses=tuple(losses),
                )
            )
    return tuple(found)
