"""The command `show`: read rows of a recording's frame between two times of the run."""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Self

import polars as pl

from analysis.model.schema import FRAMES, Frame
from analysis.stages.signals.timestamps import FIRST_DATE_NS
from estimators.errors import RecordingError, suggest_choice
from recordings import list_columns_by_frame, read_frame, read_provenance
from recordings.rrd.recording_window import refuse_invalid_time_range

if TYPE_CHECKING:
    from replay.calibration.apply_evidence import CalibrationRequest


@dataclass(frozen=True, slots=True)
class RecordedStage:
    """Frame of a recording.

    Attributes:
        recording: path of the recording.
        name: name of the frame.
        rows: rows as stored.
        t0_unix_ns: Unix time of the run's start.
        timezone: time zone in which times are displayed.
    """

    recording: Path
    name: str
    rows: pl.DataFrame
    t0_unix_ns: int
    timezone: str

    @classmethod
    def read_frame_as_stage(cls, recording: Path, frame_name: str) -> Self:
        """Read a frame of a recording.

        Raises:
            RecordingError: the file is not a recording, or has no such frame.
        """
        held = list_columns_by_frame(recording)
        if frame_name not in held:
            raise RecordingError(
                f"{recording}: no frame '{frame_name}'; {suggest_choice(frame_name, held)}"
            )
        about = read_provenance(recording)
        zone = str(about.machine.get("machine", {}).get("timezone", "UTC"))
        return cls(recording, frame_name, read_frame(recording, frame_name), about.t0_unix_ns, zone)

    @property
    def time_column(self) -> str | None:
        """Column that places the rows in time, if any."""
        if self.name.startswith("raw/"):
            return "log_time_ns"
        declared: Frame = FRAMES[self.name.partition("/")[0]]
        return declared.time_column

    def apply_calibration_to_masses(self, calibration_request: "CalibrationRequest") -> Self:
        """Calibrate the masses of the frame `loads`.

        Raises:
            RecordingError: the frame is not `loads`.
            EvidenceError: the evidence is refused.
        """
        if self.name != "loads":
            raise RecordingError(
                f"{self.recording}: a calibration applies to frame 'loads', not to '{self.name}'; "
                "name loads"
            )
        from analysis.calibration.use.apply_calibration import LATER_LOG_FRAMES
        from replay.calibration.apply_evidence import calibrate_loads_of_recording

        about, there = read_provenance(self.recording), list_columns_by_frame(self.recording)
        frames = {
            name: read_frame(self.recording, name) for name in LATER_LOG_FRAMES if name in there
        }
        return replace(
            self,
            rows=calibrate_loads_of_recording(frames, about, calibration_request, self.recording),
        )

    def select_rows_between(self, start_s: float | None, end_s: float | None) -> Self:
        """Select the rows between two times of the run in s, including both.

        Raises:
            RecordingError: the frame has no time, or the range is invalid.
        """
        if start_s is None and end_s is None:
            return self
        refuse_invalid_time_range(self.recording, start_s, end_s)
        column = self._require_time_column()
        seconds = self._make_time_since_start_expression(column) / 1e9
        rows = self.rows
        if start_s is not None:
            rows = rows.filter(seconds >= start_s)
        if end_s is not None:
            rows = rows.filter(seconds <= end_s)
        return replace(self, rows=rows)

    def select_rows_at_second(self, second: float) -> Self:
        """Select the rows at a time of the run in s: whose span contains it, else the last before.

        Raises:
            RecordingError: the frame has no time, or the time is invalid.
        """
        if not math.isfinite(second):
            raise RecordingError(f"--at {second}: is not a time; give seconds since the start")
        column = self._require_time_column()
        start = self._make_time_since_start_expression(column) / 1e9
        if "end_t_ns" in self.rows.columns:
            # a row without a start or an end is about the whole log
            inside = (start <= second).fill_null(True) & (
                pl.col("end_t_ns") / 1e9 >= second
            ).fill_null(True)
            return replace(self, rows=self.rows.filter(inside))
        held = self.rows.filter(start <= second).sort(column)
        if "axis" in held.columns:  # a row per window of one axis
            return replace(self, rows=held.group_by("axis", maintain_order=True).tail(1))
        return replace(self, rows=held.tail(1))

    def make_frame_with_readable_times(self) -> pl.DataFrame:
        """Rows with readable times: seconds since the start, and local time if the log is dated."""
        column = self.time_column
        if column is None:
            return self.rows
        since_ns = self._make_time_since_start_expression(column)
        seconds = (since_ns / 1e9).alias("t_s")
        rest = pl.exclude(column, "header_stamp_ns")
        if self.t0_unix_ns < FIRST_DATE_NS:
            return self.rows.select(seconds, rest)
        utc = pl.from_epoch(since_ns + self.t0_unix_ns, time_unit="ns").dt.replace_time_zone("UTC")
        local = utc.dt.convert_time_zone(self.timezone).dt.strftime("%F %T%.3f")
        return self.rows.select(local.alias(f"local ({self.timezone})"), seconds, rest)

    def _require_time_column(self) -> str:
        column = self.time_column
        if column is None:
            raise RecordingError(
                f"{self.recording}: frame '{self.name}' has no time; leave out --from, --to and "
                "--at"
            )
        return column

    def _make_time_since_start_expression(self, column: str) -> pl.Expr:
        """Make the expression of the time in ns since the first sample, from stamp or grid time."""
        return pl.col(column) - (self.t0_unix_ns if column == "log_time_ns" else 0)
