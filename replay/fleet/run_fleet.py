"""The command `fleet run`: replay the logs of a fleet, each once."""

import datetime as dt
import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from analysis.fleet.daily_figures import UNDATED
from estimators.errors import PayscopeError
from replay.fleet.gathered_tables import FleetResults
from replay.fleet.last_run import CALIBRATIONS, FAILED, LastRun, LastRunMachine, TaskLimits
from replay.fleet.log_sources import FleetLog
from replay.fleet.machine_setups import MachineSetup, choose_setup_valid_on_day
from replay.fleet.object_store import S3, ObjectStore
from replay.fleet.ray_engine import LostTask, TaskEngine, TaskWithMemory
from replay.fleet.recording_task import ReplayTask, TaskOutcome, replay_and_store_result
from replay.fleet.results_layout import MARK, RECORDINGS, parse_result_name
from replay.inputs.channel_inputs import collect_versions_of_packages


class FleetPlan(Protocol):
    """Plan of how each log is replayed: a fleet file, or the last run with other settings."""

    @property
    def name(self) -> str:
        """Name of the fleet."""
        ...

    @property
    def time_and_memory_limits(self) -> TaskLimits:
        """Resource limits of one recording."""
        ...

    def list_setups_of_log(self, log: str) -> tuple[MachineSetup, ...]:
        """Replay setups of a log; the first that applies on its day is used."""
        ...


#: Function that is called with each finished log and its outcome.
OnDone = Callable[[FleetLog, TaskOutcome], None]


@dataclass
class FleetRun:
    """Summary of a fleet run.

    Attributes:
        destination: destination of the results.
        replayed: number of replayed recordings.
        up_to_date: number of recordings whose result exists already.
        refused: recordings without an answer, and why; these are results too.
        failed: recordings without a result, and why.
        seconds: total duration of the replays in s.
        overhead_s: total duration of hashing, downloading and writing in s.
    """

    destination: str
    replayed: int = 0
    up_to_date: int = 0
    refused: dict[str, str] = field(default_factory=dict)
    failed: dict[str, str] = field(default_factory=dict)
    seconds: float = 0.0
    overhead_s: float = 0.0

    def count_outcome_of_recording(self, source: str, outcome: TaskOutcome) -> None:
        """Count the outcome of a recording."""
        self.seconds += outcome.seconds
        self.overhead_s += outcome.overhead_s
        if outcome.status == "made":
            self.replayed += 1
        elif outcome.status == "there":
            self.up_to_date += 1
        else:
            listed = self.refused if outcome.status == "refused" else self.failed
            listed[source] = outcome.reason

    def to_dict(self) -> dict[str, Any]:
        """The fields as JSON-compatible values."""
        return {
            "destination": self.destination,
            "made": self.replayed,
            "there": self.up_to_date,
            "refused": dict(sorted(self.refused.items())),
            "failed": dict(sorted(self.failed.items())),
            "replay_s": self.seconds,
            "overhead_s": self.overhead_s,
        }


def replay_logs_of_fleet(
    logs: Sequence[FleetLog],
    plan: FleetPlan,
    destination: str,
    engine: Callable[[], AbstractContextManager[TaskEngine]],
    on_done: OnDone = lambda _, __: None,
    on_engine: Callable[[TaskEngine], None] = lambda _: None,
    *,
    keeps_recordings: bool = False,
) -> FleetRun:
    """Replay the logs that have no result yet.

    A log that fails is listed, and does not affect others. Results that were written before an
    interruption are kept.

    Args:
        logs: logs from `list_logs_of_sources`.
        plan: replay setups of each log.
        destination: a folder, or `s3://bucket/prefix`.
        keeps_recordings: whether to keep every recording's `.rrd`.
        engine: opens an engine; not called if all results exist.
        on_done: called with each finished log and its outcome.
        on_engine: called with the engine once it is open.
    """
    place = destination if destination.startswith(S3) else str(Path(destination).absolute())
    results = FleetResults(ObjectStore(place))
    did = FleetRun(destination)
    tasks, setups = _plan_replay_tasks(logs, plan, place, did, keeps_recordings=keeps_recordings)
    for log in logs:
        if log.source in did.failed:
            on_done(log, TaskOutcome("failed", did.failed[log.source]))
    machines = {
        machine: LastRunMachine(
            files=each[0].files, bases=tuple(sorted(setup.basis for setup in each))
        )
        for machine, each in setups.items()
    }
    results.store_last_run(
        LastRun(fleet=plan.name, limits=plan.time_and_memory_limits, machines=machines)
    )
    _store_calibrations_in_use(results, setups)
    left, there = split_tasks_into_pending_and_finished(tasks, results)
    for task, outcome in there:
        did.count_outcome_of_recording(task.log.source, outcome)
        on_done(task.log, outcome)
    try:
        if left:
            with engine() as opened:
                on_engine(opened)
                # the largest first, so that none runs alone at the end
                left.sort(key=lambda task: (-task.log.size_bytes, task.log.source))
                for task, result in opened.run_tasks(
                    replay_and_store_result,
                    [TaskWithMemory(task, task.memory_bytes) for task in left],
                ):
                    outcome = (
                        TaskOutcome("failed", result.reason)
                        if isinstance(result, LostTask)
                        else result
                    )
                    did.count_outcome_of_recording(task.log.source, outcome)
                    on_done(task.log, outcome)
    finally:
        update_failed_logs(results, did, {log.source for log in logs})
    FleetResults(results.store).update_gathered_tables()
    return did


def _plan_replay_tasks(
    logs: Sequence[FleetLog],
    plan: FleetPlan,
    store_address: str,
    fleet_run: FleetRun,
    *,
    keeps_recordings: bool,
) -> tuple[list[ReplayTask], dict[str, tuple[MachineSetup, ...]]]:
    """Make a task for each log, and collect the setups of all machines."""
    tasks: list[ReplayTask] = []
    by_machine: dict[str, tuple[MachineSetup, ...]] = {}
    versions = collect_versions_of_packages()
    for log in logs:
        try:
            setups = plan.list_setups_of_log(log.source)
        except PayscopeError as error:
            fleet_run.failed[log.source] = str(error)
            continue
        by_machine[setups[0].name] = setups
        memory = plan.time_and_memory_limits.compute_memory_bytes_for_log(log.size_bytes)
        seconds = plan.time_and_memory_limits.seconds
        tasks.append(
            ReplayTask(log, setups, store_address, keeps_recordings, seconds, memory, versions)
        )
    return tasks, by_machine


class _SplitTasks(NamedTuple):
    """Tasks to do, and tasks that have a result, with the result."""

    to_do: list[ReplayTask]
    finished: list[tuple[ReplayTask, TaskOutcome]]


def split_tasks_into_pending_and_finished(
    tasks: Sequence[ReplayTask], results: FleetResults
) -> _SplitTasks:
    """Separate pending tasks from tasks whose log has not changed since its result was made.

    Size and time of change of the log's files are compared; if they differ, the task itself
    compares the contents.
    """
    if not results.result_names_by_machine:
        return _SplitTasks(list(tasks), [])
    columns = ("source", "stamp", "basis", "day", "key", "status", "reason")
    by_log: dict[tuple[str, str], list[tuple[str, ...]]] = {}
    for source, stamp, *row in (
        results.scan_rows_of_all_settings(MARK).select(columns).collect().iter_rows()
    ):
        by_log.setdefault((source, stamp), []).append(tuple(row))
    names = map(parse_result_name, results.store.list_names(RECORDINGS))
    recorded = {name.key for name in names if name is not None}
    left: list[ReplayTask] = []
    there: list[tuple[ReplayTask, TaskOutcome]] = []
    for task in tasks:
        for basis, day, key, status, reason in by_log.get((task.log.source, task.log.stamp), ()):
            # a calibration may have been added since
            asked = choose_setup_valid_on_day(
                task.setups, None if day == UNDATED else dt.date.fromisoformat(day)
            )
            refused = status == "refused"
            if asked.basis == basis and (refused or key in recorded or not task.recording):
                there.append(
                    (task, TaskOutcome("refused", reason) if refused else TaskOutcome("there"))
                )
                break
        else:
            left.append(task)
    return _SplitTasks(left, there)


def _store_calibrations_in_use(
    results: FleetResults, setups_by_machine: Mapping[str, tuple[MachineSetup, ...]]
) -> None:
    """Store the fitted values of the calibrations in use, for the report."""
    now = [
        each.calibration
        for machine in sorted(setups_by_machine)
        for each in setups_by_machine[machine]
    ]
    used = [each for each in now if each is not None]
    before = results.calibrations_in_use
    kept = {(each.machine, each.id): each for each in [*before, *used]}
    if list(kept.values()) != before:
        plain = [each.model_dump(mode="json") for each in kept.values()]
        results.store.write_object(CALIBRATIONS, json.dumps(plain, indent=1).encode())


def update_failed_logs(results: FleetResults, fleet_run: FleetRun, sources: set[str]) -> None:
    """Add the failed tasks of a run to the list for the report, and remove the completed ones.

    Args:
        results: results with the list.
        fleet_run: the run.
        sources: sources of all logs that the run was to replay.
    """
    before = results.failure_reason_by_source
    now = {
        source: why for source, why in before.items() if source not in sources
    } | fleet_run.failed
    if now != before:
        results.store.write_object(FAILED, json.dumps(dict(sorted(now.items())), indent=1).encode())
