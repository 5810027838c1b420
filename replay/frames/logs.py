"""Opened logs, kept while they do not change: opening reads the index, which takes a while."""

from collections import OrderedDict
from pathlib import Path
from threading import Lock
from typing import Final

from replay.logs import Log, TimeAxis, open_log

#: Each holds a file open and the log times of its messages.
_MOST_OPEN: Final = 8
_Key = tuple[str, tuple[tuple[str, int, int], ...], TimeAxis | None]
_opened: OrderedDict[_Key, Log] = OrderedDict()
_one_at_a_time: Final = Lock()


def opened_log(path: Path, time: TimeAxis | None = None) -> Log:
    """Open a log, or take the one that is open if its files are as they were.

    Args:
        path: of the log.
        time: where a table keeps its time.

    Raises:
        LogError: as `open_log`.
    """
    with _one_at_a_time:
        key = (str(path.absolute()), _state(path), time)
        log = _opened.pop(key, None)
        if log is None:
            log = open_log(path, time=time)
        _opened[key] = log
        # one that is still read closes when that is over: nothing else holds it
        while len(_opened) > _MOST_OPEN:
            _opened.popitem(last=False)
        return log


def _state(path: Path) -> tuple[tuple[str, int, int], ...]:
    """Name, size and time of change of a file, or of the files in a directory."""
    try:
        files = sorted(path.iterdir()) if path.is_dir() else [path]
        return tuple((f.name, f.stat().st_size, f.stat().st_mtime_ns) for f in files)
    except OSError:  # opening it says why
        return ()
