"""Damaged and hostile tables: one line, or what was lost is declared; nothing else.

A few of `benchmarks/damaged_tables.py`, which draws hundreds.
"""

import resource
from pathlib import Path

import pytest

from benchmarks.damaged_tables import damaged, hostile, outcome, packed
from tests.twins import mark_heavy_after

#: The process may grow by so much over all of them, in MB.
MOST_MB = 600
#: What takes half a minute is drawn in the campaign alone.
LONG = "a hundred thousand columns"
CASES = {n: (".csv", data) for n, data in hostile().items() if n != LONG} | packed()
SEEDS = range(0, 200, 8)


@pytest.mark.heavy
@pytest.mark.parametrize("seed", mark_heavy_after(1, SEEDS))
def test_a_damaged_table_is_one_line_or_declared_losses(tmp_path: Path, seed: int) -> None:
    suffix, data = damaged(seed)
    path = tmp_path / f"log{suffix}"
    path.write_bytes(data or b"\n")
    assert outcome(path) in ("refused", "losses declared", "whole")


@pytest.mark.parametrize("name", mark_heavy_after(1, CASES))
def test_a_hostile_table_is_one_line_or_declared_losses(tmp_path: Path, name: str) -> None:
    suffix, data = CASES[name]
    path = tmp_path / f"log{suffix}"
    path.write_bytes(data)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert outcome(path) in ("refused", "losses declared", "whole")
    assert (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1e3 < MOST_MB
