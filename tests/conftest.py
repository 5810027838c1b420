"""What every test may use."""

import os
from pathlib import Path

import pytest

REPO = Path(__file__).resolve().parent.parent


def pytest_configure() -> None:
    """Each parallel worker compiles into a place of its own.

    Numba writes which specialisation is in which file, and the file, one after the other: two
    processes that do so at once may leave one's name on the other's code.
    """
    worker = os.environ.get("PYTEST_XDIST_WORKER")
    if worker:
        from estimators import cache

        cache.ensure()
        os.environ["NUMBA_CACHE_DIR"] = str(Path(os.environ["NUMBA_CACHE_DIR"], worker))


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Logs recorded by others, which the repository does not hold."""
    named = os.environ.get("PAYSCOPE_SHARED_DATA")
    candidates = [Path(named)] if named else [p / "shared/data" for p in REPO.parents]
    for folder in candidates:
        if folder.is_dir():
            return folder
    pytest.skip("no shared/data in any parent folder; PAYSCOPE_SHARED_DATA may name it")
