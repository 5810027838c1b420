"""One grid for all channels, without looking into the future or over gaps."""

import numpy as np
import polars as pl
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from analysis.align import align
from estimators.errors import DataError
from tests.one_line import assert_one_line

MS = 1_000_000
T0 = 1_700_000_000_000_000_000
YEARS_50 = 50 * 365 * 86_400_000_000_000
FORCE, SPEED, IMU = "force_x_N", "speed_x_m_s", "specific_force_x_m_s2"


def ticks(period_ms, n, start_ms=0):
    return T0 + start_ms * MS + np.arange(n) * int(period_ms * MS)


def three(channels_of, force, speed=None, imu=None):
    """Channels whose values are their own row numbers."""
    stamps = {FORCE: force, SPEED: force if speed is None else speed}
    stamps[IMU] = force if imu is None else imu
    return channels_of(**{name: (t, np.arange(t.size)) for name, t in stamps.items()})


def test_each_row_holds_the_last_value_at_or_before_it(channels_of, machine):
    channels = three(channels_of, ticks(10, 100), ticks(7, 140, 3), ticks(20, 50, 1))
    aligned, t0 = align(channels, machine())
    assert t0 == T0 + 3 * MS
    for name, frame in channels.items():
        stamps = frame["unix_ns"].to_numpy()
        for t, value in zip(t0 + aligned["t_ns"].to_numpy(), aligned[name], strict=True):
            assert value == np.flatnonzero(stamps <= t)[-1]
    assert not aligned["gap"].any()


@given(rate=st.floats(5, 500), n=st.integers(20, 100))
@example(rate=150.0, n=21)
def test_t_ns_climbs_strictly_on_the_lattice_of_the_rate(channels_of, machine, rate, n):
    aligned, _ = align(three(channels_of, ticks(10, n)), machine({"rate_hz": rate}))
    t = aligned["t_ns"].to_numpy()
    assert t[0] == 0
    np.testing.assert_array_equal(t, np.round(np.arange(t.size) * (1e9 / rate)))
    assert (n - 1) * 10 * MS - t[-1] < 1e9 / rate


@settings(deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    cut=st.integers(150, 290),
    lost=st.lists(st.integers(100, 140), max_size=30),
)
def test_what_comes_after_a_moment_never_changes_the_rows_up_to_it(
    channels_of, machine, seed, cut, lost
):
    generator = np.random.default_rng(seed)
    t = np.delete(ticks(10, 400), lost)
    shift = generator.integers(0, 9) * MS
    x = generator.normal(size=t.size)
    now = channels_of(**{FORCE: (t, x), SPEED: (t + shift, x), IMU: (t, x)})
    moment = t[cut]
    later = {
        name: frame.with_columns(
            pl.when(pl.col("unix_ns") > moment).then(99.0).otherwise(pl.col(name)).alias(name)
        )
        for name, frame in now.items()
    }
    first, t0 = align(now, machine())
    second, again = align(later, machine())
    assert t0 == again
    past = pl.col("t_ns") <= int(moment - t0)
    assert first.filter(past).equals(second.filter(past))


@pytest.mark.parametrize("name", [FORCE, SPEED, IMU])
def test_a_value_is_held_for_three_periods_and_then_the_row_is_a_gap(channels_of, machine, name):
    t = ticks(10, 200)
    stamps = dict.fromkeys((FORCE, SPEED, IMU), t) | {name: np.delete(t, np.s_[51:100])}
    aligned, _ = align(three(channels_of, *stamps.values()), machine())
    expected = np.zeros(200, bool)
    expected[54:100] = True
    np.testing.assert_array_equal(aligned["gap"], expected)
    assert aligned[name][54:100].null_count() == 46
    assert aligned[name].null_count() == 46


def test_a_slow_channel_is_fresh_for_three_of_its_own_periods(channels_of, machine):
    channels = three(channels_of, ticks(10, 400), ticks(200, 20))
    assert not align(channels, machine())[0]["gap"].any()


@pytest.mark.parametrize("jump", [YEARS_50, 86_400_000_000_000, 61_000_000_000])
def test_a_clock_that_jumps_ahead_does_not_make_a_billion_rows(channels_of, machine, jump):
    t = ticks(10, 400) + np.where(np.arange(400) >= 200, jump, 0)
    aligned, _ = align(three(channels_of, t), machine())
    assert aligned.height <= 400 + 10
    grid = aligned["t_ns"].to_numpy()
    assert (np.diff(grid) > 0).all()
    assert (np.diff(grid) > 60e9).sum() == 1
    hole = int(np.argmax(np.diff(grid)))
    assert aligned["gap"][hole : hole + 2].all()
    assert not aligned["gap"][:200].any()
    assert not aligned["gap"][-190:].any()


def test_holes_of_several_channels_that_overlap_are_one_hole(channels_of, machine):
    t = ticks(1000, 1000)
    channels = three(
        channels_of,
        np.delete(t, np.s_[100:300]),
        np.delete(t, np.s_[200:500]),
        np.delete(t, np.s_[700:800]),
    )
    aligned, _ = align(channels, machine({"rate_hz": 1.0}))
    grid = aligned["t_ns"].to_numpy() // 1_000_000_000
    assert (np.diff(grid) > 0).all()
    kept = ~aligned["gap"].to_numpy()
    assert not ((grid[kept] > 102) & (grid[kept] < 500)).any()
    assert {0, 102, 500, 702, 800, 999} <= set(grid[kept])
    assert aligned.height < 1000 - 400 + 90


def test_a_hole_shorter_than_a_minute_keeps_its_rows(channels_of, machine):
    t = ticks(10, 400) + np.where(np.arange(400) >= 200, 30_000 * MS, 0)
    aligned, _ = align(three(channels_of, t), machine())
    assert aligned.height == 3400
    assert aligned["gap"].sum() == 3000 - 3


def test_channels_that_share_no_time_are_an_error_that_gives_their_spans(channels_of, machine):
    channels = three(channels_of, ticks(10, 100), ticks(10, 100, 5000))
    with pytest.raises(DataError) as error:
        align(channels, machine())
    assert_one_line(error.value)
    assert str(error.value).startswith("the channels share no stretch of time: force_x_N 17000000")
    assert "speed_x_m_s 1700000005.000…1700000005.990 s" in str(error.value)


def test_only_the_time_in_common_is_kept(channels_of, machine):
    channels = three(channels_of, ticks(10, 100), ticks(10, 100, 300), ticks(10, 60, 100))
    aligned, t0 = align(channels, machine())
    assert t0 == T0 + 300 * MS
    assert t0 + aligned["t_ns"][-1] == T0 + 100 * MS + 590 * MS


def test_a_hint_that_comes_late_and_drops_out_costs_nothing_but_itself(channels_of, machine):
    """A GPS that finds its satellites late must not shorten what is weighed."""
    without = three(channels_of, ticks(10, 1000))
    fixes = np.concatenate([ticks(1000, 2, 2000), ticks(1000, 2, 8000)])
    hinted = {**without, **channels_of(latitude_deg=(fixes, [1.0, 2.0, 3.0, 4.0]))}
    expected, t0 = align(without, machine())
    aligned, t0_hinted = align(hinted, machine())
    assert t0_hinted == t0
    assert aligned.drop("latitude_deg").equals(expected)
    at_s = dict(zip(aligned["t_ns"] // 1_000_000, aligned["latitude_deg"], strict=True))
    assert [at_s[ms] for ms in (1990, 2000, 3990, 6000, 7000, 8000, 9990)] == [
        None,
        1.0,
        2.0,
        2.0,
        None,
        3.0,
        4.0,
    ]
