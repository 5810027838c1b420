"""Replay a followed log in the background: one replay at a time, in a process of low priority.

The process opens the log as it is on disk with the readers of `run`, which accept unfinished logs.
It is started once, and takes requests as lines of JSON; it ends when its input ends, and therefore
also when the follower is killed.
"""

import contextlib
import json
import os
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import Any, Final, Self

from analysis.model.machine import Machine
from analysis.model.run_record import Run
from analysis.online.replay_report import ReplayReport, ReplayValidity, make_replay_report
from estimators.errors import DataError, PayscopeError, join_to_one_line
from replay.follow.follow_limits import LIMITS
from replay.logs import ACTIVE, open_log
from replay.machines.machine_file import find_time_axis_of_machine

#: Variables that limit libraries to one thread, since the share is that of one core.
_ONE_THREAD: Final = dict.fromkeys(
    ("POLARS_MAX_THREADS", "NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"
)
#: Seconds between polls for the last replay, and until `on_wait` is called.
_LOOK_S, _PATIENCE_S = 0.02, 2.0
#: File beside a database in which SQLite keeps the newest rows.
_NEWEST_ROWS: Final = "-wal"
#: Files beside a database that readers change, or that have no rows.
_WITHOUT_ROWS: Final = ("-shm", "-journal")

_SizeAndModificationTimeByFile = dict[str, tuple[int, int]]


class BackgroundReplays:
    """Replays of the log so far, on request and within a share of a processor core.

    A replay begins once the processor time of the previous one is at most the share of the time
    since that one began. The last replay, of the whole log, begins at once. A process that ends
    without a result is reported in one line, and the next replay starts another.

    Attributes:
        processor_s: processor time of all replays so far.
    """

    def __init__(
        self,
        logs: Sequence[Path],
        machine: Machine,
        on_message: Callable[[str], None],
        *,
        share: float = LIMITS.replay_share_1,
    ) -> None:
        """Initialise: the first replay starts the process.

        Args:
            logs: paths of the log; a `.bag.active` is found under its final name as well.
            machine: the machine as read when following began, with the settings of `run`.
            on_message: called with a line when a process has ended.
            share: largest share of one core; 0 for no replays.
        """
        self.processor_s = 0.0
        self._logs, self._machine = logs, machine
        self._on_message, self._share = on_message, share
        self._process: subprocess.Popen[bytes] | None = None
        self._output = bytearray()
        self._is_wanted = self._is_underway = self._is_last = False
        self._began_s, self._next_s = 0.0, 0.0
        self._ended = 0
        #: size and modification time of each file when the current or last replay began
        self._replayed_files: _SizeAndModificationTimeByFile = {}
        self._newest: ReplayReport | None = None

    def __enter__(self) -> Self:
        """Start with a replay if much is recorded already, since it is faster than following."""
        if (
            sum(size for size, _ in read_log_sizes_and_modification_times(self._logs).values())
            >= LIMITS.worth_replaying_bytes
        ):
            self.request_replay_of_log_so_far()
            self.take_result_and_start_next()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.kill_replay_process()

    @property
    def process_id(self) -> int | None:
        """Id of the process; None before the first replay."""
        return self._process.pid if self._process else None

    def request_replay_of_log_so_far(self) -> None:
        """Request a replay of the log so far, as soon as the share of the processor allows it."""
        self._is_wanted = True

    def take_result_and_start_next(self) -> ReplayReport | None:
        """Return the result of a finished replay, or None; start the next if due. Never waits."""
        report = self._take_result_of_process() if self._is_underway else None
        is_due = self._is_wanted and self._share > 0.0 and time.monotonic() >= self._next_s
        if is_due and not self._is_underway and self._ended < LIMITS.max_ended_processes:
            self._is_wanted = False
            if (
                self._replayed_files != read_log_sizes_and_modification_times(self._logs)
                or not self._replayed_files
            ):
                self._begin_replay(is_last=False)
        return report

    def wait_for_replay_of_whole_log(
        self,
        on_wait: Callable[[], None],
        is_skipped: Callable[[], bool] = lambda: False,
        *,
        is_growing: bool = False,
    ) -> ReplayReport | None:
        """Wait for the replay of the whole log, once it is no longer followed; it may be done.

        Returns None if there are no replays, if it is skipped, or if the processes end without a
        result. Data recorded after this call may be missing.

        Args:
            on_wait: called once if the result takes a while.
            is_skipped: called repeatedly while waiting; True ends the replay without a result.
            is_growing: whether the log may still be recorded; tables are then read up to their
                last complete line.
        """
        if self._share <= 0.0 or is_skipped():
            return None
        now = read_log_sizes_and_modification_times(self._logs)
        if self._replayed_files != now or not now:
            self._newest = None
            if self._is_underway:
                self.kill_replay_process()  # its log was incomplete, so it must be repeated
        began, is_told = time.monotonic(), False
        for _ in range(LIMITS.max_last_replays):
            if not self._is_underway and self._newest is None:
                self._begin_replay(is_last=True, is_growing=is_growing)
            while self._is_underway:
                self._take_result_of_process()
                if is_skipped():
                    return None
                time.sleep(_LOOK_S)
                if not is_told and time.monotonic() - began > _PATIENCE_S:
                    is_told = True
                    on_wait()
            if self._newest is not None:
                return replace(self._newest, is_whole=True)
        return None

    def kill_replay_process(self) -> None:
        """Kill the process, if there is one, even during a replay."""
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
            self._process = None
        self._is_underway = False

    def _begin_replay(self, *, is_last: bool, is_growing: bool = True) -> None:
        self._is_wanted, self._is_last, self._newest = False, is_last, None
        self._began_s = time.monotonic()
        try:
            process = self._process or start_replay_process()
        except OSError as error:  # no memory or no more processes
            self._warn_of_unexpected_end(f"could not be started: {error.strerror}")
            return
        self._process, self._output, self._is_underway = process, bytearray(), True
        # a growing table is copied up to its last complete line, so that no number is truncated
        names = [find_path_after_closing(path) for path in self._logs]
        is_copied = is_growing and any(is_text_table(path) for path in names)
        asked = {
            "logs": [str(path) for path in names],
            # only the keys set in the file, so that the others are determined from the log
            "machine": self._machine.model_dump(mode="json", exclude_unset=True),
            "is_copied": is_copied,
        }
        self._replayed_files = (
            {} if is_copied else read_log_sizes_and_modification_times(self._logs)
        )
        assert process.stdin is not None
        with contextlib.suppress(BrokenPipeError):  # reading its output will show that it ended
            process.stdin.write(json.dumps(asked).encode() + b"\n")
            process.stdin.flush()

    def _take_result_of_process(self) -> ReplayReport | None:
        process = self._process
        assert process is not None
        assert process.stdout is not None
        with contextlib.suppress(BlockingIOError):
            while part := os.read(process.stdout.fileno(), LIMITS.read_bytes):
                self._output += part
                if part.endswith(b"\n"):
                    return self._note_finished_replay(
                        ReplayReport.from_dict(json.loads(self._output))
                    )
            self._report_ended_process(process)
        return None

    def _note_finished_replay(self, report: ReplayReport) -> ReplayReport:
        self._ended = 0
        self._note_processor_time(report.processor_s)
        self._newest = report
        return report

    def _report_ended_process(self, process: "subprocess.Popen[bytes]") -> None:
        """Report a process that has ended without a result, by `on_message`."""
        status = process.wait()
        self.kill_replay_process()
        how = f"by signal {-status}" if status < 0 else f"with status {status}"
        self._warn_of_unexpected_end(f"has ended {how}")

    def _warn_of_unexpected_end(self, exit_text: str) -> None:
        self._ended += 1
        self._is_wanted, self._replayed_files = True, {}
        self._note_processor_time(time.monotonic() - self._began_s)
        if self._is_last:
            self._on_message(f"the process of the last replay {exit_text}")
            return
        more = (
            "the next replay starts another"
            if self._ended < LIMITS.max_ended_processes
            else "no more start"
        )
        self._on_message(f"the process of the replay {exit_text}; following goes on, {more}")

    def _note_processor_time(self, processor_s: float) -> None:
        self.processor_s += processor_s
        self._is_underway = False
        if self._share > 0.0:
            self._next_s = self._began_s + processor_s / self._share


def start_replay_process() -> "subprocess.Popen[bytes]":
    """Start the process that replays; reading its output does not block."""
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", "replay.follow.background_replay"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=os.environ | _ONE_THREAD,
        start_new_session=True,  # ctrl-C reaches only the follower, which ends this process last
    )
    assert process.stdout is not None
    os.set_blocking(process.stdout.fileno(), False)
    return process


def find_path_after_closing(path: Path) -> Path:
    """Find a log's path: a bag loses its suffix `.active` when its recorder closes it."""
    inner = path.with_suffix("")
    return inner if path.suffix == ACTIVE and not path.exists() and inner.exists() else path


def is_text_table(path: Path) -> bool:
    """Whether a file that can be followed is a text table."""
    return path.is_file() and path.suffix.lower() not in (ACTIVE, ".bag", ".mcap", ".db3")


def read_log_sizes_and_modification_times(logs: Sequence[Path]) -> _SizeAndModificationTimeByFile:
    """Read size in bytes and time of change in ns of each file of a log, by its final name."""
    found: _SizeAndModificationTimeByFile = {}
    for log in map(find_path_after_closing, logs):
        files = [log, log.with_name(f"{log.name}{_NEWEST_ROWS}")]
        with contextlib.suppress(FileNotFoundError):
            files = sorted(log.iterdir()) if log.is_dir() else files
        for path in files:
            with contextlib.suppress(FileNotFoundError):  # removed or renamed just now
                about = path.stat()
                if not path.name.endswith(_WITHOUT_ROWS):
                    found[str(path).removesuffix(ACTIVE)] = about.st_size, about.st_mtime_ns
    return found


def replay_log_so_far(logs: Sequence[Path], machine: Machine, *, is_copied: bool) -> Run:
    """Replay a log as it is on disk, as `run` does.

    Args:
        logs: paths of the log.
        machine: channels and settings.
        is_copied: whether tables are copied up to their last complete line.

    Raises:
        PayscopeError: the log is invalid, or there is too little data.
    """
    from replay.pipeline import run

    with ExitStack() as opened:
        if is_copied:
            folder = Path(opened.enter_context(TemporaryDirectory(prefix="payscope-")))
            logs = [
                copy_complete_table_lines(path, folder) if is_text_table(path) else path
                for path in logs
            ]
        run_logs = [
            opened.enter_context(open_log(path, time=find_time_axis_of_machine(machine)))
            for path in logs
        ]
        return run(run_logs, machine)


def copy_complete_table_lines(path: Path, folder: Path) -> Path:
    """Copy a text table up to its last complete line into a folder, and return the copy's path."""
    data = path.read_bytes()
    copy = folder / path.name
    copy.write_bytes(data[: data.rfind(b"\n") + 1])
    return copy


def serve_replay_requests() -> None:
    """Serve replay requests, lines of JSON on stdin, until its end; print each report as a line."""
    with contextlib.suppress(AttributeError, OSError):  # not available on every system
        os.nice(LIMITS.replay_niceness)
    requests: queue.Queue[Mapping[str, Any]] = queue.Queue()

    def read_requests() -> None:
        for line in sys.stdin:
            requests.put(json.loads(line))
        os._exit(0)  # the follower has ended: abandon any replay

    threading.Thread(target=read_requests, daemon=True).start()
    used_s = 0.0
    while True:
        report = serve_replay_request(requests.get())
        # includes the start of the process, and reading before a fault
        now_s = time.process_time()
        report, used_s = replace(report, processor_s=now_s - used_s), now_s
        sys.stdout.write(json.dumps(report.to_dict()) + "\n")
        sys.stdout.flush()


def serve_replay_request(request_json: Mapping[str, Any]) -> ReplayReport:
    """Replay as requested, and report the result, or the reason if the replay failed."""
    try:
        result = replay_log_so_far(
            [Path(path) for path in request_json["logs"]],
            Machine.model_validate_json(json.dumps(request_json["machine"])),
            is_copied=request_json["is_copied"],
        )
        return make_replay_report(result)
    except DataError as error:
        return make_report_of_failed_replay(str(error), "none_yet")
    except (PayscopeError, OSError) as error:
        return make_report_of_failed_replay(str(error), "failed")
    except Exception as error:  # noqa: BLE001  whoever follows sees no traceback of this process
        return make_report_of_failed_replay(f"{type(error).__name__}: {error}", "failed")


def make_report_of_failed_replay(fault_text: str, validity: ReplayValidity) -> ReplayReport:
    """Make the report of a replay without a result."""
    return ReplayReport("replay", 0, 0.0, 0.0, False, validity, fault=join_to_one_line(fault_text))


if __name__ == "__main__":
    serve_replay_requests()
