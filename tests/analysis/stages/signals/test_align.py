"""One grid for all channels, interpolated alike and never over gaps."""

import numpy as np
import polars as pl
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from analysis.stages.signals.align import align_channels_on_grid, list_alignment_notes
from analysis.stages.signals.derive import derive_channels_in_si, read_measured_channels
from analysis.stages.signals.timestamps import assign_timestamps
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


def by_instants(t, x, instants):
    """The line through samples, in exact integers but for the last division."""
    out = []
    for s in instants:
        i = int(np.flatnonzero(t <= s)[-1])
        rest = int(s - t[i])
        out.append(x[i] + (x[i + 1] - x[i]) * rest / int(t[i + 1] - t[i]) if rest else x[i])
    return out


def test_each_row_is_on_the_line_between_the_samples_before_and_after_it(channels_of, machine):
    stamps = (ticks(10, 100), ticks(8, 140, 3), ticks(14, 80, 1))
    generator = np.random.default_rng(1)
    samples = [generator.normal(size=t.size) for t in stamps]
    series = zip((FORCE, SPEED, IMU), stamps, samples, strict=True)
    channels = channels_of(**{name: (t, x) for name, t, x in series})
    aligned, t0 = align_channels_on_grid(channels, machine())
    assert t0 == T0 + 3 * MS
    assert not aligned["gap"].any()
    for name, t, x in zip((FORCE, SPEED, IMU), stamps, samples, strict=True):
        expected = by_instants(t, x, t0 + aligned["t_ns"].to_numpy())
        np.testing.assert_allclose(aligned[name], expected, rtol=0, atol=1e-12)


@given(seed=st.integers(0, 2**32 - 1), start=st.integers(0, 10**17), jitter_us=st.integers(0, 4000))
@example(seed=0, start=0, jitter_us=0)
def test_a_straight_line_comes_back_whatever_the_stamps(
    channels_of, machine, seed, start, jitter_us
):
    """Faster, slower and jittery topics, each at its own phase, at any unix time."""
    generator = np.random.default_rng(seed)
    lines, stamps = {}, {}
    for name in (FORCE, SPEED, IMU):
        period = float(generator.uniform(1.0, 30.0))
        t = np.round(np.arange(2000 / period) * period * MS).astype(np.int64)
        t = t + generator.integers(0, min(jitter_us * 1000, int(period * MS / 2)) + 1, t.size)
        stamps[name] = start + int(generator.integers(0, 20 * MS)) + t
        lines[name] = generator.uniform(-100, 100, 2)
    channels = channels_of(
        **{n: (t, np.polyval(lines[n], (t - start) / 1e9)) for n, t in stamps.items()}
    )
    aligned, t0 = align_channels_on_grid(channels, machine())
    seconds = (t0 - start + aligned["t_ns"].to_numpy()) / 1e9
    kept = ~aligned["gap"].to_numpy()
    assert kept.mean() > 0.9
    for name, line in lines.items():
        expected = np.polyval(line, seconds)[kept]
        np.testing.assert_allclose(aligned[name].to_numpy()[kept], expected, rtol=0, atol=1e-9)


@pytest.mark.heavy
@given(seed=st.integers(0, 2**32 - 1), first=st.integers(0, 20), after=st.integers(1, 40))
def test_samples_that_lie_on_the_grid_are_its_rows_bit_for_bit(
    channels_of, machine, seed, first, after
):
    generator = np.random.default_rng(seed)
    x = generator.normal(size=(3, 200)) * 10.0 ** generator.integers(-9, 9, (3, 1))
    t = ticks(10, 200)
    spans = (slice(first, None), slice(None, -after), slice(None))
    channels = channels_of(
        **{n: (t[s], each[s]) for n, s, each in zip((FORCE, SPEED, IMU), spans, x, strict=True)}
    )
    for settings in ({}, {"causal": True}):
        aligned, _ = align_channels_on_grid(channels, machine(settings))
        kept = aligned.filter(~pl.col("gap"))
        for name, each in zip((FORCE, SPEED, IMU), x, strict=True):
            np.testing.assert_array_equal(kept[name], each[first : 200 - after])


def test_a_faster_topic_is_averaged_over_the_grid_step_about_the_row(channels_of, machine):
    """1 kHz: what alternates from sample to sample is gone, what lies on a line stays."""
    fast = ticks(1, 2000)
    x = np.tile([1.0, -1.0], 1000) + np.arange(2000) / 100.0
    slow = ticks(10, 200)
    channels = channels_of(**{FORCE: (slow, slow * 0.0), SPEED: (slow, slow * 0.0), IMU: (fast, x)})
    aligned, _ = align_channels_on_grid(channels, machine())
    expected = np.arange(200) / 10.0
    np.testing.assert_allclose(aligned[IMU].to_numpy()[1:-1], expected[1:-1], atol=1e-9)


@pytest.mark.heavy
@given(delay_us=st.integers(-40_000, 40_000))
def test_a_delay_of_any_fraction_of_a_step_is_taken_off(raw_topic, machine, delay_us):
    """What says 5 t + 1 at the time t says so still, however late it is stamped."""
    t = ticks(10, 200)
    seconds = np.arange(200) / 100.0
    raw = {
        "/can": raw_topic(t, speed=seconds),
        "/imu": raw_topic(t, x=seconds),
        "/late": raw_topic(t, force=5.0 * (seconds - delay_us / 1e6) + 1.0),
    }
    late = {"topic": "/late", "field": "force", "delay_s": delay_us / 1e6}
    loader = machine(force_x_N=late)
    aligned, _ = align_channels_on_grid(
        derive_channels_in_si(read_measured_channels(assign_timestamps(raw)[0], loader)[0], loader)[
            0
        ],
        loader,
    )
    np.testing.assert_allclose(aligned[FORCE], 5.0 * aligned[SPEED] + 1.0, atol=1e-9)


@given(rate=st.floats(5, 500), n=st.integers(20, 100))
@example(rate=150.0, n=21)
def test_t_ns_climbs_strictly_on_the_lattice_of_the_rate(channels_of, machine, rate, n):
    aligned, _ = align_channels_on_grid(
        three(channels_of, ticks(10, n)), machine({"rate_hz": rate})
    )
    t = aligned["t_ns"].to_numpy()
    assert t[0] == 0
    np.testing.assert_array_equal(t, np.round(np.arange(t.size) * (1e9 / rate)))
    assert (n - 1) * 10 * MS - t[-1] < 1e9 / rate


@pytest.mark.heavy
@given(
    seed=st.integers(0, 2**32 - 1),
    cut=st.integers(150, 290),
    lost=st.lists(st.integers(100, 140), max_size=30),
    latency=st.sampled_from([None, 0.0, 0.004, 0.01, 0.05]),
    periods=st.tuples(*[st.sampled_from([1.0, 3.0, 10.0, 10.5, 40.0])] * 3),
)
def test_when_causal_what_comes_after_a_moment_never_changes_the_rows_up_to_it(
    channels_of, machine, seed, cut, lost, latency, periods
):
    generator = np.random.default_rng(seed)
    now = {}
    for name, period in zip((FORCE, SPEED, IMU, "pitch_rad"), (*periods, 25.0), strict=True):
        t = np.delete(ticks(period, int(4000 / period)), [i for i in lost if i < 4000 / period])
        t = np.unique(t + generator.integers(0, int(period * MS / 2), t.size))
        now |= channels_of(**{name: (t, generator.normal(size=t.size))})
    moment = T0 + cut * 10 * MS
    later = {
        name: each._replace(x=np.where(each.t_ns > moment, 99.0, each.x))
        for name, each in now.items()
    }
    loader = machine({"causal": True, "latency_s": latency})
    first, t0 = align_channels_on_grid(now, loader)
    second, again = align_channels_on_grid(later, loader)
    assert t0 == again
    past = pl.col("t_ns") <= int(moment - t0)
    assert first.filter(past).equals(second.filter(past))
    assert not first.filter(past)["gap"].all()


def test_when_causal_a_row_holds_the_motion_of_the_latency_before_it(channels_of, machine):
    """Two channels that say the time, a third at another phase: the row's time less latency."""
    stamps = {FORCE: ticks(10, 300), SPEED: ticks(10, 300, 3), IMU: ticks(10, 300, 7)}
    channels = channels_of(**{name: (t, (t - T0) / 1e9) for name, t in stamps.items()})
    for latency, held_s in ((None, 0.01), (0.025, 0.025), (0.04, 0.04)):
        aligned, t0 = align_channels_on_grid(
            channels, machine({"causal": True, "latency_s": latency})
        )
        for name in stamps:
            now = (t0 - T0 + aligned["t_ns"]) / 1e9
            np.testing.assert_allclose(aligned[name], now - held_s, atol=1e-9)
    assert list_alignment_notes(channels, machine({"causal": True}))[0].startswith(
        "causal: a row holds the motio"
    )
    assert "0.01 s before it" in list_alignment_notes(channels, machine({"causal": True}))[0]
    assert list_alignment_notes(channels, machine()) == []


def test_when_causal_and_a_sample_is_late_every_channel_waits_alike(channels_of, machine):
    """The force says the time a second late every tenth sample; no channel runs ahead of it."""
    t = ticks(10, 300)
    late = t + np.where(np.arange(300) % 10 == 5, 6 * MS, 0)
    stamps = {FORCE: late, SPEED: t, IMU: t}
    channels = channels_of(**{name: (t, (t - T0) / 1e9) for name, t in stamps.items()})
    aligned, _ = align_channels_on_grid(channels, machine({"causal": True}))
    np.testing.assert_allclose(aligned[SPEED], aligned[FORCE], atol=1e-9)
    np.testing.assert_allclose(aligned[IMU], aligned[FORCE], atol=1e-9)
    assert not aligned["gap"].any()


@pytest.mark.parametrize("name", [FORCE, SPEED, IMU])
def test_between_neighbours_of_more_than_three_periods_the_row_is_a_gap(channels_of, machine, name):
    t = ticks(10, 200)
    lost = np.r_[51:100, 120:122, 150:153]
    stamps = dict.fromkeys((FORCE, SPEED, IMU), t) | {name: np.delete(t, lost)}
    aligned, _ = align_channels_on_grid(three(channels_of, *stamps.values()), machine())
    expected = np.zeros(200, bool)
    expected[51:100] = expected[150:153] = True
    np.testing.assert_array_equal(aligned["gap"], expected)
    assert aligned[name].null_count() == 49 + 3


def test_a_slow_channel_has_no_gap_within_three_of_its_own_periods(channels_of, machine):
    channels = three(channels_of, ticks(10, 400), ticks(200, 20))
    assert not align_channels_on_grid(channels, machine())[0]["gap"].any()


@pytest.mark.parametrize("jump", [YEARS_50, 86_400_000_000_000, 61_000_000_000])
def test_a_clock_that_jumps_ahead_does_not_make_a_billion_rows(channels_of, machine, jump):
    t = ticks(10, 400) + np.where(np.arange(400) >= 200, jump, 0)
    aligned, _ = align_channels_on_grid(three(channels_of, t), machine())
    assert aligned.height <= 400 + 10
    grid = aligned["t_ns"].to_numpy()
    assert (np.diff(grid) > 0).all()
    assert (np.diff(grid) > 60e9).sum() == 1
    hole = int(np.argmax(np.diff(grid)))
    assert aligned["gap"][hole : hole + 2].all()
    assert not aligned["gap"][:200].any()
    assert not aligned["gap"][-190:].any()


@pytest.mark.parametrize(("hole_s", "said"), [(1800, None), (86_400, "24 h from 2 s on")])
def test_a_hole_longer_than_a_break_is_noted(channels_of, machine, hole_s, said):
    t = ticks(10, 400) + np.where(np.arange(400) >= 200, hole_s * 1000 * MS, 0)
    notes = list_alignment_notes(three(channels_of, t), machine())
    assert [note for note in notes if "no readings" in note] == (
        [f"no readings for {said}: the load, the ground and the sensors may have changed there"]
        if said
        else []
    )


def test_holes_of_several_channels_that_overlap_are_one_hole(channels_of, machine):
    t = ticks(1000, 1000)
    channels = three(
        channels_of,
        np.delete(t, np.s_[100:300]),
        np.delete(t, np.s_[200:500]),
        np.delete(t, np.s_[700:800]),
    )
    aligned, _ = align_channels_on_grid(channels, machine({"rate_hz": 1.0}))
    grid = aligned["t_ns"].to_numpy() // 1_000_000_000
    assert (np.diff(grid) > 0).all()
    kept = ~aligned["gap"].to_numpy()
    assert not ((grid[kept] > 99) & (grid[kept] < 500)).any()
    assert {0, 99, 500, 699, 800, 999} <= set(grid[kept])
    assert aligned.height < 1000 - 400 + 90


def test_a_hole_shorter_than_a_minute_keeps_its_rows(channels_of, machine):
    t = ticks(10, 400) + np.where(np.arange(400) >= 200, 30_000 * MS, 0)
    aligned, _ = align_channels_on_grid(three(channels_of, t), machine())
    assert aligned.height == 3400
    assert aligned["gap"].sum() == 3000


def test_channels_that_share_no_time_are_an_error_that_gives_their_spans(channels_of, machine):
    channels = three(channels_of, ticks(10, 100), ticks(10, 100, 5000))
    with pytest.raises(DataError) as error:
        align_channels_on_grid(channels, machine())
    assert_one_line(error.value)
    assert str(error.value).startswith(
        "the channels do not overlap in time; check their topics and clocks: force_x_N 17000000"
    )
    assert "speed_x_m_s 1700000005.000…1700000005.990 s" in str(error.value)


def test_a_slow_channel_that_shares_no_time_is_the_same_error(channels_of, machine):
    channels = three(channels_of, ticks(10, 100), ticks(100, 10, 5000))
    with pytest.raises(DataError, match="do not overlap in time"):
        align_channels_on_grid(channels, machine())


@pytest.mark.heavy
@given(
    st.tuples(*[st.sampled_from([1.0, 3.0, 10.0, 11.0, 50.0, 100.0])] * 3),
    st.integers(0, 2**32 - 1),
    st.booleans(),
)
def test_no_row_inside_a_gap_of_any_channel_has_a_value(
    channels_of, machine, periods, seed, causal
):
    """Whatever the rates, and though a slow channel has no sample inside a short gap."""
    generator = np.random.default_rng(seed)
    stamps = {}
    for name, period in zip((FORCE, SPEED, IMU), periods, strict=True):
        t = ticks(period, int(6000 / period), int(generator.integers(0, 5)))
        lost_from = generator.integers(1000, 4000, 2)
        long = [int(lost + max(3.5 * period, 35)) for lost in lost_from]
        for start_ms, end_ms in zip(lost_from, long, strict=True):
            t = t[(t < T0 + start_ms * MS) | (t > T0 + end_ms * MS)]
        stamps[name] = t
    channels = channels_of(**{name: (t, (t - T0) / MS) for name, t in stamps.items()})
    aligned, _ = align_channels_on_grid(channels, machine({"causal": causal}))
    for t in stamps.values():
        longest = 3 * max(np.median(np.diff(t)), 10 * MS)
        for i in np.flatnonzero(np.diff(t) > longest):
            opened, closed = (t[i] - T0) / MS + 1e-6, (t[i + 1] - T0) / MS - 1e-6
            for name in stamps:
                # a value is the time that it is of; causally the last before a gap is held at first
                shown = aligned.filter(~pl.col("gap"))[name]
                assert not shown.is_between(opened, closed).any()


@pytest.mark.heavy
@given(
    st.tuples(*[st.sampled_from([1.0, 2.0, 5.0, 10.0])] * 3),
    st.sampled_from([20.0, 50.0, 100.0, 130.0]),
    st.integers(0, 2),
    st.tuples(*[st.floats(-1, 1)] * 6),
)
def test_the_equation_holds_in_every_row_though_one_of_its_channels_is_slow(
    channels_of, machine, periods, slow_ms, which, parabolas
):
    """Acceleration and speed that curve, differently; no channel curves less for being slow."""
    names = (IMU, SPEED, FORCE)
    channels = {}
    for i, name in enumerate(names):
        period = slow_ms if i == which else periods[i]
        t = ticks(period, int(4000 / period))
        a, v = (np.polyval(each, (t - T0) / 1e9) for each in (parabolas[:3], parabolas[3:]))
        x = {IMU: a, SPEED: v, FORCE: 3614.0 * a + 2891.0 * v}[name]
        channels |= channels_of(**{name: (t, x)})
    aligned, _ = align_channels_on_grid(channels, machine())
    # no mean over the span reaches about the first and the last stamp
    rows = slice(round(slow_ms / 10) + 1, -round(slow_ms / 5) - 2)
    expected = (3614.0 * aligned[IMU] + 2891.0 * aligned[SPEED]).to_numpy()
    np.testing.assert_allclose(aligned[FORCE].to_numpy()[rows], expected[rows], rtol=0, atol=1.0)
    assert "comes at" in list_alignment_notes(channels, machine())[0]


def test_only_the_time_in_common_is_kept(channels_of, machine):
    channels = three(channels_of, ticks(10, 100), ticks(10, 100, 300), ticks(10, 60, 100))
    aligned, t0 = align_channels_on_grid(channels, machine())
    assert t0 == T0 + 300 * MS
    assert t0 + aligned["t_ns"][-1] == T0 + 100 * MS + 590 * MS


@pytest.mark.parametrize("settings", [{}, {"causal": True}])
def test_a_channel_that_lacks_minutes_at_an_end_is_a_gap_to_that_end(
    channels_of, machine, settings
):
    t = ticks(100, 3000)
    channels = three(channels_of, t[700:], t, t[:2300])
    aligned, t0 = align_channels_on_grid(channels, machine({"rate_hz": 10.0, **settings}))
    latency_ns = t0 - T0
    assert latency_ns == (0 if not settings else 100 * MS)
    assert aligned["t_ns"][-1] == 299_900 * MS
    kept = aligned.filter(~pl.col("gap"))
    assert kept["t_ns"][0] == 70_000 * MS
    # a causal row holds the newest value for as long as a gap begins
    assert kept["t_ns"][-1] == (229_900 if not settings else 230_200) * MS
    assert aligned.height < 1600 + 20
    force, imu = (
        f"no readings of {name} for 1.17 min from {at} s on"
        for name, at in ((FORCE, 0), (IMU, 230))
    )
    assert [n for n in list_alignment_notes(channels, machine(settings)) if "readings" in n] == [
        force,
        imu,
    ]


@pytest.mark.parametrize("settings", [{}, {"causal": True}])
def test_a_slow_channel_that_dies_is_a_gap_to_the_end_as_well(channels_of, machine, settings):
    fast, slow = ticks(20, 15_000), ticks(100, 1800)
    channels = three(channels_of, fast, slow, fast)
    aligned, _ = align_channels_on_grid(channels, machine({"rate_hz": 50.0, **settings}))
    kept = aligned.filter(~pl.col("gap"))
    assert kept["t_ns"][-1] < 181_000 * MS
    assert aligned["t_ns"][-1] > 299_000 * MS
    notes = list_alignment_notes(channels, machine({"rate_hz": 50.0, **settings}))
    assert f"no readings of {SPEED} for 2 min from 180 s on" in notes


def test_what_lacks_the_end_from_other_times_on_is_told_apart(channels_of, machine):
    t = ticks(1000, 12_000)
    channels = three(channels_of, t[:6000], t[:9000], t)
    said = [n for n in list_alignment_notes(channels, machine({"rate_hz": 1.0})) if "readings" in n]
    assert said == [
        f"no readings of {FORCE} for 1.67 h from 5,999 s on",
        f"no readings of {', '.join(sorted((FORCE, SPEED)))} for 50 min from 8,999 s on",
    ]


def test_a_stamp_of_another_clock_is_no_end_of_the_log(channels_of, machine):
    t = ticks(100, 3000)
    stray = np.concatenate([t[:1] - 200_000_000 * MS, t])
    aligned, t0 = align_channels_on_grid(
        three(channels_of, stray, t, t), machine({"rate_hz": 10.0})
    )
    assert t0 == T0
    assert aligned.height == 3000


def test_a_hint_that_comes_late_and_drops_out_costs_nothing_but_itself(channels_of, machine):
    """A GPS that finds its satellites late must not shorten what is weighed."""
    without = three(channels_of, ticks(10, 1000))
    fixes = np.concatenate([ticks(1000, 2, 2000), ticks(1000, 2, 8000)])
    hinted = {**without, **channels_of(latitude_deg=(fixes, [1.0, 2.0, 3.0, 4.0]))}
    expected, t0 = align_channels_on_grid(without, machine())
    aligned, t0_hinted = align_channels_on_grid(hinted, machine())
    assert t0_hinted == t0
    assert aligned.drop("latitude_deg").equals(expected)
    at_s = dict(zip(aligned["t_ns"] // 1_000_000, aligned["latitude_deg"], strict=True))
    assert [at_s[ms] for ms in (1990, 2000, 2750, 3000, 3010, 7990, 8500, 9000)] == [
        None,
        1.0,
        1.75,
        2.0,
        None,
        None,
        3.5,
        4.0,
    ]


def test_longitudes_meet_at_180_degrees(channels_of, machine):
    degrees = np.array([179.0, -179.0, -177.0])
    hinted = {
        **three(channels_of, ticks(10, 300)),
        **channels_of(longitude_deg=(ticks(1000, 3), degrees)),
    }
    aligned, _ = align_channels_on_grid(hinted, machine())
    shown = aligned["longitude_deg"].to_list()
    assert [shown[row] for row in (0, 25, 75, 100, 150)] == [179.0, 179.5, -179.5, -179.0, -178.0]


def test_a_grid_that_would_not_fit_into_memory_is_refused_with_its_rows(channels_of, machine):
    """A sample in a million seconds: its unit is wrong, or the grid's rate."""
    channels = three(channels_of, *[ticks(10**9, 5)] * 3)
    with pytest.raises(DataError, match=r"400,000,001 rows, more than .* settings.align.rate_hz"):
        align_channels_on_grid(channels, machine())
