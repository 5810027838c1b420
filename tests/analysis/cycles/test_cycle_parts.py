"""When a load is dumped: by the boom where it moves, else by the stand."""

import numpy as np
import polars as pl
import pytest

from analysis.cycles.boom_dumps import NO_DUMPS, BoomDump, BoomDumps
from analysis.cycles.cycle_parts import CycleParts, fill_in_dump_times, split_cycles_into_parts
from analysis.cycles.load_passes import LoadPasses

NS = 10**9


def dumped_s(boom_rad: np.ndarray) -> float:
    """When a load is dumped in a stand of as many seconds between a haul and an empty drive."""
    stand = boom_rad.size
    t_ns = np.arange(stand + 20) * NS
    phase = ["cruising"] * 10 + ["standstill"] * stand + ["cruising"] * 10
    start, end = np.array([0, 10 + stand]) * NS, np.array([9, 19 + stand]) * NS
    found = LoadPasses(
        np.arange(2), np.ones(2), np.array([True, False]), np.ones(2), np.ones(2), start, end
    )
    part = CycleParts(loaded_pass=0, empty_pass_after=1)
    boom = np.pad(boom_rad, 10, mode="edge")
    fill_in_dump_times(
        [part],
        found,
        pl.DataFrame({"t_ns": t_ns, "boom_rad": boom}),
        pl.DataFrame({"t_ns": t_ns, "phase": phase}),
    )
    assert part.bucket_emptied_ns is not None
    return part.bucket_emptied_ns / NS - 10.0


def out(*stretches: tuple[int, int, float], of: int = 100) -> np.ndarray:
    boom = np.zeros(of)
    for begin, end, angle_rad in stretches:
        boom[begin : end + 1] = angle_rad
    return boom


def test_idling_after_a_dump_does_not_move_it() -> None:
    assert dumped_s(out((10, 14, 1.0))) == pytest.approx(12.0)


def test_a_bucket_that_is_shaken_is_one_dump() -> None:
    assert dumped_s(out((10, 12, 1.0), (16, 20, 0.9))) == pytest.approx(15.0)


@pytest.mark.parametrize("later_rad", [0.6, 0.9])
def test_a_boom_that_moves_once_more_after_idling_has_not_dumped_in_between(
    later_rad: float,
) -> None:
    assert dumped_s(out((10, 14, 1.0), (80, 84, later_rad))) == pytest.approx(12.0)


def test_without_a_boom_it_is_the_middle_of_the_stand() -> None:
    assert dumped_s(np.zeros(100)) == pytest.approx(49.5)


@pytest.mark.parametrize(
    ("boom", "cycles"),
    [
        # the boom dumps behind what looks like digging: the bucket was still full
        (BoomDumps(shows_dumps=True, dumps=(BoomDump(50 * NS, 52 * NS, 51 * NS),)), 1),
        # it dumped before: the bucket is filled once more
        (BoomDumps(shows_dumps=True, dumps=(BoomDump(40 * NS, 41 * NS, 40 * NS),)), 2),
        # it tells nothing: digging is a cycle
        (NO_DUMPS, 2),
    ],
)
def test_a_bucket_that_is_full_is_not_filled(boom: BoomDumps, cycles: int) -> None:
    begins_s, ends_s = np.array([10, 60]), np.array([39, 90])
    found = LoadPasses(
        np.arange(2), np.ones(2), np.array([True, False]), np.ones(2), np.ones(2),
        begins_s * NS, ends_s * NS, dumps=boom,
    )  # fmt: skip
    digs = pl.DataFrame({"start_t_ns": [2 * NS, 45 * NS], "end_t_ns": [5 * NS, 46 * NS]})
    assert len(split_cycles_into_parts(found, digs)) == cycles
