"""Write a growing recording and reports of a followed log, without repeats after a restart."""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from uuid import uuid4

import polars as pl

from analysis.model.machine import Machine
from analysis.online.follower import FollowedRow
from analysis.online.growing_log import copy_machine_with_causal_filters
from analysis.online.online_report import OnlineReport
from analysis.online.replay_report import ReplayReport
from estimators.errors import OutputError
from recordings import read_frame, read_provenance, require_writable_recording
from recordings.follow.growing_file import is_unfinished_recording
from recordings.follow.growing_recording import (
    FollowedLog,
    GrowingRecording,
    RecordingEnd,
    read_end_of_recording,
)
from recordings.report.atomic_output import AppendOnlyFile, refuse_input_as_output
from replay.follow.follow_logs import FollowedLogState
from replay.follow.report_file import (
    ReportFile,
    format_replay_markdown,
    format_reports_markdown,
    format_utc_time_of_day,
)
from replay.inputs.channel_inputs import convert_machine_without_settings_to_dict
from replay.logs import ACTIVE


@dataclass(frozen=True, slots=True)
class ResumePoint:
    """Point from which an interrupted recording continues.

    Attributes:
        until_unix_ns: time of its last row.
        end: end to append at, if the recording was cut off; None if it was completed before the log
            ended, and is therefore replaced once the follower reaches the same point.
    """

    until_unix_ns: int
    end: RecordingEnd | None


class FollowedOutputs:
    """A recording and a topic of reports, which continue where an earlier follower stopped.

    The log is read from its start each time; rows and reports already on disk are skipped. If an
    output can no longer be written, it is abandoned, and following continues.
    """

    def __init__(
        self,
        paths: Sequence[Path],
        machine: Machine,
        noise: pl.DataFrame | None,
        on_message: Callable[[str], None],
        *,
        output: Path | None = None,
        reports: Path | None = None,
        server: str | None = None,
        overwrites: bool = False,
    ) -> None:
        """Examine the existing outputs.

        Args:
            paths: paths of the logs.
            machine: the machine of the follower.
            noise: noise given to the follower, if any.
            on_message: called with a message when an output continues or is abandoned.
            output: recording to write, or None.
            reports: MCAP file of reports, or None.
            server: address of a viewer's server, or None.
            overwrites: whether to replace existing outputs instead of continuing them.

        Raises:
            OutputError: an output exists and is not of this log and machine file.
        """
        self._output, self._server, self._on_message = output, server, on_message
        self._identity = make_input_identity(paths, machine, noise)
        self._name = f"{machine.machine.name}: {', '.join(path.name for path in paths)}"
        self._recording: GrowingRecording | None = None
        self._file: AppendOnlyFile | None = None
        self._begins = output is not None or server is not None
        self._from = None
        if output is not None:
            self._from = find_recording_resume_point(
                output, paths, self._identity, machine, overwrites=overwrites
            )
        self._replay: ReplayReport | None = None
        self._topic: ReportFile | None = None
        if reports is not None:
            self._topic = ReportFile(reports, paths, self._identity, overwrites=overwrites)
        self._replayed = self._topic.replayed if self._topic else (0, False)
        self._recorded_ns = self._from.until_unix_ns if self._from else 0
        self._until_ns = max(self._recorded_ns, self._topic.until_unix_ns if self._topic else 0)
        if self._until_ns:
            on_message(
                f"continues after {format_utc_time_of_day(self._until_ns)} UTC without repeating "
                "what is on disc"
            )

    def write_rows_and_return_new_reports(
        self, following: FollowedLogState, online_rows: Sequence[FollowedRow]
    ) -> list[OnlineReport]:
        """Write rows, and return the reports that were not emitted before."""
        new_reports: list[OnlineReport] = []
        waiting: list[FollowedRow] = []
        for row in online_rows:
            waiting.append(row)
            if row.reports:
                text = format_reports_markdown(row.reports[-1])
                if self._replay is not None:
                    replay = self._replay.copy_with_age_at(row.reports[-1].unix_ns)
                    text += f"\n{format_replay_markdown(replay)}\n"
                self._record_rows(following, waiting, text)
                self._write_report_or_stop(
                    partial(ReportFile.append_new_reports, reports=row.reports)
                )
                new_reports += [each for each in row.reports if each.unix_ns > self._until_ns]
                waiting = []
        self._record_rows(following, waiting, None)
        return new_reports

    def write_replay_report_if_new(self, report: ReplayReport, unix_ns: int) -> bool:
        """Write the report of a replay, made at `unix_ns` of the log; return whether it is new."""
        self._replay = report
        if (report.unix_ns, report.is_whole) <= self._replayed:
            return False
        if self._topic is not None:
            self._write_report_or_stop(
                lambda topic: topic.append_replay_report_if_new(report, unix_ns)
            )
        return True

    def finish_files(self) -> None:
        """Close the recording and the file of reports, so that both are complete."""
        if self._recording is not None:
            self._recording.close_complete_file()
        if self._topic is not None:
            try:
                self._topic.close_with_index()
            except OSError as error:
                self._on_message(f"{self._topic.path}: {_describe_output_write_error(error)}")

    def _write_report_or_stop(self, write_report: Callable[[ReportFile], None]) -> None:
        if self._topic is None:
            return
        try:
            write_report(self._topic)
        except OSError as error:
            self._on_message(f"{self._topic.path}: {_describe_output_write_error(error)}")
            self._topic.close_without_index()
            self._topic = None

    def _record_rows(
        self,
        following: FollowedLogState,
        online_rows: Sequence[FollowedRow],
        answer_markdown: str | None,
    ) -> None:
        """Record rows; with a text, the file is also flushed."""
        if not online_rows or not self._begins:
            return
        try:
            recording = self._recording or self._create_recording_once_rows_exist(following)
            t0_ns = self._compute_first_row_unix_ns(following)
            recorded_ns = self._recorded_ns if self._from is None or self._from.end else 0
            recording.add_rows_to_write(
                [row for row in online_rows if row.t_ns + t0_ns > recorded_ns]
            )
            if answer_markdown is not None:
                recording.write_added_rows(answer_markdown)
            self._replace_recording_that_ends_earlier(online_rows[-1].t_ns + t0_ns)
        except OSError as error:
            self._on_message(f"{self._output}: {_describe_output_write_error(error)}")
            if self._recording is not None:
                self._recording.stop_writing_file()
            self._begins = self._server is not None and self._recording is not None

    def _create_recording_once_rows_exist(self, following: FollowedLogState) -> GrowingRecording:
        basis = following.follower.log.basis
        assert basis is not None, "there are rows"
        end = self._from.end if self._from else None
        about = FollowedLog(self._identity, basis.t0_unix_ns, str(uuid4()))
        if end is not None:
            if end.about.t0_unix_ns != basis.t0_unix_ns:
                raise OutputError(
                    f"{self._output}: is the recording of another log of this name: it begins at "
                    f"{format_utc_time_of_day(end.about.t0_unix_ns)}, this log at "
                    f"{format_utc_time_of_day(basis.t0_unix_ns)}; give another output, or --force "
                    "to replace it"
                )
            about = end.about
        if self._output is not None:
            path = self._output
            if self._from is not None and end is None:
                path = path.with_name(f".payscope-{path.name}")
            self._file = AppendOnlyFile(path, end.size if end else 0)
        self._recording = GrowingRecording(
            about, basis.machine.settings, self._name, file=self._file, server=self._server
        )
        return self._recording

    def _replace_recording_that_ends_earlier(self, written_until_unix_ns: int) -> None:
        """Replace the existing recording once the new one extends beyond its end."""
        if self._file is None or self._output is None or self._file.path == self._output:
            return
        if written_until_unix_ns > self._recorded_ns:
            self._file.move_to_path(self._output)

    def _compute_first_row_unix_ns(self, following: FollowedLogState) -> int:
        basis = following.follower.log.basis
        assert basis is not None, "there are rows"
        return basis.t0_unix_ns


def _describe_output_write_error(error: OSError) -> str:
    return f"not continued ({error.strerror}); it is complete up to here, and following continues"


def make_input_identity(paths: Sequence[Path], machine: Machine, noise: pl.DataFrame | None) -> str:
    """Identify the inputs by the names of the logs, and a digest of machine file and noise."""
    digest = hashlib.sha256(copy_machine_with_causal_filters(machine).model_dump_json().encode())
    digest.update(b"" if noise is None else noise.write_json().encode())
    return f"{', '.join(map(_make_name_of_closed_log, paths))}; {digest.hexdigest()}"


def find_recording_resume_point(
    output: Path, paths: Sequence[Path], input_identity: str, machine: Machine, *, overwrites: bool
) -> ResumePoint | None:
    """Find the point from which a recording continues; None if it is new.

    Raises:
        OutputError: without `overwrites`, a recording of another log or machine file exists, or a
            complete one of a log that has not grown.
    """
    refuse_input_as_output(output, (path for path in paths if path.exists()))
    if overwrites or not output.is_file() or output.stat().st_size == 0:
        require_writable_recording(output, overwrites=overwrites or output.is_file())
        return None
    if is_unfinished_recording(output):
        end = read_end_of_recording(output)
        if end is None:
            return None
        if end.about.identity != input_identity:
            raise OutputError(
                f"{output}: was recorded from {end.about.identity.partition(';')[0]}, or with "
                "another machine file, settings or noise; give another output, or --force to "
                "replace it"
            )
        return ResumePoint(end.about.t0_unix_ns + end.until_ns, end)
    if not has_log_grown(output, paths, machine):
        require_writable_recording(output, overwrites=False)
    last_ns = read_frame(output, "excitation", ["t_ns"])["t_ns"].max()
    assert isinstance(last_ns, int)
    return ResumePoint(read_provenance(output).t0_unix_ns + last_ns, None)


def has_log_grown(output: Path, paths: Sequence[Path], machine: Machine) -> bool:
    """Whether a recording is the causal replay of shorter versions of these logs."""
    about = read_provenance(output)
    inner = [
        each for path in paths for each in (sorted(path.iterdir()) if path.is_dir() else [path])
    ]
    sizes = {_make_name_of_closed_log(path): path.stat().st_size for path in inner if path.exists()}
    then = {each.name.removesuffix(ACTIVE): each.size_bytes for each in about.inputs}
    return (
        about.settings.filter.causal
        and about.machine == convert_machine_without_settings_to_dict(machine)
        and all(size <= sizes.get(name, 0) for name, size in then.items())
        and sum(sizes.values()) > sum(then.values())
    )


def _make_name_of_closed_log(path: Path) -> str:
    return path.name.removesuffix(ACTIVE)
