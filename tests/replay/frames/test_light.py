"""Frames of small logs need little: no compiled code, none of what recordings and figures need."""

import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from random import Random
from typing import Any

import polars as pl
import pytest

from estimators import interpreted
from estimators.errors import LogError
from replay import open_log
from tests.replay.logs.conftest import write_log  # noqa: F401 - a fixture
from tests.replay.logs.written_logs import Joints, write_bag, write_mcap
from tests.twins import mark_heavy_after

HEAVY = ("rerun", "matplotlib", "scipy", "numba", "llvmlite")


def joints(count: int) -> list[Joints]:
    return [
        Joints(10**18 + k * 10**7, {"left": float(k), "right": -float(k)}) for k in range(count)
    ]


@pytest.mark.heavy
@pytest.mark.parametrize("write", mark_heavy_after(1, [write_bag, write_mcap]))
def test_a_small_log_is_read_without_compiled_code(
    tmp_path: Path, write: Callable[[Path, Sequence[Joints]], object]
) -> None:
    path = tmp_path / f"small{'.bag' if write is write_bag else '.mcap'}"
    write(path, joints(50))
    code = f"""
import sys, payscope
rows = payscope.scan_log({str(path)!r}, "/joints", fields=["effort[left]"]).collect()
assert rows["effort[left]"].to_list() == [float(k) for k in range(50)]
print([name for name in {HEAVY} if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def read(path: Path) -> list[Any]:
    """All that there is in a log, and what is lost."""
    try:
        with open_log(path) as log:
            found: list[Any] = []
            for row in log.topics().filter(pl.col("problem").is_null()).iter_rows(named=True):
                try:
                    found.append(log.read(row["topic"], row["fields"]))
                except LogError as error:
                    found.append(str(error))
            return [*found, log.losses()]
    except LogError as error:
        return [str(error)]


def both_ways(path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[list[Any], list[Any]]:
    monkeypatch.setattr(interpreted._InterpreterBudget, "seconds", 0.0)
    compiled = read(path)
    monkeypatch.setattr(interpreted, "is_numba_imported", lambda: False)
    monkeypatch.setattr(interpreted._InterpreterBudget, "seconds", float("inf"))
    monkeypatch.setattr(interpreted, "MOST_TURNS", 2**62)
    return compiled, read(path)


def assert_alike(compiled: list[Any], by_python: list[Any], path: Path) -> None:
    assert len(compiled) == len(by_python)
    for one, other in zip(compiled, by_python, strict=True):
        alike = one.equals(other) if isinstance(one, pl.DataFrame) else one == other
        assert alike, path


@pytest.mark.heavy
def test_both_ways_give_the_same_rows_and_losses_of_every_log(
    own_data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    conformance = sorted(own_data.glob("mcap_conformance/*"))[::6]
    for path in sorted([*own_data.glob("bags/*"), *conformance]):
        assert_alike(*both_ways(path, monkeypatch), path)


def test_both_ways_find_the_same_of_damaged_bytes(
    write_log: Callable[[Sequence[Joints]], Path],  # noqa: F811
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    path = write_log(joints(60))
    if path.is_dir():
        pytest.skip("its files are those of another case")
    whole, draw = path.read_bytes(), Random(4)
    for _ in range(6):
        damaged = bytearray(whole)
        for _ in range(draw.randrange(1, 5)):
            damaged[draw.randrange(len(whole))] ^= 1 << draw.randrange(8)
        path.write_bytes(damaged[: draw.randrange(len(whole) // 2, len(whole) + 1)])
        assert_alike(*both_ways(path, monkeypatch), path)


def test_large_work_is_compiled_though_there_is_time_left(monkeypatch: pytest.MonkeyPatch) -> None:
    loop = interpreted.CompiledLoop(len, "compiled", lambda size: size)
    loop.__dict__["is_cached"] = True
    called: list[str] = []
    loop.__dict__["compiled"] = lambda _: called.append("compiled")
    loop.__dict__["interpreted"] = lambda _: called.append("interpreted")
    monkeypatch.setattr(interpreted, "is_numba_imported", lambda: False)
    monkeypatch.setattr(interpreted._InterpreterBudget, "seconds", 1.0)
    for turns in (interpreted.MOST_TURNS, interpreted.MOST_TURNS + 1):
        loop(turns)
    monkeypatch.setattr(interpreted._InterpreterBudget, "seconds", 0.0)
    loop(1)
    assert called == ["interpreted", "compiled", "compiled"]


def test_small_work_is_compiled_where_a_replay_needs_numba_anyway(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    loop = interpreted.CompiledLoop(len, "compiled", lambda size: size)
    loop.__dict__["is_cached"] = True
    loop.__dict__["compiled"] = lambda _: "compiled"
    loop.__dict__["interpreted"] = lambda _: "interpreted"
    monkeypatch.setattr(interpreted._InterpreterBudget, "seconds", 1.0)
    monkeypatch.delitem(sys.modules, "numba", raising=False)
    assert loop(1) == "interpreted"
    monkeypatch.setitem(sys.modules, "numba", interpreted)
    assert loop(1) == "compiled"
