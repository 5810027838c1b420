"""Formats of logs by suffix: open a log, and find the logs of a folder."""

from collections.abc import Callable, Sequence
from pathlib import Path, PurePosixPath
from typing import Final

from estimators.errors import LogError, join_first_names
from replay.logs.converted import DESCRIPTION
from replay.logs.log import Log, TimeAxis
from replay.logs.log_limits import LIMITS
from replay.logs.tables import JSON_LINES

# The libraries of a format are imported when a log of that format is opened: they are slow to
# import, and `payscope --help` needs none of them.


def _open_bag(path: Path, time_axis: TimeAxis | None) -> Log:  # noqa: ARG001
    from replay.logs.bag import BagFile
    from replay.logs.message_log import MessageLog

    return MessageLog(path, "ROS 1 bag", BagFile)


def _open_mcap(path: Path, time_axis: TimeAxis | None) -> Log:  # noqa: ARG001
    from replay.logs.mcap import McapFile
    from replay.logs.message_log import MessageLog

    return MessageLog(path, "MCAP", McapFile)


def _open_db3(path: Path, time_axis: TimeAxis | None) -> Log:  # noqa: ARG001
    from replay.logs.message_log import MessageLog
    from replay.logs.sqlite import Db3File

    return MessageLog(path, "rosbag2 SQLite", Db3File)


def _open_table(path: Path, time_axis: TimeAxis | None) -> Log:
    if path.suffix.lower() == ".gz" and Path(path.stem).suffix.lower() not in _TEXTS:
        raise LogError(f"{path}: only text tables can be read from .gz; unpack this file first")
    from replay.logs.table_log import TableLog

    return TableLog(path, time_axis)


def _open_recording(path: Path, time_axis: TimeAxis | None) -> Log:  # noqa: ARG001
    from replay.logs.recording_log import RecordingLog

    return RecordingLog(path)


def _open_directory(path: Path) -> Log:
    if (path / DESCRIPTION).is_file():
        from replay.logs.converted_log import ConvertedLog

        return ConvertedLog(path)
    from replay.logs.message_log import MessageLog
    from replay.logs.rosbag2 import METADATA, Rosbag2Directory, list_storage_files

    if not (path / METADATA).exists() and not list_storage_files(path):
        logs = sorted(each.name for each in path.iterdir() if is_path_named_like_log(each))
        if logs:
            named = join_first_names(logs, LIMITS.max_logs)
            raise LogError(f"{path}: is a folder of logs; give one of them: {named}")
        raise LogError(
            f"{path}: contains no log; a rosbag2 directory has metadata.yaml and .mcap or .db3 "
            f"files, a converted log has {DESCRIPTION}"
        )
    return MessageLog(path, "rosbag2 directory", Rosbag2Directory)


def is_path_named_like_log(path: Path) -> bool:
    """Whether a path has the suffix of a log, or is a directory that is itself a log."""
    from replay.logs.rosbag2 import METADATA

    is_directory_log = any((path / each).is_file() for each in (METADATA, DESCRIPTION))
    return path.suffix.lower() in OPENERS or is_directory_log


#: Suffixes of tables. Folders are searched only for the first two, since files with the others may
#: be notes.
TABLES: Final = (
    *(".csv", ".parquet", ".tsv", ".txt", ".dat", ".log", ".asc", ".arrow", ".feather", ".xlsx"),
    *(".prn", ".lvm", ".vbo", ".pos", ".tab", ".msl", *(f".{each}" for each in JSON_LINES), ".gz"),
)
_TEXTS: Final = tuple(s for s in TABLES if s not in (".parquet", ".arrow", ".feather", ".xlsx"))
#: Function that opens a file, by its suffix.
OPENERS: Final[dict[str, Callable[[Path, TimeAxis | None], Log]]] = {
    ".bag": _open_bag,
    ".active": _open_bag,
    ".mcap": _open_mcap,
    ".db3": _open_db3,
    **dict.fromkeys(TABLES, _open_table),
    ".rrd": _open_recording,
}


def open_log(path: str | Path, *, time: TimeAxis | None = None) -> Log:
    """Open a log by its suffix; a directory is a rosbag2 recording or a converted log.

    Args:
        path: a `.bag`, `.mcap`, `.db3` file, a table (`TABLES`), a rosbag2 directory, a folder
            that `convert` wrote, or a recording (`.rrd`), which has the channels of its replay.
        time: time column and format of a table; guessed from the column names if None. Logs of
            messages have their own log times.

    Raises:
        LogError: the file does not exist, its suffix is unknown, its content does not match its
            suffix, or its name is not UTF-8.
    """
    path = Path(path)
    if not is_encodable_as_utf8(str(path)):
        raise LogError(
            f"{path}: has bytes in its name that are not UTF-8, so answers and recordings could "
            "not state it; rename the file"
        )
    try:
        if path.is_dir():
            return _open_directory(path)
        if not path.exists():
            raise LogError(f"{path}: no such file or directory")
        opener = OPENERS.get(path.suffix.lower())
        if opener is None:
            suffix = f"'{path.suffix}'" if path.suffix else "a name without a suffix"
            raise LogError(
                f"{path}: no reader for {suffix}; supported: {', '.join(OPENERS)} or a "
                "rosbag2 directory"
            )
        if path.stat().st_size == 0:
            raise LogError(f"{path}: the file is empty (0 bytes); copy it again, or leave it out")
        return opener(path, time)
    except OSError as error:
        raise LogError(f"{path}: cannot be opened: {error.strerror or error}") from error


#: Tables that a folder is searched for. They are logs only if named, or if the folder has no other
#: logs: folders of bags also hold ledgers and notes.
_TABLES: Final = (".csv", ".parquet")
#: Suffix of logs that must be named: a recording often lies beside its log.
_NAMED: Final = ".rrd"
_BAGS: Final = tuple(suffix for suffix in OPENERS if suffix not in (*TABLES, _NAMED))
_METADATA: Final = "metadata.yaml"
#: Files by which a folder is one log: a rosbag2 directory, or a converted log.
_DESCRIBED: Final = (_METADATA, DESCRIPTION)


def is_encodable_as_utf8(path_text: str) -> bool:
    """Whether UTF-8 can encode a path; a name on disk in another encoding cannot be."""
    try:
        path_text.encode()
    except UnicodeEncodeError:
        return False
    return True


def expand_log_folders(paths: Sequence[Path]) -> list[Path]:
    """List each named log once; a folder is replaced by the logs in it.

    Args:
        paths: logs, and folders of logs (which a rosbag2 directory is not).

    Raises:
        LogError: a folder cannot be read.
    """
    found = [
        log
        for path in paths
        for log in (list_logs_below_folder(path) if _is_folder_without_log_format(path) else [path])
    ]
    return list({path.resolve(): path for path in found}.values())


def group_objects_by_log(object_names: Sequence[str]) -> dict[str, list[str]]:
    """Find the logs among the objects of an object store, and the objects of each.

    Logs are bags and directories with metadata; if there are none, tables.

    Args:
        object_names: names of the objects, with slashes.
    """
    paths = [PurePosixPath(name) for name in sorted(object_names)]
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


def _is_folder_without_log_format(path: Path) -> bool:
    return path.is_dir() and not any((path / name).is_file() for name in _DESCRIBED)


def list_logs_below_folder(folder: Path) -> list[Path]:
    """Bags of a folder and its subfolders; if there are none, its tables."""
    inside = _list_visible_entries_of_folder(folder)
    bags = [log for each in inside for log in list_bags(each)]
    tables = [each for each in inside if each.suffix.lower() in _TABLES and each.is_file()]
    # a folder without a log is returned, so that opening it raises the error
    return bags or tables or [folder]


def list_bags(path: Path) -> list[Path]:
    """List a bag, or the bags of a folder that has no metadata, as after a power loss."""
    if _is_folder_without_log_format(path):
        return [
            log
            for each in _list_visible_entries_of_folder(path)
            if not _is_folder_without_log_format(each)
            for log in list_bags(each)
        ]
    return [path] if path.is_dir() or path.suffix.lower() in _BAGS else []


def _list_visible_entries_of_folder(folder: Path) -> list[Path]:
    try:
        return sorted(each for each in folder.iterdir() if not each.name.startswith("."))
    except OSError as error:
        raise LogError(f"{folder}: cannot be read ({error.strerror})") from None
