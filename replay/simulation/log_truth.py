"""Write and read the truth of a simulated log (`LOG.truth.json`), to judge a replay."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import polars as pl

from analysis.simulation import Scenario, SimulatedLog
from estimators.errors import LogError

if TYPE_CHECKING:
    from analysis.simulation.logs.shift_logs import ShiftTruth


def make_truth_path_of_log(log: Path) -> Path:
    """Path of the truth of a simulated log."""
    return log.with_name(f"{log.name}.truth.json")


def write_truth_of_log(simulated_log: SimulatedLog, log: Path) -> None:
    """Write the truth of a simulated log beside it."""
    truth = {
        "log": log.name,
        "load_kg": simulated_log.load_kg,
        # the log's own times are Unix times minus this
        "time_zero_unix_ns": simulated_log.origin_unix_ns if log.suffix == ".csv" else 0,
        # time of each topic's first sample, from the start of the log
        "phase_s": dict(simulated_log.phase_s),
        "runs": simulated_log.trials.to_dicts(),
        "manoeuvres": simulated_log.manoeuvres.to_dicts(),
        "scenario": simulated_log.scenario.model_dump(mode="json"),
    }
    make_truth_path_of_log(log).write_text(json.dumps(truth, indent=2) + "\n", encoding="utf-8")


def write_truth_of_shift(
    truth: "ShiftTruth", scenario: Scenario, logs: Sequence[Path], path: Path
) -> None:
    """Write the truth of a whole shift: cycles, dumps, standstills and logs, times in Unix ns."""
    named = truth.logs.insert_column(0, pl.Series("log", [log.name for log in logs]))
    whole = {
        "cycles": truth.cycles.to_dicts(),
        "dumps": truth.dumps.to_dicts(),
        "stands": truth.stands.to_dicts(),
        "logs": named.to_dicts(),
        "scenario": scenario.model_dump(mode="json"),
    }
    path.write_text(json.dumps(whole, indent=2) + "\n", encoding="utf-8")


def do_logs_have_truth_of_trials(logs: Sequence[Path]) -> bool:
    """Whether every log has the truth of its trials beside it; a shift has no trials."""
    return all(
        make_truth_path_of_log(log).is_file()
        and does_truth_file_have_trials(make_truth_path_of_log(log))
        for log in logs
    )


def read_true_trials_of_logs(logs: Sequence[Path]) -> pl.DataFrame:
    """Read the true values of every trial, in the logs' order, with times by the logs' own clock.

    Args:
        logs: simulated logs, with the truth beside each.

    Returns:
        One row per trial: `start_ns`, `end_ns`, `load_kg`, `mass_kg`, and other true values.

    Raises:
        LogError: a truth file cannot be read, or is invalid.
    """
    return pl.concat([_read_trials_of_truth_file(make_truth_path_of_log(log)) for log in logs])


def does_truth_file_have_trials(path: Path) -> bool:
    """Whether a truth file has trials; also True if unreadable, which its reader then reports."""
    try:
        return json.loads(path.read_text(encoding="utf-8")).get("runs") != []
    except (OSError, ValueError, AttributeError):
        return True


def _read_trials_of_truth_file(path: Path) -> pl.DataFrame:
    try:
        truth = json.loads(path.read_text(encoding="utf-8"))
        zero_ns = truth["time_zero_unix_ns"]
        return pl.DataFrame(truth["runs"]).with_columns(pl.col("start_ns", "end_ns") - zero_ns)
    except OSError as error:
        raise LogError(f"{path}: cannot be read ({error.strerror})") from None
    except (ValueError, KeyError, TypeError, pl.exceptions.PolarsError):
        raise LogError(f"{path}: was not written by 'payscope simulate'; simulate again") from None
