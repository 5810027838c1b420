"""A reading that repeats: resolution at the top of a drive, or a sensor that froze."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.diagnosis.measured_channels import find_unexplained_repeats
from estimators.arrays import Floats, Ints

_KM_H: float = 1.0 / 3.6
rates = st.sampled_from((5.0, 10.0, 20.0, 50.0))
resolutions = st.sampled_from((1.0 / 256.0, 0.01, 0.1))
seeds = st.integers(0, 2**31)


def _stamps(rate_hz: float) -> Ints:
    return np.round(np.arange(60.0 * rate_hz) / rate_hz * 1e9).astype(np.int64)


def _speed_km_h(t_ns: Ints, seed: int) -> Floats:
    """Drives of 8 to 14 s whose speed rises, levels off and falls, as a pedal has it."""
    generator = np.random.default_rng(seed)
    t, speed, begin = t_ns / 1e9, np.zeros(t_ns.size), 1.0
    while begin + 15.0 < t[-1]:  # a channel that dies during the last drive would look like it
        length, top = generator.uniform(8.0, 14.0), generator.uniform(5.0, 30.0)
        inside = (t > begin) & (t < begin + length)
        speed[inside] = top * np.sin(np.pi * (t[inside] - begin) / length) ** 2
        begin += length + 2.0
    return speed


def _round(x: Floats, resolution: float, decimals: int = 4) -> Floats:
    """Readings of a channel of that resolution, as a table's decimals have them."""
    return np.round(np.round(x / resolution) * resolution, decimals) * _KM_H


@given(rates, resolutions, seeds)
def test_a_smooth_speed_repeats_itself_at_its_top_and_is_not_frozen(
    rate_hz: float, resolution: float, seed: int
) -> None:
    t = _stamps(rate_hz)
    runs, _ = find_unexplained_repeats(t, _round(_speed_km_h(t, seed), resolution))
    assert [run for run in runs if run.value > 0.0] == []


@given(rates, resolutions, seeds)
def test_a_speed_that_freezes_on_its_way_up_is_found(
    rate_hz: float, resolution: float, seed: int
) -> None:
    t = _stamps(rate_hz)
    x = _round(_speed_km_h(t, seed), resolution)
    # where it changes fastest: there it misses most
    held = round(1.5 * rate_hz)
    begin = int(np.argmax(x[held:-held] - x[: -2 * held])) or 1
    x[begin : begin + held] = x[begin]
    runs, _ = find_unexplained_repeats(t, x)
    assert any(run.start_ns <= t[begin] and t[begin + held - 1] <= run.end_ns for run in runs)


@pytest.mark.parametrize("noise_steps", [3.0, 10.0])
@given(seeds)
def test_a_noisy_channel_that_freezes_is_found_even_where_it_misses_nothing(
    noise_steps: float, seed: int
) -> None:
    generator = np.random.default_rng(seed)
    t = _stamps(50.0)
    x = np.round(100.0 + noise_steps * generator.normal(size=t.size))
    x[1000:1100] = x[1000]
    runs, _ = find_unexplained_repeats(t, x)
    assert any(run.start_ns <= t[1000] and t[1099] <= run.end_ns for run in runs)


def _ramps() -> tuple[Ints, Floats]:
    """A speed of 0 to 6 m/s and back, without noise or resolution, at 50 Hz."""
    t = _stamps(50.0)
    return t, 3.0 - 3.0 * np.cos(2.0 * np.pi * t / 20e9)


def test_a_speed_that_is_clipped_is_found() -> None:
    t, x = _ramps()
    runs, _ = find_unexplained_repeats(t, np.minimum(x, 4.0))
    assert {run.value for run in runs} == {4.0}


@pytest.mark.parametrize("low_pass_s", [0.05, 0.3])
def test_a_freeze_that_comes_back_through_a_filter_is_found(low_pass_s: float) -> None:
    t, x = _ramps()
    begin, end = 200, 300
    x[begin:end] = x[begin]
    missed = x[end] - x[begin]
    x[end:] -= missed * np.exp(-np.arange(x.size - end) / 50.0 / low_pass_s)
    runs, _ = find_unexplained_repeats(t, x)
    assert any(run.start_ns <= t[begin] and t[end - 1] <= run.end_ns for run in runs)
