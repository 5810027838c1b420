"""Several logs: as named, or all that a folder holds."""

from collections.abc import Sequence
from pathlib import Path, PurePosixPath
from typing import Final

from estimators.errors import LogError
from replay.logs.converted.description import DESCRIPTION
from replay.logs.log_formats import OPENERS, TABLES

#: Tables are logs only where they are named, or where a folder has no others: ledgers and notes lie
#: in folders of bags.
_TABLES: Final = (".csv", ".parquet")
#: A recording lies beside the log that it is of.
_NAMED: Final = ".rrd"
_BAGS: Final = tuple(suffix for suffix in OPENERS if suffix not in (*TABLES, _NAMED))
_METADATA: Final = "metadata.yaml"
#: What makes a folder one log: a rosbag2 directory, or a converted log.
_DESCRIBED: Final = (_METADATA, DESCRIPTION)


def logs_in(named: Sequence[Path]) -> list[Path]:
    """Each log once, however often it is named; a folder stands for all the logs in it.

    Args:
        named: logs, and folders of logs (which a rosbag2 directory is not).

    Raises:
        LogError: a folder that cannot be read.
    """
    found = [log for path in named for log in (_of_folder(path) if _is_folder(path) else [path])]
    return list({path.resolve(): path for path in found}.values())


def logs_among(names: Sequence[str]) -> dict[str, list[str]]:
    """The logs among objects of a storage that has no folders, each with its objects.

    Bags, and directories with metadata; where there is neither, tables.

    Args:
        names: with slashes.
    """
    paths = [PurePosixPath(name) for name in sorted(names)]
    directories = {path.parent for path in paths if path.name == _METADATA}
    found: dict[str, list[str]] = {}
    tables: dict[str, list[str]] = {}
    for path in paths:
        if path.parent in directories:
            found.setdefault(str(path.parent), []).append(str(path))
        elif path.suffix.lower() in _BAGS:
            found[str(path)] = [str(path)]
        elif path.suffix.lower() in _TABLES:
            tables[str(path)] = [str(path)]
    return found or tables


def _is_folder(path: Path) -> bool:
    return path.is_dir() and not any((path / name).is_file() for name in _DESCRIBED)


def _of_folder(folder: Path) -> list[Path]:
    """Its bags and those of its folders; where there is none, its tables."""
    inside = _format_folder(folder)
    bags = [log for each in inside for log in _bags(each)]
    tables = [each for each in inside if each.suffix.lower() in _TABLES and each.is_file()]
    # a folder without a log is for its reader to say
    return bags or tables or [folder]


def _bags(path: Path) -> list[Path]:
    """A bag itself, or those of a folder without metadata, as a power loss leaves it."""
    if _is_folder(path):
        return [log for each in _format_folder(path) if not _is_folder(each) for log in _bags(each)]
    return [path] if path.is_dir() or path.suffix.lower() in _BAGS else []


def _format_folder(folder: Path) -> list[Path]:
    try:
        return sorted(each for each in folder.iterdir() if not each.name.startswith("."))
    except OSError as error:
        raise LogError(f"{folder}: cannot be read ({error.strerror})") from None
