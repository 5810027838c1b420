"""What every test may use."""

import os
import time
from pathlib import Path

import pytest

REPO = Path(__file__).resolve().parent.parent
BEGAN = pytest.StashKey[float]()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--seconds", type=float, help="skip the tests that are left after so long")


def pytest_configure(config: pytest.Config) -> None:
    """Each parallel worker compiles into a place of its own.

    Numba writes which specialisation is in which file, and the file, one after the other: two
    processes that do so at once may leave one's name on the other's code.
    """
    worker = os.environ.get("PYTEST_XDIST_WORKER")
    if worker:
        os.environ["NUMBA_CACHE_DIR"] = str(REPO / "estimators/__pycache__" / worker)
    config.stash[BEGAN] = time.monotonic()


def pytest_runtest_setup(item: pytest.Item) -> None:
    seconds = item.config.getoption("--seconds")
    if seconds is not None and time.monotonic() - item.config.stash[BEGAN] > seconds:
        pytest.skip(f"the {seconds:g} s are over; make test runs it")


@pytest.fixture(scope="session")
def own_data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Logs of our own making, laid out like those of others."""
    from tests.own_logs import make

    return make(tmp_path_factory.mktemp("own", numbered=False))


@pytest.fixture(params=["own", "others"])
def data(request: pytest.FixtureRequest) -> Path:
    """Logs of our own, then those of others where they are."""
    return request.getfixturevalue("own_data" if request.param == "own" else "shared_data")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Logs recorded by others, which the repository does not hold."""
    named = os.environ.get("PAYSCOPE_SHARED_DATA")
    candidates = [Path(named)] if named else [p / "shared/data" for p in REPO.parents]
    for folder in candidates:
        if folder.is_dir():
            return folder
    pytest.skip(
        "bytes of others: no shared/data in any parent folder (PAYSCOPE_SHARED_DATA may name it); "
        "the same is asked of logs of our own"
    )
