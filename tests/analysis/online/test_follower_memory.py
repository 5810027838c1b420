"""What a follower keeps does not grow with the shift, by a simulated clock."""

import gc
import sys
from types import FunctionType, ModuleType

import numpy as np
import polars as pl
import pytest

from analysis.online.follower import Follower
from tests.analysis import plane_drives as plane
from tests.twins import mark_slow_after

LOOK_NS = 500_000_000


def reachable_bytes(root):
    """Bytes of all that an object holds, arrays and frames with their data."""
    todo, seen, total = [root], set(), 0
    while todo:
        each = todo.pop()
        if id(each) in seen or isinstance(each, type | ModuleType | FunctionType):
            continue
        seen.add(id(each))
        total += sys.getsizeof(each)
        if isinstance(each, np.ndarray) and each.base is not None:
            total += each.nbytes
        elif isinstance(each, pl.DataFrame):
            total += int(each.estimated_size())
        else:
            todo += gc.get_referents(each)
    return total


@pytest.mark.heavy
@pytest.mark.parametrize("laps", mark_slow_after(1, [3, 5]))
def test_what_is_kept_after_many_manoeuvres_is_what_is_kept_after_a_few(laps: int):
    noise = {"force_N": 60.0, "acc_m_s2": 0.01, "speed_m_s": 0.005}
    follower = Follower(plane.machine(**noise))
    said = plane.sensors(
        plane.braked(
            plane.start(seconds=3.0), plane.spin(seconds=3.0), plane.start(-1.0, seconds=3.0)
        )
    )
    samples = said.rename({"unix_ns": "log_time_ns"}).with_columns(
        header_stamp_ns=pl.lit(None, pl.Int64)
    )
    times = samples["log_time_ns"]
    lap_ns = int(times[-1] - times[0]) + 10_000_000
    kept = {}
    for lap in range(laps):
        now = samples.with_columns(pl.col("log_time_ns") + lap * lap_ns)
        for begin in range(0, lap_ns, LOOK_NS):
            since = pl.col("log_time_ns") - now["log_time_ns"][0]
            follower.append_samples(
                "table", now.filter(since.is_between(begin, begin + LOOK_NS, "left"))
            )
            follower.collect_complete_rows()
        kept[lap] = reachable_bytes(follower)
    assert follower.manoeuvres >= 2 * laps - 1
    assert follower.spins >= laps - 1
    assert follower.rows_stepped > (laps - 1) * samples.height
    assert kept[laps - 1] < 1.02 * kept[1], kept
