"""Task of one recording: replay it on a node and store the result, or replay it again to view it.

The task enforces its own limits of time and memory. A task that exceeds them is interrupted, with
the reason. If it hangs in a library and cannot be interrupted, its process is ended; the engine
restarts it a few times, and then gives the task up.
"""

import datetime as dt
import faulthandler
import os
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from types import FrameType
from typing import Final, Literal

import polars as pl

from analysis.calibration.line.shared_errors import SharedErrors
from analysis.calibration.use.learnt_priors import describe_contradicted_learnt_priors
from analysis.cycles.calibrated_payloads import calibrate_cycles
from analysis.cycles.shift_totals import recompute_shift_totals
from analysis.fleet.daily_figures import UNDATED
from analysis.fleet.fleet_tables import GATE_SHARES, QUALITY, make_result_row, make_tables_of_run
from analysis.model.run_record import Run
from estimators.errors import DataError, FleetError, LogError, PayscopeError
from estimators.file_digest import file_sha256
from recordings import write_recording
from recordings.review.review_state import collect_review_state
from replay.fleet.engine_limits import LIMITS
from replay.fleet.gathered_tables import FleetResults
from replay.fleet.log_sources import FleetLog, list_logs_of_sources
from replay.fleet.machine_setups import (
    MachineSetup,
    choose_setup_valid_on_day,
    make_setups_of_machine,
)
from replay.fleet.object_store import ObjectStore, open_cached_store
from replay.fleet.results_layout import MARK, ResultName, digest_result_key, write_result_tables
from replay.inputs.channel_inputs import collect_versions_of_packages
from replay.logs import Log, open_log
from replay.machines.machine_file import find_time_axis_of_machine
from replay.pipeline import run

Status = Literal["made", "there", "refused", "failed"]
_STATM: Final = Path("/proc/self/statm")
#: Bytes of a GiB.
_GIB: Final = 2**30


class LimitError(Exception):
    """Raised if a task exceeds one of its limits, which the text names."""


class _LimitWatch(threading.Thread):
    """Thread that watches time and memory of the main thread's task."""

    def __init__(self, seconds: float, memory_bytes: int) -> None:
        super().__init__(name="limits", daemon=True)
        self.done = threading.Event()
        self._watched = threading.get_ident()
        self._end = time.monotonic() + seconds
        self._seconds, self._memory_bytes = seconds, memory_bytes
        self._held = read_resident_memory_bytes()
        self.reason = ""

    def run(self) -> None:
        while not self.done.wait(LIMITS.look_s):
            self.reason = self._describe_exceeded_limit()
            if self.reason:
                break
        if not self.reason or self.done.is_set():
            return
        signal.pthread_kill(self._watched, signal.SIGALRM)
        if not self.done.wait(LIMITS.grace_s):
            os._exit(1)

    def raise_exceeded_limit(self, _number: int, _frame: FrameType | None) -> None:
        """Raise an error in the watched thread if a limit is exceeded; a signal handler."""
        if self.reason and not self.done.is_set():
            raise LimitError(self.reason)

    def _describe_exceeded_limit(self) -> str:
        """Say which limit of time or memory is exceeded; empty if none is."""
        if time.monotonic() > self._end:
            return f"took longer than {self._seconds:g} s, its limit"
        used = read_resident_memory_bytes() - self._held
        if used > self._memory_bytes:
            return (
                f"needed more than {self._memory_bytes / _GIB:.2f} GiB of memory, twice what it "
                "declares; [limits] of the fleet file sets how much it declares"
            )
        return ""


@dataclass(frozen=True, slots=True)
class ReplayTask:
    """A recording to replay.

    Attributes:
        log: the log.
        setups: replay setups; the first that applies on the log's day is used.
        destination: destination of the results.
        recording: whether to keep its `.rrd`.
        seconds: limit of wall-clock time in s.
        memory_bytes: declared memory; the task is interrupted at twice that.
        versions: package versions that a node must have.
    """

    log: FleetLog
    setups: tuple[MachineSetup, ...]
    destination: str
    recording: bool
    seconds: float
    memory_bytes: int
    versions: dict[str, str]


@dataclass(frozen=True, slots=True)
class TaskOutcome:
    """Outcome of a recording's task.

    Attributes:
        status: `made`; `there` if the result existed; `refused`, which is a result too; or
            `failed`, without a result.
        reason: why it was refused or failed.
        seconds: duration of the replay in s.
        overhead_s: duration of everything else in s.
        processor_s: processor time of both in s.
    """

    status: Status
    reason: str = ""
    seconds: float = 0.0
    overhead_s: float = 0.0
    processor_s: float = 0.0


def replay_and_store_result(task: ReplayTask) -> TaskOutcome:
    """Replay a recording within its limits and write its result, unless it already exists."""
    began, processor = time.perf_counter(), time.process_time()
    here = collect_versions_of_packages()
    other = [f"{n} {here[n]} for {v}" for n, v in task.versions.items() if here[n] != v]
    if other:
        return TaskOutcome("failed", f"its node has {', '.join(other)}")
    try:
        with (
            interrupt_over_limits(task.seconds, 2 * task.memory_bytes),
            download_log(task.log) as path,
        ):
            made = _make_outcome_of_task(task, path)
    except MemoryError:
        return TaskOutcome("failed", "ran out of memory")
    except FileNotFoundError as error:
        return TaskOutcome("failed", f"{error.filename or error}: is no longer there")
    except (LimitError, PayscopeError) as error:
        return TaskOutcome("failed", str(error))
    whole_s = time.perf_counter() - began
    return replace(
        made, overhead_s=whole_s - made.seconds, processor_s=time.process_time() - processor
    )


def _make_outcome_of_task(task: ReplayTask, log_path: Path) -> TaskOutcome:
    setup, day = task.setups[-1], None
    store = open_cached_store(task.destination)
    try:
        with open_log(log_path, time=find_time_axis_of_machine(setup.machine)) as log:
            first = log.topics()["start_ns"].min()
            day = setup.convert_to_local_day(first if isinstance(first, int) else None)
            setup = choose_setup_valid_on_day(task.setups, day)
            result = _ResultInTransit(task, setup, log.digests, day)
            if result.is_result_complete_in_store(store):
                return TaskOutcome("there")
            began = time.perf_counter()
            made = replay_log_with_setup(log, setup, task.log.source)
            took_s = time.perf_counter() - began
    except (LogError, DataError) as error:
        # a property of the log: replayed again, it would be refused again
        said = str(error).replace(str(log_path), task.log.source)
        result = _ResultInTransit(task, setup, digest_log_files(log_path), day)
        if not result.is_result_complete_in_store(store):
            result.write_result_to_store(store, None, {"status": "refused", "reason": said})
        return TaskOutcome("refused", said)
    result.write_result_to_store(store, made, {})
    return TaskOutcome("made", seconds=took_s)


class _ResultInTransit:
    """A result that is being stored."""

    def __init__(
        self, task: ReplayTask, setup: MachineSetup, digests: tuple[str, ...], day: dt.date | None
    ) -> None:
        self._task, self._setup, self._digests = task, setup, digests
        shown = UNDATED if day is None else str(day)
        self._name = ResultName(setup.name, shown, digest_result_key(setup.basis, digests))

    def is_result_complete_in_store(self, store: ObjectStore) -> bool:
        """Whether the store has the complete result already, with its recording if requested."""
        recorded = not self._task.recording or store.has_object(self._name.recording_object_name)
        return recorded and store.has_object(self._name.make_object_name_of_table(MARK))

    def write_result_to_store(
        self, store: ObjectStore, run: Run | None, results_row: dict[str, object]
    ) -> None:
        """Write the result; `run` is None for a refused log."""
        log, setup = self._task.log, self._setup
        whole: dict[str, object] = {
            "source": log.source,
            "log_sha256": ",".join(self._digests),
            "size_bytes": log.size_bytes,
            "stamp": log.stamp,
            "basis": setup.basis,
            "payscope": self._task.versions["payscope"],
            "calibration": "" if setup.by is None else setup.by.document.id,
            "made_unix_ns": time.time_ns(),
            **results_row,
        }
        if run is None:
            write_result_tables(store, self._name, None, {}, whole)
            return
        if self._task.recording:
            with tempfile.TemporaryDirectory(prefix="payscope-") as folder:
                recording = Path(folder) / "recording.rrd"
                write_recording(run, recording)
                store.upload_file(self._name.recording_object_name, recording)
        frames, said = make_tables_and_results_row(run, setup)
        t0_unix_ns = run.provenance.t0_unix_ns
        write_result_tables(store, self._name, t0_unix_ns, frames, {**whole, **said})


def replay_log_with_setup(log: Log, setup: MachineSetup, source: str) -> Run:
    """Replay a log, and calibrate masses and payloads if the setup has a calibration.

    Raises:
        PayscopeError: the log cannot be replayed.
    """
    try:
        made = run(log, setup.machine)
    except DataError as error:
        raise DataError(f"{source}: {error}") from None
    if setup.by is None:
        return made
    against = describe_contradicted_learnt_priors(made.frames["nuisances"])
    frames = dict(made.frames)
    if not against:
        shared_errors = SharedErrors.from_frames(frames)
        frames["cycles"] = calibrate_cycles(frames["cycles"], setup.by.calibration, shared_errors)
        frames["shift"] = recompute_shift_totals(frames["shift"], frames["cycles"])
    return setup.by.calibrate_masses_of_run(Run(frames, made.provenance))


def make_tables_and_results_row(
    run: Run, setup: MachineSetup
) -> tuple[dict[str, pl.DataFrame], dict[str, object]]:
    """Make the tables of a run, and the run's part of its row of `results`."""
    state = collect_review_state(run, "", "", {})
    shares = pl.DataFrame(
        {"reason": list(state.gate_shares), "share_1": list(state.gate_shares.values())},
        schema={column.name: column.dtype for column in GATE_SHARES.columns},
    )
    quality = pl.DataFrame(
        [each.model_dump() for each in state.sampling],
        schema={column.name: column.dtype for column in QUALITY.columns},
    )
    gaps = sorted(state.gaps_s, key=lambda gap: gap[0] - gap[1])
    against = (
        "" if setup.by is None else describe_contradicted_learnt_priors(run.frames["nuisances"])
    )
    said = {
        **make_result_row(run),
        "longest_gap_at_s": gaps[0][0] if gaps else None,
        "not_calibrated_for": against,
    }
    return make_tables_of_run(run, {"gate_shares": shares, "quality": quality}), said


@contextmanager
def download_log(log: FleetLog) -> Generator[Path]:
    """Context with the log as a file or folder; copies from object storage are removed again."""
    if not log.place:
        yield Path(log.source)
        return
    root = PurePosixPath(log.source.removeprefix(f"{log.place}/"))
    with tempfile.TemporaryDirectory(prefix="payscope-") as folder:
        for name in log.names:
            to = Path(folder, root.name, PurePosixPath(name).relative_to(root))
            to.parent.mkdir(parents=True, exist_ok=True)
            open_cached_store(log.place).download_object_to_file(name, to)
        yield Path(folder, root.name)


def digest_log_files(path: Path) -> tuple[str, ...]:
    """SHA-256 of each file of a log, in hex."""
    files = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
    return tuple(file_sha256(each) for each in files)


@contextmanager
def interrupt_over_limits(seconds: float, memory_bytes: int) -> Generator[None]:
    """Context that interrupts the main thread when a limit is exceeded.

    Args:
        seconds: limit of wall-clock time.
        memory_bytes: limit of the process's memory growth.

    Raises:
        LimitError: a limit is exceeded.
    """
    watch = _LimitWatch(seconds, memory_bytes)
    before = signal.signal(signal.SIGALRM, watch.raise_exceeded_limit)
    if sys.stderr is not None and _has_stream_file_descriptor(sys.stderr):
        # ends the process even if the interpreter's lock is never released
        faulthandler.dump_traceback_later(seconds + 2 * LIMITS.grace_s, exit=True)
    watch.start()
    try:
        yield
    except SystemError as error:  # all that compiled code says of an interrupt
        if watch.reason:
            raise LimitError(watch.reason) from error
        raise
    finally:
        watch.done.set()
        watch.join()
        faulthandler.cancel_dump_traceback_later()
        signal.signal(signal.SIGALRM, before)


def read_resident_memory_bytes() -> int:
    """Resident memory of this process; 0 if the system does not report it."""
    try:
        pages = int(_STATM.read_text(encoding="ascii").split()[1])
    except OSError:
        return 0
    return pages * os.sysconf("SC_PAGE_SIZE")


def _has_stream_file_descriptor(stream: object) -> bool:
    try:
        return stream.fileno() >= 0  # pyright: ignore[reportAttributeAccessIssue] asked for right here
    except (AttributeError, OSError, ValueError):
        return False


@contextmanager
def open_recording_of_result(results: FleetResults, result_key: str) -> Generator[Path]:
    """Context with the path of a result's recording, replayed from its log if it was not kept.

    Args:
        results: results of a fleet.
        result_key: key of the result, or its first characters.

    Raises:
        FleetError: no result or several match the key, or the log no longer exists.
        PayscopeError: the log cannot be replayed.
    """
    found = results.selected_results.filter(pl.col("key").str.starts_with(result_key))
    if found.height != 1:
        said = "several results begin" if found.height else "no result begins"
        raise FleetError(
            f"{results.store.place}: {said} with '{result_key}'; `payscope fleet "
            "query` shows the keys: column key of table results"
        )
    row = found.row(0, named=True)
    name = ResultName(row["machine"], row["day"], row["key"])
    store = results.store
    with tempfile.TemporaryDirectory(prefix="payscope-") as folder:
        recording = Path(folder) / f"{name.key}.rrd"
        if store.has_object(name.recording_object_name):
            store.download_object_to_file(name.recording_object_name, recording)
        else:
            _replay_recording_of_result(results, row["source"], name.machine, recording)
        yield recording


def _replay_recording_of_result(
    results: FleetResults, source: str, machine: str, recording: Path
) -> None:
    known = results.last_run.machines.get(machine)
    if known is None:
        raise FleetError(f"{source}: no machine '{machine}' in the last run; run the fleet again")
    (log,) = list_logs_of_sources([source])
    setups = make_setups_of_machine(machine, known.files, is_unfit_evidence_skipped=True)
    with (
        download_log(log) as path,
        open_log(path, time=find_time_axis_of_machine(setups[-1].machine)) as opened,
    ):
        first = opened.topics()["start_ns"].min()
        day = setups[-1].convert_to_local_day(first if isinstance(first, int) else None)
        write_recording(
            replay_log_with_setup(opened, choose_setup_valid_on_day(setups, day), source), recording
        )
