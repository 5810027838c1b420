"""The undamaged logs, and the table of what became of the damaged ones."""

import os

import pytest

from tests.replay.logs.fuzz.campaign import Tally
from tests.replay.logs.fuzz.sources import SOURCES, Source

_TALLY = pytest.StashKey[Tally]()


@pytest.fixture(scope="session")
def sources(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Source]:
    return {name: write(tmp_path_factory.mktemp(name)) for name, write in SOURCES.items()}


@pytest.fixture(scope="session")
def tally(pytestconfig: pytest.Config) -> Tally:
    return pytestconfig.stash.setdefault(_TALLY, Tally())


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    """What `make fuzz` prints; among all other tests nobody asks for it."""
    found = config.stash.get(_TALLY, None)
    if found is not None and "PAYSCOPE_FUZZ_FILES" in os.environ:
        for line in found.table():
            terminalreporter.write_line(line)
