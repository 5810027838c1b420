"""Low-pass and derivative, inside stretches, with and without a look ahead."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import butter, sosfiltfilt

from analysis.stages.signals.filters import (
    apply_low_pass,
    compute_interpolation_ready_ns,
    compute_median_period_ns,
    differentiate_signal,
    find_slices_between_gaps,
    interpolate_linearly,
)

MS = 1_000_000
T = np.arange(400) * 10 * MS + 1_700_000_000_000_000_000


def pulse(n=401):
    return np.exp(-(((np.arange(n) - n // 2) / 12.0) ** 2))


def test_a_symmetric_pulse_stays_where_it_is():
    t = np.arange(401) * 10 * MS
    times, y = apply_low_pass(t, pulse(), 5.0, 30 * MS, causal=False)
    np.testing.assert_array_equal(times, t)
    assert y.argmax() == 200
    np.testing.assert_allclose(y, y[::-1], atol=1e-9)


def test_the_causal_filter_delays_the_pulse():
    _, y = apply_low_pass(np.arange(401) * 10 * MS, pulse(), 5.0, 30 * MS, causal=True)
    assert 203 < y.argmax() < 220


@pytest.mark.parametrize("causal", [True, False])
def test_a_constant_passes_and_fast_noise_does_not(causal):
    _, y = apply_low_pass(T, np.full(400, 7.0), 10.0, 30 * MS, causal=causal)
    np.testing.assert_allclose(y, 7.0)
    _, y = apply_low_pass(T, np.tile([1.0, -1.0], 200), 10.0, 30 * MS, causal=causal)
    assert np.abs(y[100:300]).max() < 1e-3


def known_by(function, t, times):
    """When the results are known: a central difference waits for the next sample."""
    return compute_interpolation_ready_ns(
        t, t, times + 1 if function is differentiate_signal else times
    )


@pytest.mark.heavy
@settings(deadline=None)
@given(st.integers(20, 398), st.floats(-1e6, 1e6), st.integers(0, 2**32 - 1), st.booleans())
def test_the_causal_forms_never_look_ahead(cut, change, seed, jitter):
    generator = np.random.default_rng(seed)
    t = T + (generator.integers(-2 * MS, 2 * MS, T.size) if jitter else 0)
    x = np.cumsum(generator.normal(size=T.size))
    later = x.copy()
    later[cut + 1 :] += change
    for function, extra in ((apply_low_pass, (10.0, 3.0)), (differentiate_signal, (3.0,))):
        times, before = function(t, x, *extra, causal=True)
        _, after = function(t, later, *extra, causal=True)
        past = known_by(function, t, times) <= t[cut]
        np.testing.assert_array_equal(before[past], after[past])


@pytest.mark.parametrize("causal", [True, False])
def test_nothing_leaks_over_a_gap(causal):
    t = T + np.where(np.arange(400) >= 200, 500 * MS, 0)
    x = np.where(np.arange(400) >= 200, 1000.0, 0.0)
    for times, y in (
        apply_low_pass(t, x, 10.0, 30 * MS, causal=causal),
        differentiate_signal(t, np.where(x > 0, 1000.0, 0.0), 30 * MS, causal=causal),
    ):
        assert set(np.round(np.unique(y[times < t[200]]), 9)) == {0.0}
        assert np.ptp(y[times >= t[200]]) < 1e-6


@pytest.mark.heavy
@settings(deadline=None)
@given(st.lists(st.integers(16, 60), min_size=1, max_size=8), st.integers(0, 2**32 - 1))
def test_stretches_of_a_burst_are_filtered_as_scipy_filters_each(lengths, seed):
    t = np.concatenate([np.arange(n) * 10 * MS + k * 10**10 for k, n in enumerate(lengths)])
    x = np.random.default_rng(seed).normal(size=t.size)
    sos = butter(4, 10.0, fs=100.0, output="sos")
    parts = np.split(x, np.cumsum(lengths)[:-1])
    times, y = apply_low_pass(t, x, 10.0, 30 * MS, causal=False)
    np.testing.assert_array_equal(times, t)
    np.testing.assert_array_equal(y, np.concatenate([sosfiltfilt(sos, part) for part in parts]))


def test_a_stretch_too_short_to_settle_is_left_out():
    t = np.concatenate([T[:200], T[200:210] + 500 * MS, T[210:] + 1000 * MS])
    times, _ = apply_low_pass(t, np.zeros(400), 10.0, 30 * MS, causal=False)
    np.testing.assert_array_equal(times, np.delete(t, np.s_[200:210]))
    times, y = apply_low_pass(T[:5], np.zeros(5), 10.0, 30 * MS, causal=False)
    assert times.size == y.size == 0


def test_irregular_stamps_are_put_on_their_own_median_period():
    generator = np.random.default_rng(1)
    t = T + generator.integers(-2 * MS, 2 * MS, T.size)
    times, y = apply_low_pass(t, (t - t[0]) / 1e9, 10.0, 30 * MS, causal=False)
    assert np.ptp(np.diff(times)) <= 1
    assert times[0] == t[0]
    inside = slice(40, -40)
    np.testing.assert_allclose(y[inside], ((times - t[0]) / 1e9)[inside], atol=1e-4)


@pytest.mark.parametrize("phase_ms", [0, 4, 9])
def test_the_causal_filter_delays_a_line_alike_at_any_phase_of_its_stamps(phase_ms):
    """Irregular stamps are interpolated, not held: a line comes out the filter's delay later."""
    regular = T + phase_ms * MS
    t = regular + np.where(np.arange(T.size) % 3 == 2, 3 * MS, 0)
    delays = []
    for stamps in (regular, t):
        times, y = apply_low_pass(stamps, (stamps - T[0]) / 1e9, 10.0, 30 * MS, causal=True)
        delays.append(((times - T[0]) / 1e9 - y)[200:390])
    np.testing.assert_allclose(delays[1], delays[0], atol=2e-6)


def test_a_value_between_samples_is_known_with_the_later_one():
    t = np.array([0, 10, 20, 30])
    np.testing.assert_array_equal(
        compute_interpolation_ready_ns(t, t + 5, np.array([0, 1, 10, 19, 30])), [5, 15, 15, 25, 35]
    )


def test_interpolation_leaves_out_what_has_no_near_neighbours():
    t, x = np.array([0, 10, 20, 60]), np.array([0.0, 1.0, 3.0, 4.0])
    at = np.array([-1, 0, 5, 15, 20, 40, 60, 61])
    times, y = interpolate_linearly(t, x, at, 30.0)
    np.testing.assert_array_equal(times, [0, 5, 15, 20, 60])
    np.testing.assert_array_equal(y, [0.0, 0.5, 2.0, 3.0, 4.0])


@given(
    st.lists(st.integers(5 * MS, 15 * MS), min_size=4, max_size=50),
    st.floats(-100, 100),
    st.floats(-100, 100),
)
def test_the_derivative_of_a_line_is_its_slope_at_any_stamps(steps, slope, start):
    t = 1_700_000_000_000_000_000 + np.cumsum(steps)
    x = start + slope * ((t - t[0]) / 1e9)
    for causal in (True, False):
        times, rate = differentiate_signal(t, x, 300 * MS, causal=causal)
        np.testing.assert_array_equal(times, t[1:-1] if causal else t)
        np.testing.assert_allclose(rate, slope, atol=1e-6)


@pytest.mark.parametrize("causal", [True, False])
def test_even_readings_whose_stamps_scatter_have_slopes_that_are_right_on_average(causal):
    """A parabola through three samples gives 5 % too much here, and a mass 5 % too small."""
    dice = np.random.default_rng(1)
    even = np.arange(20_000) * 50 * MS
    speed = np.sin(even / 1e9)
    stamped = even + np.round(np.abs(dice.normal(0.0, 10 * MS, even.size))).astype(np.int64)
    times, rate = differentiate_signal(stamped, speed, 300 * MS, causal=causal)
    true = np.cos(times / 1e9)
    assert rate @ true / (true @ true) == pytest.approx(1.0, abs=0.012)


def test_two_samples_have_no_derivative():
    times, rate = differentiate_signal(T[:2], np.zeros(2), 30 * MS, causal=False)
    assert times.size == rate.size == 0


@given(st.lists(st.integers(1, 100), min_size=1, max_size=40))
def test_stretches_cut_at_every_long_step_and_nowhere_else(steps):
    t = np.cumsum(steps)
    parts = find_slices_between_gaps(t, 50.0)
    np.testing.assert_array_equal(np.concatenate([t[part] for part in parts]), t)
    assert all((np.diff(t[part]) <= 50).all() for part in parts)
    assert len(parts) == 1 + (np.diff(t) > 50).sum()


def test_the_period_is_the_median_step():
    assert compute_median_period_ns(np.array([0, 10, 20, 1000])) == 10.0
    assert np.isnan(compute_median_period_ns(np.array([5])))


@pytest.mark.parametrize("samples", [2, 3, 101, 102, 103, 4000])
@pytest.mark.parametrize("kinds", [1, 2, 3, 10**9])
def test_the_period_is_the_median_however_many_steps_are_equal(samples: int, kinds: int) -> None:
    steps = np.random.default_rng(samples).integers(1, kinds + 1, samples - 1)
    stamps = np.concatenate([[0], np.cumsum(steps)])
    assert compute_median_period_ns(stamps) == np.median(steps)
