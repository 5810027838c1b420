"""The command `fleet compare`: compare two sets of results, or one with other settings."""

import datetime as dt
import hashlib
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cache
from typing import Final

import polars as pl

from analysis.fleet.daily_figures import UNDATED
from analysis.fleet.results_comparison import FleetComparison, compare_fleet_results
from estimators.errors import FleetError
from replay.fleet.gathered_tables import FleetResults, open_results_of_fleet
from replay.fleet.last_run import LastRun, NamedFiles, TaskLimits
from replay.fleet.log_sources import FleetLog, list_logs_of_sources
from replay.fleet.machine_setups import MachineSetup, make_setups_of_machine
from replay.fleet.ray_engine import TaskEngine
from replay.fleet.run_fleet import FleetRun, OnDone, replay_logs_of_fleet

WHAT_IF: Final = "what-if"
#: Hexadecimal digits of a digest that distinguish settings.
_DIGITS: Final = 12


@dataclass(frozen=True, slots=True)
class DayRange:
    """Range of days, including both; None leaves an end open."""

    first: dt.date | None = None
    last: dt.date | None = None

    def select_results_in_range(self, results: pl.DataFrame) -> pl.DataFrame:
        """Select the results in the range; undated ones only if both ends are open."""
        if self.first is None and self.last is None:
            return results
        day = pl.col("day")
        kept = day != UNDATED
        kept = kept if self.first is None else kept & (day >= str(self.first))
        return results.filter(kept if self.last is None else kept & (day <= str(self.last)))


@dataclass(frozen=True, slots=True)
class RunCallbacks:
    """Callbacks of a fleet run.

    Attributes:
        logs: called with the logs to replay.
        done: called with each finished log and its outcome.
        engine: called with the opened engine.
    """

    logs: Callable[[Sequence[FleetLog]], None] = lambda _: None
    done: OnDone = lambda _, __: None
    engine: Callable[[TaskEngine], None] = lambda _: None


@dataclass(frozen=True)
class PlanWithOtherSettings:
    """The last run's plan with other settings.

    Attributes:
        last: options of the last run.
        overrides: `key=value` for every machine file, applied after its own.
        machines: machines of each log.
    """

    last: LastRun
    overrides: tuple[str, ...]
    machines: dict[str, str]

    @property
    def name(self) -> str:
        """Name of the fleet."""
        return self.last.fleet

    @property
    def time_and_memory_limits(self) -> TaskLimits:
        """Resource limits of one recording."""
        return self.last.limits

    def list_setups_of_log(self, log: str) -> tuple[MachineSetup, ...]:
        """Replay setups of a log; evidence that does not fit the settings is skipped."""
        machine = self.machines[log]
        if machine not in self.last.machines:
            raise FleetError(f"{log}: no machine '{machine}' in the last run; run the fleet again")
        files = self.last.machines[machine].files
        overrides = (*files.overrides, *self.overrides)
        return _make_setups_with_fitting_evidence(
            machine, NamedFiles(files.file, overrides, files.calibrations)
        )


@cache
def _make_setups_with_fitting_evidence(machine: str, files: NamedFiles) -> tuple[MachineSetup, ...]:
    """Make the setups of a machine, read once; evidence made with other settings is skipped."""
    return make_setups_of_machine(machine, files, is_unfit_evidence_skipped=True)


def compare_fleets(
    fleet_a: FleetResults, fleet_b: FleetResults, day_range: DayRange
) -> FleetComparison:
    """Compare the results in a range of days.

    Raises:
        FleetError: the two have no log in common.
    """
    found = compare_fleet_results(
        day_range.select_results_in_range(fleet_a.selected_results),
        day_range.select_results_in_range(fleet_b.selected_results),
    )
    if found.logs.is_empty():
        raise FleetError(
            f"{fleet_a.store.place} and {fleet_b.store.place}: have no log in common on these "
            "days; compare results of the same logs, or choose other days"
        )
    return found


def replay_fleet_with_settings(
    results: FleetResults,
    overrides: Sequence[str],
    day_range: DayRange,
    engine: Callable[[], AbstractContextManager[TaskEngine]],
    callbacks: RunCallbacks,
) -> tuple[FleetResults, FleetRun, int]:
    """Replay logs under other settings, each once, and keep the results separately.

    Args:
        results: results with the logs and machine files.
        overrides: `key=value` for every machine file.
        day_range: range of days of the logs.
        engine: opens an engine.
        callbacks: callbacks of the run.

    Returns:
        New results, summary of the run, and number of logs that no longer exist.

    Raises:
        FleetError: none of the logs exists any longer.
    """
    rows = day_range.select_results_in_range(results.selected_results).select("source", "machine")
    machines: dict[str, str] = dict(rows.iter_rows())
    logs: list[FleetLog] = []
    gone = 0
    for source in machines:
        try:
            logs += list_logs_of_sources([source])
        except FleetError:
            gone += 1
    if not logs:
        raise FleetError(
            f"{results.store.place}: none of the logs of these days is at its former path; "
            "restore them, or compare two folders of results"
        )
    plan = PlanWithOtherSettings(results.last_run, tuple(overrides), machines)
    digest = hashlib.sha256("\n".join(overrides).encode()).hexdigest()[:_DIGITS]
    place = results.store.make_full_object_name(f"{WHAT_IF}/{digest}")
    callbacks.logs(logs)
    did = replay_logs_of_fleet(logs, plan, place, engine, callbacks.done, callbacks.engine)
    return open_results_of_fleet(place), did, gone
