"""The trailing mean inside groups against a naive loop."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from estimators.group_mean import trailing_group_mean

groups = st.lists(st.tuples(st.integers(-1, 3), st.integers(1, 8)), min_size=1, max_size=8).map(
    lambda runs: np.repeat([g for g, _ in runs], [n for _, n in runs]).astype(np.int64)
)


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
