"""Changes at recurrent places: a machine fills at one of them and empties at another."""

from dataclasses import replace

import numpy as np

from estimators.joint.change_rates import compute_log_odds_of_changes_by_place
from estimators.joint.changepoints import find_best_partitions
from estimators.joint.unit_levels import TURNED
from tests.estimators.joint.test_changepoints import SPREAD, USUAL, units

CYCLES = 12
#: Five stands a cycle: it dumps at the first turn, and fills on its way back at the last stand.
KIND = np.tile([1, TURNED, 1, TURNED, 1], CYCLES)[:-1]
PLACE = np.tile([1, 2, 3, 4, 5], CYCLES)[:-1]
STATES = np.repeat(np.arange(2 * CYCLES), np.tile([2, 3], CYCLES))


def states_of(seed: int, load: float, place: np.ndarray | None) -> list[int]:
    dice = np.random.default_rng(100 + seed)
    cycles = [np.repeat([3600.0 + load * dice.uniform(0.8, 1.2), 3600.0], [2, 3]) for _ in PLACE]
    drawn = units(np.concatenate(cycles[:CYCLES]), seed=seed, kind=KIND)
    return find_best_partitions(replace(drawn, place=place), SPREAD, USUAL).best.state.tolist()


def test_loads_a_few_deviations_apart_are_told_by_where_they_change():
    by_place, by_turns = (
        sum(states_of(seed, 50.0, place) == STATES.tolist() for seed in range(8))
        for place in (PLACE, None)
    )
    assert by_place >= 7
    assert by_turns <= 2


def test_places_make_no_loads_of_one():
    assert all(max(states_of(seed, 0.0, PLACE)) == 0 for seed in range(8))


def test_changes_at_all_visits_of_two_places_are_likely_and_others_cost_a_half():
    at_two = np.diff(STATES) > 0
    anywhere = np.random.default_rng(0).permutation(at_two)
    assert compute_log_odds_of_changes_by_place(KIND, PLACE, at_two) > 20.0
    odds = compute_log_odds_of_changes_by_place(KIND, PLACE, anywhere)
    assert np.log(0.5) <= odds < 0.0
