"""The least cost of a series of levels, against every partition there is."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from estimators.joint.changepoints import find_least_cost_partition


def cost_of(state, level, weight, cost, spread):
    total = float(cost[np.diff(state) > 0].sum())
    for each in range(state[-1] + 1):
        y, w = level[state == each], weight[state == each]
        total += float(w @ (y - w @ y / w.sum()) ** 2) + np.log(w.sum() * spread**2 / 2.0 / np.pi)
    return total


@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(1, 9),
    jump=st.sampled_from([0.0, 20.0, 200.0]),
    spread=st.sampled_from([10.0, 100.0, 1000.0]),
)
def test_no_partition_costs_less(seed, count, jump, spread):
    dice = np.random.default_rng(seed)
    level = np.cumsum(dice.normal(0.0, jump, count)) + dice.normal(3600.0, 15.0, count)
    weight = dice.uniform(5.0, 30.0, count) ** -2.0
    # a change may be cheap, dear, or ruled out
    cost = np.where(dice.random(count - 1) < 0.1, 1e9, dice.uniform(-4.0, 8.0, count - 1))
    found = find_least_cost_partition(level, weight, cost, spread)
    every = [
        np.concatenate([[0], np.cumsum([(cuts >> place) & 1 for place in range(count - 1)])])
        for cuts in range(2 ** (count - 1))
    ]
    least = min(cost_of(state.astype(int), level, weight, cost, spread) for state in every)
    assert cost_of(found, level, weight, cost, spread) <= least + 1e-6


def test_thousands_of_levels_are_numbered_in_time():
    level = np.repeat(np.arange(500) % 2 * 200.0, 4)
    found = find_least_cost_partition(level, np.full(2000, 15.0**-2), np.full(1999, 3.0), 1000.0)
    assert np.array_equal(found, np.repeat(np.arange(500), 4))
