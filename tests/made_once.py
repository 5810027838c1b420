"""What several workers need, of seconds each, is made by the first that asks."""

import fcntl
import os
import pickle
import shutil
import tempfile
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

import pytest

T = TypeVar("T")


def make_folder_once(
    factory: pytest.TempPathFactory, name: str, make: Callable[[Path], object]
) -> Path:
    """A folder of this worker, which may be written to.

    Args:
        factory: of the session.
        name: of the folder.
        make: writes into a folder that is empty, and no path of it into a file.
    """
    shared = folder_of_workers(factory) / name
    with _locked(shared):
        if not shared.exists():
            begun = Path(tempfile.mkdtemp(dir=shared.parent))
            make(begun)
            begun.rename(shared)
    return Path(shutil.copytree(shared, factory.getbasetemp() / name))


def make_value_once(file: Path, make: Callable[[], T]) -> T:
    """A value that is kept in a file as soon as it is made.

    Args:
        file: which all workers find, by what the value is made of.
        make: gives the value.
    """
    with _locked(file):
        if file.exists():
            return pickle.loads(file.read_bytes())
        value = make()
        file.write_bytes(pickle.dumps(value))
        return value


def folder_of_workers(factory: pytest.TempPathFactory) -> Path:
    """The folder of a session in which each worker finds what others made."""
    own = factory.getbasetemp()
    folder = (own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "of-workers"
    folder.mkdir(exist_ok=True)
    return folder


@contextmanager
def _locked(path: Path) -> Generator[None]:
    """Context of one worker at a time, which ends with it however it ends."""
    with path.with_name(f"{path.name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield
