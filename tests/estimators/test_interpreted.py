"""Loops give the same bits interpreted and compiled: in whole replays and at edges."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.weighing import fitted_stretches
from estimators import compile_cache, interpreted
from estimators.interpreted import CompiledLoop, compile_even_short_loops, compiled_unless_short_log
from estimators.numerics import group_mean, group_sums, rolling, sandwich, small_systems
from estimators.numerics.fit_loss import compute_fit_loss
from tests.golden.golden import LOGS, replay
from tests.twins import mark_slow_after


def copied(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.copy()
    if isinstance(value, tuple):
        parts = map(copied, value)
        return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
    return value


def bits(value: Any) -> Iterator[Any]:
    """Every number of arrays in tuples; one that is none is like any other."""
    if isinstance(value, tuple):
        for each in value:
            yield from bits(each)
    elif isinstance(value, np.ndarray) and value.dtype == np.float64:
        yield value.shape, np.where(np.isnan(value), np.nan, value).tobytes()
    elif isinstance(value, np.ndarray):
        yield value.shape, value.tobytes()
    else:
        yield "nan" if value != value else value


def both_ways(loop: CompiledLoop, *arguments: Any) -> Any:
    """Call it both ways; what it returns and what it wrote must agree."""
    own = tuple(map(copied, arguments))
    by_python = loop._run_in_python(own)
    compiled = loop.compiled(*arguments)
    assert list(bits(by_python)) == list(bits(compiled)), loop.__name__
    assert list(bits(own)) == list(bits(arguments)), loop.__name__
    return compiled


@pytest.mark.heavy
@pytest.mark.parametrize("log", mark_slow_after(1, LOGS))
def test_every_call_of_a_replay(log: str, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: set[str] = set()

    def call(loop: CompiledLoop, *arguments: Any) -> Any:
        asked.add(loop.__name__)
        # those that read are asked in their own test, with memory that nothing has been written to
        ahead = not loop._at_first
        return both_ways(loop, *arguments) if ahead else loop.compiled(*arguments)

    monkeypatch.setattr(CompiledLoop, "__call__", call)
    replay(log)
    assert len(asked) > 30


GROUPS = [
    np.array([], np.int64),
    np.array([-1, -1]),
    np.array([0, 0, 1, 1, 1, -1, 2, 2, 2, 2]),
    np.array([-1, 0, 0, 0, -1, -1, 1]),
]


@pytest.mark.parametrize("group", GROUPS)
def test_groups_that_are_empty_or_have_holes(group: np.ndarray) -> None:
    x = np.random.default_rng(1).normal(size=(group.size, 3))
    rows = np.flatnonzero(group >= 0)
    means = np.empty((rows.size, 3))
    both_ways(group_mean.fill_trailing_group_means, x.T.copy(), group, 2, rows, means)
    both_ways(group_sums._sum_squares, x, group)


@pytest.mark.parametrize("count", [0, 1, 5])
def test_sums_of_nothing_and_of_zeros_of_either_sign(count: int) -> None:
    terms, sums = np.full((3, 10), -0.0), np.zeros((3, 5))
    both_ways(rolling.fill_suffix_sums, terms, count, sums)
    both_ways(rolling.add_prefix_sums, terms, 0, 0, count, sums)
    both_ways(rolling.add_prefix_sums, terms, 2, 3, count, sums)


def test_systems_that_are_singular_or_hold_what_is_no_number() -> None:
    A = np.random.default_rng(2).normal(size=(5, 20, 3))
    A[1, :, 1], A[2, :, 0], A[3, 4, 2] = A[1, :, 0], 0.0, np.nan
    G = np.stack([small_systems.pack_symmetric_matrix(each.T @ each) for each in A], axis=1)
    for p in (1, 2, 3):
        L, inverse = both_ways(small_systems.factor_packed_ldl, G, 3, p)
        both_ways(small_systems.solve_factored_in_place, L, inverse, G[:p].copy())
        both_ways(small_systems.compute_condition_numbers, G, 3, p)


@pytest.mark.parametrize("lags", [1, 2, 7])
@pytest.mark.parametrize("across_later", [False, True])
def test_neighbours_of_the_first_and_the_last_sample(lags: int, across_later: bool) -> None:
    rng = np.random.default_rng(3)
    z, near, correlation = rng.normal(size=(2, 6)), np.empty((2, 6)), rng.normal(size=lags)
    # the later sample of a pair has it where its block is no shorter than the lags
    for left in range(min(lags, 6) - 1 if across_later else 1, 6):
        near.fill(np.nan)
        both_ways(sandwich.sum_correlated_neighbours, z, 6, left, across_later, correlation, near)


@pytest.mark.parametrize("begin", [0, 3])
def test_samples_before_the_first(begin: int) -> None:
    rng = np.random.default_rng(4)
    A, group = rng.normal(size=(9, 2)), np.array([0, 0, 0, 1, 0, 0, 0, 0, 1])
    both_ways(sandwich.compute_sandwich_meat, A, group, 0, begin, 7, rng.normal(size=5))


def test_columns_that_are_0_in_a_group() -> None:
    rng = np.random.default_rng(6)
    A, group = rng.normal(size=(2100, 5)), np.repeat([0, 1], [100, 2000])
    A[:100, [0, 3]] = A[100:, [1, 3]] = 0.0
    for number, first, last in ((0, 0, 99), (1, 100, 2099)):
        meat = both_ways(
            sandwich.compute_sandwich_meat, A, group, number, first, last, rng.normal(size=9)
        )
        assert meat.any(axis=0).tolist() == A[first : last + 1].any(axis=0).tolist()


@pytest.mark.parametrize("delay_rows", [0.3, -2.7, 2.0, 40.5])
def test_samples_that_are_later_by_a_part_of_a_step(delay_rows: float) -> None:
    row, stretch = np.arange(30.0), np.repeat([-1, 0, -1, 1], [3, 12, 2, 13])
    cubic = (row - 9.0) ** 3
    later = both_ways(fitted_stretches._interpolate_later_samples, cubic, stretch, delay_rows)
    if abs(delay_rows) < 5.0:
        np.testing.assert_allclose(later[7:10], (row[7:10] + delay_rows - 9.0) ** 3, atol=1e-9)


def test_a_fit_shorter_than_its_lags(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(CompiledLoop, "__call__", both_ways)
    A = np.random.default_rng(5).normal(size=(12, 2))
    assert compute_fit_loss(A, np.repeat([0, 1, -1, 2], [5, 3, 1, 3]), 4).shape == (4, 4)


@pytest.fixture
def loop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., CompiledLoop]:
    """Makes a loop of which nothing is kept."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    compile_cache.known_folder_of.cache_clear()

    def make() -> CompiledLoop:
        made = compiled_unless_short_log(small_systems.find_packed_index._function)
        made.__dict__["compiled"] = lambda *_: "compiled"
        return made

    return make


def test_little_is_interpreted_where_nothing_is_kept(loop: Callable[..., CompiledLoop]) -> None:
    assert loop()(0, 1, 2) == 1


def test_much_is_compiled(loop: Callable[..., CompiledLoop]) -> None:
    rows = np.zeros(interpreted.MOST_COLD_ROWS + 1)
    assert loop()(rows, 1, 2) == "compiled"
    assert loop()((0, rows), 1, 2) == "compiled"


def test_a_loop_that_has_taken_long_is_compiled(
    loop: Callable[..., CompiledLoop], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(interpreted, "MOST_COLD_SECONDS", 1e-9)
    mine = loop()
    assert mine(0, 1, 2) == 1
    assert mine(0, 1, 2) == "compiled"


@pytest.mark.heavy
def test_what_another_process_has_compiled_is_used(loop: Callable[..., CompiledLoop]) -> None:
    before = loop()
    assert before(0, 1, 2) == 1
    code = (
        "from estimators.interpreted import compile_even_short_loops\n"
        "from estimators.numerics.small_systems import find_packed_index\n"
        "with compile_even_short_loops():\n"
        "    find_packed_index(0, 1, 2)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=compile_cache._HOUSE)
    assert loop()(0, 1, 2) == "compiled"


def test_everything_is_compiled_when_that_is_asked_for(loop: Callable[..., CompiledLoop]) -> None:
    with compile_even_short_loops():
        assert loop()(0, 1, 2) == "compiled"
    assert loop()(0, 1, 2) == 1
