"""Who runs a program: root obeying the modes of files, and another user."""

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import pytest

from tests.conftest import REPO

#: Words before a command by which root may not write to a folder of mode 555 either.
_OBEYING: Final = ("setpriv", "--bounding-set=-dac_override,-dac_read_search", "--")
#: The user and group that own nothing.
_NOBODY: Final = 65534


def obeying_modes() -> tuple[str, ...]:
    """Words before a command of which files are written only where their modes say so."""
    if not hasattr(os, "geteuid"):
        pytest.skip("modes of folders: this system has none")
    if os.geteuid() != 0:
        return ()
    if shutil.which(_OBEYING[0]) is None:
        pytest.skip("root may write anywhere; Debian: apt-get install util-linux (setpriv)")
    return _OBEYING


def of_another_user() -> dict[str, Any]:
    """Options of `subprocess.run` for a user who owns nothing; skip where he can start nothing."""
    if not hasattr(os, "geteuid") or os.geteuid() != 0:
        pytest.skip("another user: only root may become one")
    user = {"user": _NOBODY, "group": _NOBODY, "extra_groups": [], "umask": 0o077}
    asked = [sys.executable, "-c", f"import os; os.listdir({str(REPO)!r}); import polars"]
    try:
        left = subprocess.run(asked, capture_output=True, text=True, check=False, cwd="/", **user)
    except PermissionError as error:
        pytest.skip(f"another user: he may not enter the folders above the sources: {error}")
    if left.returncode:
        pytest.skip(f"another user: he may not read the sources: {left.stderr.splitlines()[-1]}")
    return user


@contextmanager
def readable_folder() -> Generator[Path]:
    """Make a folder that every user may read: those above pytest's own let nobody else in."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        folder.chmod(0o755)
        yield folder
