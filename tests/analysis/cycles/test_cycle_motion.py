"""Distance, speed, stands and holes of cycles that are drawn."""

import numpy as np
import polars as pl
import pytest

from analysis.cycles.cycle_parts import (
    find_idle_spans_ns,
    summarise_cycle_motion,
    summarise_shift_motion,
)

NS = 10**9


def driven() -> pl.DataFrame:
    """100 s: 2 m/s for 30 s, a stand of 40 s, -3 m/s for 30 s; ten samples a second."""
    t = np.arange(0, 100 * 10) / 10.0
    speed = np.where(t < 30.0, 2.0, np.where(t < 70.0, 0.0, -3.0))
    return pl.DataFrame(
        {
            "t_ns": (t * NS).astype(np.int64),
            "speed_x_m_s": speed,
            "phase": np.where(speed == 0.0, "standstill", "cruising"),
        }
    )


def cycle(start_s: float, end_s: float, **more: float | None) -> dict[str, object]:
    times = {"dig_t_ns": None, "load_s": None, "haul_s": None} | more
    return {"cycle": 1, "start_t_ns": int(start_s * NS), "end_t_ns": int(end_s * NS)} | times


def test_distance_counts_both_ways_and_time_is_split_into_moving_and_standing() -> None:
    whole = summarise_shift_motion(driven(), ())
    assert whole.distance_m == pytest.approx(60.0 + 90.0, abs=0.5)
    assert whole.top_speed_m_s == 3.0
    assert (whole.moving_s, whole.standing_s) == (
        pytest.approx(60.0, abs=0.2),
        pytest.approx(40.0, abs=0.2),
    )


def test_a_haul_is_what_is_driven_from_the_load_to_the_dump() -> None:
    table = pl.DataFrame([cycle(0.0, 100.0, dig_t_ns=5 * NS, load_s=5.0, haul_s=20.0)])
    [motion] = summarise_cycle_motion(table, driven(), ())
    assert motion.haul_m == pytest.approx(40.0, abs=0.3)


def test_a_cycle_whose_digging_was_not_seen_has_no_haul_distance() -> None:
    table = pl.DataFrame([cycle(0.0, 100.0, haul_s=20.0)], schema_overrides={"dig_t_ns": pl.Int64})
    assert summarise_cycle_motion(table, driven(), ())[0].haul_m is None


def test_a_hole_is_neither_moving_nor_standing() -> None:
    cut = driven().filter((pl.col("t_ns") < 10 * NS) | (pl.col("t_ns") >= 25 * NS))
    [motion] = summarise_cycle_motion(pl.DataFrame([cycle(0.0, 30.0)]), cut, [(10 * NS, 25 * NS)])
    assert motion.whole.hole_s == pytest.approx(15.0)
    assert motion.whole.distance_m == pytest.approx(30.0, abs=0.5)
    assert motion.whole.moving_s == pytest.approx(15.0, abs=0.3)


def test_without_a_speed_there_is_no_distance() -> None:
    whole = summarise_shift_motion(driven().drop("speed_x_m_s"), ())
    assert (whole.distance_m, whole.top_speed_m_s) == (None, None)
    assert whole.standing_s == pytest.approx(40.0, abs=0.2)


def test_a_stand_of_more_than_half_a_minute_is_idle() -> None:
    [(start_ns, end_ns)] = find_idle_spans_ns(driven())
    assert (start_ns / NS, end_ns / NS) == (pytest.approx(30.0), pytest.approx(69.9))
