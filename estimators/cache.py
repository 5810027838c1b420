"""A place for numba's compiled functions that no other version of the sources has filled.

Numba keeps what it compiles, so that only the first use waits for it. But it looks at a function's
own file alone to see whether that still holds, and compiled loops contain those that they call from
other files; so the place is named after all sources. Where neither the folder of the sources nor
the user's can be written to (an installation by root, a service account) it lasts as long as the
process.
"""

import atexit
import hashlib
import os
import shutil
import tempfile
from pathlib import Path
from typing import Final

_HERE: Final = Path(__file__).parent
_PREFIX: Final = "payscope-numba-"
#: The packages that compile anything.
_COMPILED: Final = ("estimators", "replay")
#: Places of other versions that are left: the latest used.
_MOST_PLACES: Final = 3


def ensure() -> None:
    """Name the place in NUMBA_CACHE_DIR, unless the user named one."""
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if chosen and not Path(chosen).name.startswith(_PREFIX):
        return
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")  # noqa: PTH111 - no error without a home
    for folder in (_HERE / "__pycache__", Path(home, "payscope")):
        place = folder / f"{_PREFIX}{_digest()}"
        if _is_writable(place):
            _forget_old(folder, place)
            os.environ["NUMBA_CACHE_DIR"] = str(place)
            return
    passing = tempfile.mkdtemp(prefix=_PREFIX)
    os.environ["NUMBA_CACHE_DIR"] = passing
    atexit.register(shutil.rmtree, passing, ignore_errors=True)


def _digest() -> str:
    """Of every source that may be compiled."""
    sources = hashlib.sha256()
    for package in _COMPILED:
        for path in sorted((_HERE.parent / package).rglob("*.py")):
            sources.update(path.name.encode() + b"\0" + path.read_bytes())
    return sources.hexdigest()[:16]


def _is_writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        folder.touch()
    except OSError:
        return False
    return os.access(folder, os.W_OK | os.X_OK)


def _forget_old(folder: Path, place: Path) -> None:
    """Remove what other versions compiled, but for the latest few."""
    others = [each for each in folder.glob(f"{_PREFIX}*") if each != place]
    by_age = sorted(others, key=lambda each: each.stat().st_mtime)
    for each in by_age[: max(0, len(by_age) - _MOST_PLACES)]:
        shutil.rmtree(each, ignore_errors=True)
