"""The fuzz twin of `scan_log`: of damaged logs it gives what `read` gives, losses too."""

import os
import warnings
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import polars as pl
import pytest

from analysis.model.loss import Loss
from estimators.errors import LogError
from payscope import LossWarning, scan_log
from replay import open_log
from replay.logs import Log
from tests.replay.logs.fuzz.campaign import make_case
from tests.replay.logs.fuzz.sources import SOURCES, Source
from tests.twins import mark_heavy_after

FILES = int(os.environ.get("PAYSCOPE_FUZZ_FILES", "2"))
FIRST = int(os.environ.get("PAYSCOPE_FUZZ_FIRST", "0"))
#: What says that an index lies about times: rows that it hides come after later ones.
LATE = "outside the times that its index gives"


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Source]:
    return {name: write(tmp_path_factory.mktemp(name)) for name, write in SOURCES.items()}


def topics_of(path: Path) -> list[tuple[str, list[str]]]:
    with suppress(LogError), open_log(path) as log:
        readable = log.topics().filter(pl.col("problem").is_null())
        return [(row["topic"], row["fields"]) for row in readable.iter_rows(named=True)]
    return []


def read(log: Log, topic: str, fields: list[str]) -> pl.DataFrame | str:
    try:
        return log.read(topic, fields)
    except LogError as error:
        return str(error)


def faults(path: Path) -> Iterator[str]:
    for topic, fields in topics_of(path):
        with open_log(path) as log:
            expected, lost = read(log, topic, fields), set(log.losses())
        losses: list[Loss] = []
        try:
            lazy = scan_log(path, topic, enums="number", times="ns", losses=losses)
            found = lazy.collect()
        except LogError as error:
            if expected != str(error):
                yield f"{topic}: {error} where reading gives {expected}"
            continue
        if isinstance(expected, str):
            yield f"{topic}: rows where reading says {expected}"
            continue
        if any(LATE in str(loss) for loss in losses):
            found = found.sort("log_time_ns", maintain_order=True)
        if not found.equals(expected):
            yield f"{topic}: {found} where reading gives {expected}"
        if missing := lost - set(losses):
            yield f"{topic}: silent about {missing}"


@pytest.mark.parametrize("container", mark_heavy_after(1, SOURCES))
def test_a_damaged_log_is_scanned_as_it_is_read(
    container: str, sources: dict[str, Source], tmp_path: Path
) -> None:
    found: list[str] = []
    for number in range(FIRST, FIRST + FILES):
        case = make_case(sources, container, number, tmp_path / f"{number}")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", LossWarning)
            found += [f"{container} {number}: {fault}" for fault in faults(case.path)]
    assert not found, "\n".join(found)
