"""Decide which files the importer of the Rerun viewer accepts, for every file that it opens."""

import os
from pathlib import Path
from typing import Final

#: Environment variable that names the machine file of the logs that are opened.
VARIABLE: Final = "PAYSCOPE_MACHINE"
#: Suffixes of logs that the viewer cannot open itself; it reads .mcap and .parquet.
_ALONE: Final = (".bag", ".db3", ".csv")
_WITH_MACHINE: Final = (*_ALONE, ".mcap", ".parquet")


def find_machine_file_of_log(log: Path) -> Path | None:
    """Find the machine file of a log: `PAYSCOPE_MACHINE`, or `shift.toml` beside `shift.bag`.

    Returns:
        None if neither exists.
    """
    named = os.environ.get(VARIABLE)
    if named:
        return Path(named)
    beside = log.with_suffix(".toml") if log.is_file() else log.with_name(f"{log.name}.toml")
    return beside if beside.is_file() else None


def should_import_file(log: Path) -> bool:
    """Whether to import a file; formats of the viewer itself only if they have a machine file."""
    suffixes = _WITH_MACHINE if find_machine_file_of_log(log) is not None else _ALONE
    if log.is_dir():
        return (log / "metadata.yaml").is_file() and any(
            each.suffix in suffixes for each in log.iterdir()
        )
    return log.is_file() and log.suffix.lower() in suffixes
