"""The command `compare`: compare two recordings, reading a few columns at a time."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

import polars as pl

from analysis.compare.run_comparison import Comparison, compare_runs, do_runs_read_same_bytes
from analysis.model.run_record import Provenance, Run
from estimators.errors import RecordingError
from estimators.file_digest import file_sha256
from recordings import require_writable_recording
from recordings.report.atomic_output import refuse_input_as_output
from recordings.rrd.reader import OpenRecording, open_recording
from recordings.rrd.recording_table import list_columns_needed_for_drawing

if TYPE_CHECKING:
    from replay.calibration.apply_evidence import CalibrationRequest


class RecordedRun:
    """A recording to compare; columns are read on demand."""

    def __init__(
        self, recording: OpenRecording, request: "CalibrationRequest | None" = None
    ) -> None:
        """Read the recording's description.

        Args:
            recording: the open recording.
            request: evidence that calibrates its loads, if any.

        Raises:
            EvidenceError: the evidence does not apply to the recording.
        """
        self._held = recording
        self.path = recording.path
        self.provenance: Provenance = recording.provenance
        self.stages: Mapping[str, Sequence[str]] = recording.columns_by_frame
        self._loads: pl.DataFrame | None = None
        if request is not None and "loads" in self.stages:
            from analysis.calibration.use.apply_calibration import LATER_LOG_FRAMES
            from replay.calibration.apply_evidence import calibrate_loads_of_recording

            raw = {
                stage: recording.read_frame(stage)
                for stage in LATER_LOG_FRAMES
                if stage in self.stages
            }
            self._loads = calibrate_loads_of_recording(
                raw, self.provenance, request, recording.path
            )
            self.stages = {**self.stages, "loads": self._loads.columns}

    def read(self, stage: str, columns: Sequence[str]) -> pl.DataFrame:
        """Read some columns of a frame from the recording."""
        if stage == "loads" and self._loads is not None:
            return self._loads.select(columns)
        return self._held.read_frame(stage, columns)

    def read_run_with_displayed_columns(self) -> Run:
        """Read the columns that views draw, as a run."""
        wanted = {
            stage: list_columns_needed_for_drawing(stage, names)
            for stage, names in self.stages.items()
        }
        frames = {stage: self.read(stage, names) for stage, names in wanted.items() if names}
        return Run(frames, self.provenance)


@dataclass(frozen=True, slots=True)
class OverlayOutput:
    """Output for a recording of both runs.

    Attributes:
        path: recording to write; None writes none.
        overwrites: whether to replace an existing file.
    """

    path: Path | None = None
    overwrites: bool = False


_NOWHERE: Final = OverlayOutput()


def compare_recordings(
    path_a: Path,
    path_b: Path,
    overlay: OverlayOutput = _NOWHERE,
    *,
    relative_tolerance: float = 0.0,
    allows_different_logs: bool = False,
    calibration: "CalibrationRequest | None" = None,
) -> Comparison:
    """Compare two recordings, and optionally write both into one recording.

    Args:
        path_a: baseline recording.
        path_b: recording to compare with it.
        overlay: output for a recording of both.
        relative_tolerance: relative tolerance of numbers.
        allows_different_logs: whether the recordings may be of different logs; then only settings,
            masses and verdict are compared.
        calibration: evidence that calibrates the masses of both.

    Raises:
        RecordingError: a recording cannot be read, or their rows do not correspond.
        OutputError: the recording of both cannot be written.
    """
    if overlay.path is not None:
        refuse_input_as_output(overlay.path, [path_a, path_b])
        require_writable_recording(overlay.path, overwrites=overlay.overwrites)
    with open_recording(path_a) as first, open_recording(path_b) as second:
        mine, theirs = RecordedRun(first, calibration), RecordedRun(second, calibration)
        if not set(mine.stages) & set(theirs.stages):
            raise RecordingError(
                f"{path_a} and {path_b}: have no stage in common "
                f"({', '.join(mine.stages) or 'none'} | "
                f"{', '.join(theirs.stages) or 'none'}); compare replays of one log"
            )
        if not allows_different_logs and not do_runs_replay_same_log(mine, theirs):
            names = [
                ", ".join(each.name for each in replay.provenance.inputs) or "no file"
                for replay in (mine, theirs)
            ]
            raise RecordingError(
                f"{path_a} and {path_b}: are replays of different logs ({names[0]} | {names[1]}, "
                "by "
                "SHA-256), so their rows cannot be compared; give --other-logs to compare "
                "settings, masses and verdict only"
            )
        found = compare_runs(
            mine,
            theirs,
            relative_tolerance=relative_tolerance,
            do_rows_correspond=not allows_different_logs,
        )
        if overlay.path is not None:
            from recordings.compare.overlay_recording import (
                format_comparison_markdown,
                write_overlay_recording,
            )

            write_overlay_recording(
                mine.read_run_with_displayed_columns(),
                theirs.read_run_with_displayed_columns(),
                overlay.path,
                format_comparison_markdown(found, path_a.name, path_b.name),
                is_same_log=not allows_different_logs,
                overwrites=overlay.overwrites,
            )
        return found


def do_runs_replay_same_log(run_a: RecordedRun, run_b: RecordedRun) -> bool:
    """Whether both runs replay the same bytes, or one replays the other's recording."""
    return (
        do_runs_read_same_bytes(run_a.provenance, run_b.provenance)
        or has_run_replayed_recording(run_a.path, run_b.provenance)
        or has_run_replayed_recording(run_b.path, run_a.provenance)
    )


def has_run_replayed_recording(recording: Path, provenance: Provenance) -> bool:
    """Whether a run's input is this recording."""
    # reading a shift takes a second: most other recordings differ in size
    if [each.size_bytes for each in provenance.inputs] != [recording.stat().st_size]:
        return False
    return file_sha256(recording) == provenance.inputs[0].sha256
