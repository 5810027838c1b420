"""A place for numba's compiled functions, also for a user who may write neither here nor at home.

Numba looks for one beside the source and in the user's cache folder, and refuses to work where
both are locked: an installation by root, a service account.
"""

import atexit
import os
import shutil
import tempfile
from pathlib import Path
from typing import Final

_HERE: Final = Path(__file__).parent


def ensure() -> None:
    """Where numba finds no place for its cache, give it one that lasts as long as this process."""
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")  # noqa: PTH111 - no error without a home
    candidates = (_HERE / "__pycache__", Path(home, "numba"))
    if "NUMBA_CACHE_DIR" in os.environ or any(map(_is_writable, candidates)):
        return
    folder = tempfile.mkdtemp(prefix="payscope-numba-")
    os.environ["NUMBA_CACHE_DIR"] = folder
    atexit.register(shutil.rmtree, folder, ignore_errors=True)


def _is_writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK | os.X_OK)
