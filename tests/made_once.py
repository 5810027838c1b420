"""What several tests need, of seconds each, is made by the first that asks in any worker."""

import fcntl
import pickle
import shutil
import tempfile
from collections.abc import Callable, Generator
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeVar

T = TypeVar("T")
#: Where each worker finds what others made.
_FOLDER: list[Path] = []
#: By what they are made of.
_VALUES: dict[str, Any] = {}


def share_folder(folder: Path) -> None:
    """Find in a folder what others made, which they find there as well."""
    folder.mkdir(exist_ok=True)
    _FOLDER[:] = [folder]


def make_folder_once(own: Path, make: Callable[[Path], object]) -> Path:
    """A folder of this worker, which may be written to.

    Args:
        own: which does not exist.
        make: writes into a folder that is empty, and no path of it into a file.
    """
    shared = _FOLDER[0] / own.name
    with _locked(shared):
        if not shared.exists():
            begun = Path(tempfile.mkdtemp(dir=shared.parent))
            make(begun)
            begun.rename(shared)
    return Path(shutil.copytree(shared, own))


def make_value_once(made_of: str, make: Callable[[], T]) -> T:
    """A value that can be pickled.

    Args:
        made_of: all that decides on it.
        make: gives it.
    """
    if made_of not in _VALUES:
        file = _FOLDER[0] / sha256(made_of.encode()).hexdigest()
        with _locked(file):
            if file.exists():
                _VALUES[made_of] = pickle.loads(file.read_bytes())
            else:
                _VALUES[made_of] = make()
                file.write_bytes(pickle.dumps(_VALUES[made_of]))
    return _VALUES[made_of]


@contextmanager
def _locked(path: Path) -> Generator[None]:
    """Context of one worker at a time, which ends with it however it ends."""
    with path.with_name(f"{path.name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield
