"""The truth that lies beside a simulated log (`LOG.truth.json`)."""

import json
from collections.abc import Sequence
from pathlib import Path

import polars as pl

from estimators.errors import LogError
from replay.write_log import truth_path


def true_runs(logs: Sequence[Path]) -> pl.DataFrame:
    """The truth of every run, in the logs' order, by the logs' own clock.

    Args:
        logs: simulated logs, the truth beside each.

    Returns:
        A row a run: `start_ns`, `end_ns`, `load_kg`, `mass_kg`, and what else the truth holds.

    Raises:
        LogError: a truth file cannot be read, or is none.
    """
    return pl.concat([_runs(truth_path(log)) for log in logs])


def has_truth(logs: Sequence[Path]) -> bool:
    """Whether the truth lies beside every log."""
    return all(truth_path(log).is_file() for log in logs)


def _runs(path: Path) -> pl.DataFrame:
    try:
        truth = json.loads(path.read_text(encoding="utf-8"))
        zero_ns = truth["time_zero_unix_ns"]
        return pl.DataFrame(truth["runs"]).with_columns(pl.col("start_ns", "end_ns") - zero_ns)
    except OSError as error:
        raise LogError(f"{path}: cannot be read ({error.strerror})") from None
    except (ValueError, KeyError, TypeError, pl.exceptions.PolarsError):
        raise LogError(f"{path}: is not what 'payscope simulate' writes; simulate anew") from None
