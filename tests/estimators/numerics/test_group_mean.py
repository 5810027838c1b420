"""The trailing mean inside groups against a naive loop."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from estimators.numerics.group_mean import fill_trailing_group_means

groups = st.lists(st.tuples(st.integers(-1, 3), st.integers(1, 8)), min_size=1, max_size=8).map(
    lambda runs: np.repeat([g for g, _ in runs], [n for _, n in runs]).astype(np.int64)
)


def trailing_group_mean(x, group, samples):
    """The means of one column at all samples of a group, 0 elsewhere."""
    rows = np.flatnonzero(group >= 0)
    mean, count = np.zeros(x.size), np.zeros(x.size, np.int64)
    means = np.empty((rows.size, 1))
    count[rows] = fill_trailing_group_means(x[None], group, samples, rows, means)
    mean[rows] = means[:, 0]
    return mean, count


def naive(x, group, samples):
    """A sample's mean and count: it and those before it, as long as their group is its own."""
    mean, count = np.zeros(x.size), np.zeros(x.size, np.int64)
    for k in range(x.size):
        if group[k] < 0:
            continue
        first = k
        while first > 0 and group[first - 1] == group[k] and k - first + 1 < samples:
            first -= 1
        mean[k], count[k] = x[first : k + 1].mean(), k - first + 1
    return mean, count


@settings(deadline=None, max_examples=200)
@given(groups, st.integers(1, 12), st.integers(0, 2**32 - 1))
def test_it_is_the_naive_mean(group, samples, seed):
    x = np.random.default_rng(seed).normal(0.0, 1000.0, group.size)
    mean, count = trailing_group_mean(x, group, samples)
    expected, how_many = naive(x, group, samples)
    np.testing.assert_allclose(mean, expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(count, how_many)


def test_where_no_group_is_nothing_is_looked_at():
    x = np.array([np.nan, 1.0, 3.0, np.inf, 5.0])
    mean, count = trailing_group_mean(x, np.array([-1, 0, 0, -1, 0]), 2)
    assert mean.tolist() == [0.0, 1.0, 2.0, 0.0, 5.0]
    assert count.tolist() == [0, 1, 2, 0, 1]


def test_a_group_begins_anew_without_what_was_before_it():
    x = np.array([1e12, 1e12, 1.0, 2.0])
    mean, _ = trailing_group_mean(x, np.array([0, 0, 1, 1]), 10)
    assert mean.tolist() == [1e12, 1e12, 1.0, 1.5]


@settings(deadline=None, max_examples=50)
@given(groups, st.integers(1, 12), st.integers(1, 5))
def test_some_samples_of_several_columns_have_the_same_means(group, samples, every):
    columns = np.random.default_rng(0).normal(0.0, 1.0, (3, group.size))
    rows = np.flatnonzero(group >= 0)[::every]
    means = np.empty((rows.size, 3))
    count = fill_trailing_group_means(columns, group, samples, rows, means)
    for j, x in enumerate(columns):
        alone, of = trailing_group_mean(x, group, samples)
        np.testing.assert_array_equal(means[:, j], alone[rows])
        np.testing.assert_array_equal(count, of[rows])
