"""Which manoeuvres share a level: exact partitions, shared effects, scatter."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from estimators.joint.changepoints import find_best_partitions
from estimators.joint.partition_posterior import PartitionPosterior, Stretches
from estimators.joint.unit_levels import DUMPED, FILLED, HINTED, RESTARTED, TURNED, UnitLevels
from tests.twins import mark_slow_after

SPREAD = 1200.0
USUAL = 72.0
STD = 15.0


def units(levels, seed=0, scatter=0.0, effect=None, kind=None):
    """Manoeuvres of these levels, with noise; `effect` is what β = 1 adds to each."""
    dice = np.random.default_rng(seed)
    levels = np.asarray(levels, float)
    n = levels.size
    y = levels + dice.normal(0.0, STD, n) + dice.normal(0.0, scatter, n)
    x = np.zeros((n, 0)) if effect is None else np.asarray(effect, float)[:, None]
    gram = np.zeros((0, 0)) if effect is None else np.array([[300.0**-2]])
    kind = np.ones(n - 1, np.int64) if kind is None else np.asarray(kind)
    return UnitLevels(y, x, np.full(n, STD**2), gram, np.zeros(x.shape[1]), kind)


def state_of(levels, **more):
    return find_best_partitions(units(levels, **more), SPREAD, USUAL).best.state.tolist()


def log_posterior(drawn, state):
    """Of a partition, where manoeuvres do not scatter."""
    stretches = Stretches.from_boundaries(np.asarray(state), drawn)
    return PartitionPosterior(drawn, SPREAD, 0.0, None).fit_partition(stretches).log_posterior


class TestPartitions:
    def test_one_load_is_one_state(self):
        assert state_of([3600.0] * 9) == [0] * 9

    def test_a_change_is_found_where_it_is(self):
        assert state_of([3600.0] * 4 + [3850.0] * 5) == [0] * 4 + [1] * 5

    def test_a_load_that_comes_back_is_a_state_of_its_own(self):
        levels = [3600.0] * 3 + [3850.0] * 3 + [3600.0] * 3
        assert state_of(levels) == [0] * 3 + [1] * 3 + [2] * 3

    @pytest.mark.heavy
    def test_records_that_differ_little_are_told_where_they_end_and_not_elsewhere(self):
        """Seven records of two manoeuvres, each three deviations of a difference above the last."""
        levels = np.repeat(3600.0 + 45.0 * np.arange(7), 2)
        kind = np.tile([0, RESTARTED], 7)[:-1]
        ended, stood = (
            [max(state_of(levels, seed=seed, kind=each)) + 1 for seed in range(8)]
            for each in (kind, kind // RESTARTED)
        )
        assert ended.count(7) >= 6
        assert stood.count(7) == 0

    def test_a_change_that_may_as_well_be_where_a_record_ends_is_there(self):
        """The last manoeuvre of the third of six records is a little nearer to the fourth."""
        levels = np.array([3600.0] * 9 + [3653.0] + [3700.0] * 10)
        kind = np.ones(19, np.int64)
        kind[[2, 5, 9, 12, 15]] = RESTARTED
        ended, stood = (
            find_best_partitions(
                replace(units(levels, kind=each), y=levels), SPREAD, USUAL
            ).best.state
            for each in (kind, np.ones_like(kind))
        )
        assert ended.tolist() == [0] * 10 + [1] * 10
        assert stood.tolist() == [0] * 9 + [1] * 11

    def test_two_of_seven_records_with_one_load_are_one_state(self):
        levels = np.repeat(3600.0 + 75.0 * np.array([0, 1, 2, 2, 3, 4, 5]), 6)
        kind = np.tile([0, 0, 0, 0, 0, RESTARTED], 7)[:-1]
        states = [max(state_of(levels, seed=seed, kind=kind)) + 1 for seed in range(8)]
        assert states.count(6) >= 6

    @pytest.mark.parametrize("seed", range(10))
    def test_records_of_one_load_are_one_state(self, seed):
        kind = np.tile([0, 0, 0, RESTARTED], 5)[:-1]
        assert max(state_of([3600.0] * 20, seed=seed, kind=kind)) == 0

    @pytest.mark.heavy
    def test_loads_that_change_wherever_the_machine_turns_are_told_by_that(self):
        """Two manoeuvres each, one deviation of their difference apart."""
        levels = np.tile(np.repeat([3600.0, 3621.0], 2), 16)
        kind = np.tile([1, TURNED], 32)[:-1]
        turned, bare = (
            [max(state_of(levels, seed=seed, kind=each)) + 1 for seed in range(8)]
            for each in (kind, np.ones_like(kind))
        )
        assert turned.count(32) >= 6
        assert bare.count(32) == 0

    @pytest.mark.parametrize("seed", range(10))
    def test_a_machine_that_turns_with_one_load_has_one_state(self, seed):
        kind = np.tile([1, TURNED], 16)[:-1]
        assert max(state_of([3600.0] * 32, seed=seed, kind=kind)) == 0

    def test_manoeuvres_that_scatter_alike_are_one_state(self):
        found = find_best_partitions(units([3600.0] * 20, scatter=60.0), SPREAD, USUAL)
        assert found.best.stretch_count == 1
        assert found.best.scatter > 2.0 * STD

    @pytest.mark.parametrize("seed", range(5))
    def test_the_partition_is_the_best_of_all(self, seed, monkeypatch):
        """Against every partition of seven manoeuvres, at the scatter that is known."""
        monkeypatch.setattr("estimators.joint.changepoints._SURE", 0.0)
        drawn = units([3600.0, 3600.0, 3640.0, 3640.0, 3640.0, 3700.0, 3700.0], seed=seed)
        found = find_best_partitions(drawn, SPREAD, USUAL, 0.0).best
        places = range(1, 7)
        every = [
            np.searchsorted(np.array(cut), np.arange(7), "right").astype(np.int64)
            for changes in range(7)
            for cut in combinations(places, changes)
        ]
        best = max(every, key=lambda state: log_posterior(drawn, state))
        assert found.state.tolist() == best.tolist()

    def test_a_change_that_is_not_sure_is_not_said(self):
        drawn = units([3600.0] * 3 + [3640.0] * 3, seed=6)
        two = np.repeat([0, 1], 3)
        assert log_posterior(drawn, two) > log_posterior(drawn, np.zeros(6, np.int64))
        assert find_best_partitions(drawn, SPREAD, USUAL, 0.0).best.stretch_count == 1

    def test_an_offset_in_alternating_directions_is_no_change(self):
        direction = np.array([1.0, -1.0] * 5)
        levels = 3600.0 + 200.0 * direction
        assert len(set(state_of(levels, effect=direction))) == 1
        # and a change beneath it is found
        levels = levels + np.repeat([0.0, 250.0], 5)
        assert state_of(levels, effect=direction) == [0] * 5 + [1] * 5

    def test_no_change_is_where_the_machine_did_not_stand(self):
        levels = [3600.0] * 4 + [3850.0] * 4
        assert state_of(levels, kind=[1, 1, 1, 0, 1, 1, 1]) != [0] * 4 + [1] * 4

    def test_single_manoeuvres_are_told_apart_where_scatter_is_known(self):
        drawn = units([3600.0, 3850.0, 3600.0])
        assert find_best_partitions(drawn, SPREAD, USUAL, 0.0).best.stretch_count == 3
        # else three loads and one that scatters are about as likely
        assert 0.05 < find_best_partitions(drawn, SPREAD, USUAL).single_probability < 0.95

    def test_a_hint_tells_single_manoeuvres_apart(self):
        levels = [3600.0, 4000.0, 3750.0, 4200.0, 3850.0, 3680.0] * 2
        for seed in range(5):
            found = find_best_partitions(units(levels, seed=seed), SPREAD, USUAL)
            hinted = find_best_partitions(
                units(levels, seed=seed, kind=[HINTED] * 11), SPREAD, USUAL
            )
            assert found.best.stretch_count == 1
            assert hinted.best.stretch_count > 4
            assert hinted.single_probability < 0.5 * found.single_probability

    def test_loads_that_a_direction_could_explain_are_told_where_each_change_is_hinted(self):
        """Empty forward and loaded in reverse: one level takes effects that hide all changes."""
        direction = np.tile([1.0, -1.0], 40)
        loads = np.random.default_rng(1).normal(700.0, 120.0, 40)
        levels = 3600.0 + np.column_stack([np.zeros(40), loads]).ravel()
        kind = [FILLED, HINTED] * 39 + [FILLED]
        assert 76 <= len(set(state_of(levels, effect=direction, kind=kind))) <= 80

    @pytest.mark.heavy
    def test_loads_below_the_scatter_are_told_where_something_is_filled_and_emptied(self):
        levels, kind = (
            np.tile([3600.0, 3600.0, 3655.0, 3655.0], 10),
            ([1, FILLED, 1, HINTED] * 10)[:-1],
        )
        for seed in range(5):
            bare = find_best_partitions(units(levels, seed=seed, scatter=40.0), SPREAD, USUAL).best
            filled = find_best_partitions(
                units(levels, seed=seed, scatter=40.0, kind=kind), SPREAD, USUAL
            )
            assert bare.stretch_count < 5
            assert filled.best.stretch_count >= 18

    @pytest.mark.parametrize("parts", [2, 3])
    def test_loads_that_are_emptied_in_parts_are_told_where_the_machine_fills_and_dumps(
        self, parts: int
    ) -> None:
        """After each part the machine backs, turns and comes again; no two loads are alike."""
        loads = np.random.default_rng(parts).normal(160.0 * parts, 8.0, 7)
        left = np.arange(parts, -1, -1) / parts
        levels = np.concatenate([3600.0 + np.repeat(load * left, 2)[:-1] for load in loads])
        kind = ([1, DUMPED] + [HINTED, DUMPED] * (parts - 1) + [FILLED]) * 7
        drive = np.random.default_rng(1).normal(0.0, 1.0, levels.size)
        state = np.tile(np.repeat(np.arange(parts + 1), 2)[:-1], 7)
        expected = np.append(0, np.cumsum(np.diff(state) != 0)).tolist()
        found = [state_of(levels, seed=k, effect=drive, kind=kind[:-1]) for k in range(8)]
        assert found.count(expected) >= 7

    def test_fillings_in_a_row_that_load_nothing_make_no_states_of_one_level(self):
        """A heap is pushed together after each dump, before the bucket is filled."""
        levels = np.tile([3600.0, 3600.0, 4200.0], 6)
        kind = ([FILLED, FILLED, DUMPED] * 6)[:-1]
        for seed in range(4):
            found = find_best_partitions(units(levels, seed=seed, kind=kind), SPREAD, USUAL).best
            assert np.diff(found.level).all()

    @pytest.mark.heavy
    @pytest.mark.parametrize("scatter", mark_slow_after(1, [45.0, 0.0, 15.0]))
    def test_what_is_taken_for_fillings_may_tell_nothing(self, scatter):
        kind = ([1, FILLED, 1, HINTED] * 8)[:-1]
        drawn = [units([3600.0] * 32, seed=k, scatter=scatter, kind=kind) for k in range(20)]
        states = [find_best_partitions(each, SPREAD, USUAL).best.stretch_count for each in drawn]
        assert np.mean(np.array(states) == 1) >= 0.7

    @pytest.mark.parametrize("scatter", [0.0, 15.0, 45.0])
    def test_what_moves_everywhere_may_tell_nothing(self, scatter):
        for seed in range(10):
            drawn = units([3600.0] * 15, seed=seed, scatter=scatter, kind=[HINTED] * 14)
            assert find_best_partitions(drawn, SPREAD, USUAL).best.stretch_count == 1

    def test_two_loads_that_take_turns_need_no_hint(self):
        """Of loads that are each their own, twelve starts that alternate would be scatter."""
        for seed in range(5):
            found = find_best_partitions(units([3600.0, 3850.0] * 6, seed=seed), SPREAD, USUAL)
            assert found.best.stretch_count == 12
            assert found.best.level.tolist() == [0, 1] * 6
            assert found.best.degrees_of_freedom == 10
            assert found.single_probability < 0.05

    def test_an_empty_machine_that_comes_back_needs_no_hint(self):
        levels = [3600.0, 3850.0, 3600.0, 3720.0, 3600.0, 3960.0, 3600.0, 3780.0, 3600.0, 4050.0]
        for seed in range(5):
            found = find_best_partitions(units(levels, seed=seed), SPREAD, USUAL).best
            assert found.stretch_count == 10
            assert set(found.level[::2]) == {0}

    def test_turns_that_a_direction_explains_as_well_are_no_loads(self):
        direction = np.array([1.0, -1.0] * 5)
        found = find_best_partitions(
            units(3600.0 + 100.0 * direction, effect=direction), SPREAD, USUAL
        )
        assert found.best.stretch_count == 1

    def test_where_nothing_can_tell_both_are_probable(self):
        found = find_best_partitions(units([3600.0] * 2 + [3680.0] * 2, seed=3), SPREAD, USUAL)
        assert 0.02 < found.single_probability < 0.999

    @pytest.mark.heavy
    @pytest.mark.parametrize("scatter", mark_slow_after(1, [45.0, 0.0, 15.0]))
    def test_a_log_without_a_change_is_hardly_ever_split(self, scatter):
        states = [
            find_best_partitions(
                units([3600.0] * 12, seed=seed, scatter=scatter), SPREAD, USUAL
            ).best.stretch_count
            for seed in range(50)
        ]
        assert np.mean(np.array(states) == 1) >= 0.94
