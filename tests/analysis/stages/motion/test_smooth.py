"""The trailing moving mean."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.model.schema import build_frame
from analysis.model.settings import SmoothSettings
from analysis.stages.motion.smooth import compute_trailing_mean, smooth_by_trailing_mean

numbers = st.one_of(st.floats(-1e6, 1e6), st.just(np.nan))


@given(st.lists(numbers, max_size=50), st.integers(1, 60))
def test_the_mean_trails_is_null_until_full_and_where_any_sample_is_missing(x, samples):
    x = np.array(x, float)
    mean = compute_trailing_mean(x, samples)
    for k in range(x.size):
        if k < samples - 1:
            assert np.isnan(mean[k])
        else:
            expected = x[k - samples + 1 : k + 1].mean()
            assert mean[k] == pytest.approx(expected, abs=1e-6, nan_ok=True)


def aligned(n=60, gaps=(), **columns):
    gap = np.zeros(n, bool)
    gap[list(gaps)] = True
    return build_frame("aligned", {"t_ns": np.arange(n) * 10_000_000, **columns, "gap": gap})


@given(st.sets(st.integers(0, 59), max_size=6), st.integers(1, 12))
def test_the_mean_never_reaches_over_a_gap(gaps, samples):
    ramp = np.arange(60.0)
    frame = smooth_by_trailing_mean(
        aligned(gaps=gaps, force_x_N=ramp), SmoothSettings(samples=samples)
    )
    for k, mean in enumerate(frame["force_x_N"]):
        if k < samples - 1 or gaps & set(range(k - samples + 1, k + 1)):
            assert mean is None
        else:
            assert mean == pytest.approx(k - (samples - 1) / 2)


def test_every_column_is_averaged_alike_the_coulomb_sign_included():
    x = np.random.default_rng(1).normal(size=60)
    names = ("force_x_N", "speed_x_m_s", "direction_x_1", "pitch_rad", "boom_rad")
    frame = smooth_by_trailing_mean(aligned(gaps=[30], **dict.fromkeys(names, x)), SmoothSettings())
    for name in names:
        assert frame[name].equals(frame["force_x_N"].alias(name))
    assert frame["force_x_N"].null_count() == 9 + 10


def test_times_gaps_and_columns_stay():
    before = aligned(gaps=[5], force_x_N=np.ones(60))
    after = smooth_by_trailing_mean(before, SmoothSettings())
    assert after.columns == before.columns
    assert after["t_ns"].equals(before["t_ns"])
    assert after["gap"].equals(before["gap"])


def test_a_mean_of_one_sample_changes_nothing_but_gaps():
    x = np.random.default_rng(2).normal(size=60)
    frame = smooth_by_trailing_mean(aligned(gaps=[7], force_x_N=x), SmoothSettings(samples=1))
    np.testing.assert_array_equal(frame["force_x_N"].drop_nulls(), np.delete(x, 7))
