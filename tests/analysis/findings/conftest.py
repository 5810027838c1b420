"""One drawn machine, with the axes that tell most causes apart."""

from collections.abc import Callable

import polars as pl
import pytest

from benchmarks.findings_rows import AXES, design, needed, replayed
from tests.trials.fault_injection import FAULTS

Named = Callable[..., pl.DataFrame]
BY_NAME = {fault.name: fault for fault in FAULTS}


@pytest.fixture(scope="session")
def named() -> Named:
    """Findings of a log with faults of a size each, by their names."""

    def of(*faults: tuple[str, float], seed: int = 7, axes: tuple[str, ...] = AXES) -> pl.DataFrame:
        chosen = [(BY_NAME[name], size) for name, size in faults]
        sections = needed(design(seed, odd=False), [fault for fault, _ in chosen])
        for fault, size in chosen:
            if fault.ground is not None:
                sections = {**sections, **fault.ground(sections, size)}
        return replayed(sections, chosen, axes).frames["findings"]

    return of
