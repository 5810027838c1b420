"""Exact change-point search with shared effects: which values of a series share a level.

Each unit (a manoeuvre, say) has y = level + x β + δ + ε, with ε of known variance v, δ the scatter
between units of one level, and β effects that all units share, about which each unit has
information of its own. The partition is the one with the largest posterior probability
(`partition_posterior`). Given β and the scatter it is found exactly (`find_least_cost_partition`),
and so are two alternating levels. Finally, uncertain changes of the most probable partition are
dropped one by one.

Jackson et al. 2005, An algorithm for optimal partitioning of data on an interval; Killick et al.
2012, Optimal detection of changepoints with a linear computational cost.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Floats, Ints
from estimators.interpreted import compiled_unless_short_log
from estimators.joint.change_rates import list_partitions_changing_at_places
from estimators.joint.joint_limits import LIMITS
from estimators.joint.partition_posterior import Partition, PartitionPosterior, Stretches
from estimators.joint.unit_levels import (
    DUMPED,
    FILLED,
    HINTED,
    NAMED,
    RESTARTED,
    TURNED,
    UnitLevels,
)
from estimators.numerics.in_order import sum_in_order

#: Bytes of the (units,) level numbers of a partition, by which equal partitions are found.
PackedPartition = bytes
#: Smallest log odds of a change against none for which it is reported.
_SURE: Final = float(np.log(20.0))


@dataclass(frozen=True, slots=True)
class Partitions:
    """The best partition and the candidates it was chosen from.

    Attributes:
        best: the most probable partition, without uncertain changes.
        single: the partition with one level.
        several: the most probable partition with several levels; None for one unit.
        single_probability: probability of a single level among all candidates, each at its best
            scatter.
        single_probability_by_place: the same with the recurrent places of the changes.
    """

    best: Partition
    single: Partition
    several: Partition | None
    single_probability: float
    single_probability_by_place: float


def find_best_partitions(
    unit_values: UnitLevels,
    max_level_distance: float,
    usual_scatter_std: float,
    known_scatter_std: float | None = None,
) -> Partitions:
    """Find the most probable partition.

    Args:
        unit_values: the units in order.
        max_level_distance: largest plausible distance between levels.
        usual_scatter_std: typical standard deviation between units of one level.
        known_scatter_std: known standard deviation between units of one level; None if unknown.
    """
    n = unit_values.y.size
    typical = float(np.sqrt(np.median(unit_values.variance)))
    scatters = (
        [times * typical for times in LIMITS.tried_scatters]
        if known_scatter_std is None
        else [known_scatter_std]
    )
    one, each_own = np.zeros(n, np.int64), np.append(0, np.cumsum(unit_values.kind > 0))
    # with many changes, the effects fitted with one level hide them from searches that start there
    least_kinds = (TURNED, RESTARTED, HINTED, DUMPED, FILLED, NAMED)
    hinted = [np.append(0, np.cumsum(unit_values.kind >= least)) for least in least_kinds if n > 1]
    by_place = list_partitions_changing_at_places(unit_values)
    noise_alone = PartitionPosterior(unit_values, max_level_distance, 0.0, None)
    start = [
        noise_alone.estimate_shared_effects(one),
        noise_alone.estimate_shared_effects(np.arange(n)),
    ]
    found: dict[PackedPartition, tuple[Partition, PartitionPosterior]] = {}
    stretches: dict[PackedPartition, Stretches] = {}
    for tau in scatters:
        posterior = PartitionPosterior(
            unit_values,
            max_level_distance,
            tau,
            usual_scatter_std if known_scatter_std is None else None,
        )
        tried = {each.tobytes() for each in (one, each_own, *hinted, *by_place)}
        for effects in start if n > 1 else []:
            tried |= _propose_partitions(posterior, effects)
        # in an order that is the same in every process, as sums depend on it
        for key in sorted(tried):
            if key not in stretches:
                stretches[key] = Stretches.from_boundaries(
                    np.frombuffer(key, np.int64), unit_values
                )
            each = posterior.fit_partition(stretches[key])
            if key not in found or each.log_posterior > found[key][0].log_posterior:
                found[key] = each, posterior
    single, _ = found[one.tobytes()]
    others = [each for key, each in found.items() if key != one.tobytes()]
    logs = [(each.log_posterior, each.log_posterior_by_place) for each, _ in found.values()]
    probability, by_place_1 = np.exp(single.log_posterior - np.logaddexp.reduce(logs)).tolist()
    if not others:
        return Partitions(single, single, None, probability, by_place_1)
    # places tell which of several levels are likely, not whether there are several
    has_several = max(each.log_posterior for each, _ in others) > single.log_posterior
    several, posterior = max(others, key=lambda each: each[0].log_posterior_by_place)
    several = move_changes_to_nearest_record_ends(several, posterior)
    best = single
    if has_several:
        best = _drop_uncertain_changes(several, posterior)
    likeliest = best if best.stretch_count > 1 else several
    return Partitions(best, single, likeliest, probability, by_place_1)


def move_changes_to_nearest_record_ends(
    partition: Partition, posterior: PartitionPosterior
) -> Partition:
    """Move changes to the nearest end of a record if that is more probable.

    The searches assume the same probability of a change everywhere; the posterior also uses the
    kinds of the boundaries.
    """
    kind = posterior.units.kind
    ends = np.flatnonzero(kind == RESTARTED) + 1
    for change in np.flatnonzero(np.diff(partition.state)) + 1 if ends.size else ():
        changes = np.flatnonzero(np.diff(partition.state)) + 1
        low = max(changes[changes < change], default=0)
        high = min(changes[changes > change], default=kind.size + 1)
        for end in (*ends[ends < change][-1:], *ends[ends > change][:1]):
            if low < end < high:
                moved = np.sort(np.append(changes[changes != change], end))
                state = np.searchsorted(moved, np.arange(kind.size + 1), "right")
                tried = posterior.fit_partition(Stretches.from_boundaries(state, posterior.units))
                partition = max((partition, tried), key=lambda each: each.log_posterior_by_place)
    return partition


def _drop_uncertain_changes(partition: Partition, posterior: PartitionPosterior) -> Partition:
    """Drop uncertain changes, the least certain first."""
    while partition.stretch_count > 1:
        first = np.flatnonzero(np.diff(partition.state)) + 1
        least = np.argsort(np.abs(np.diff(partition.levels)), kind="stable")[
            : LIMITS.removable_changes
        ]
        # each change alone, and both changes of a level, so that its neighbours can be merged
        joints = [first[k : k + many] for k in least for many in (1, 2)]
        plainer = [
            posterior.fit_partition(
                Stretches.from_boundaries(
                    _merge_states_at_boundaries(partition.state, joint), posterior.units
                )
            )
            for joint in joints
        ]
        allowed = [
            min_log_odds_of_reported_change(posterior.units.kind[joint - 1]) for joint in joints
        ]
        margin = [
            each.log_posterior_by_place - (partition.log_posterior_by_place - odds)
            for each, odds in zip(plainer, allowed, strict=True)
        ]
        likeliest = int(np.argmax(margin))
        if margin[likeliest] < 0.0:
            break
        partition = plainer[likeliest]
    return partition


def min_log_odds_of_reported_change(change_kind: Ints) -> float:
    """Return the minimum log odds at which a change is reported.

    If all changes are between records, even odds suffice, since both sides are separate records.
    """
    return 0.0 if (change_kind == RESTARTED).all() else _SURE


def _merge_states_at_boundaries(state_of_unit: Ints, boundaries: Ints) -> Ints:
    """Merge the states on both sides of the given boundaries."""
    changes = np.diff(state_of_unit, prepend=0)
    changes[boundaries] = 0
    return np.cumsum(changes)


def _propose_partitions(
    posterior: PartitionPosterior, initial_effects: Floats
) -> set[PackedPartition]:
    """Candidates for the most probable partition, starting from given effects."""
    units, spread = posterior.units, posterior.spread
    level = units.y - units.x @ initial_effects
    tried = {partition_into_two_alternating_levels(level, posterior.variance, units.kind).tobytes()}
    if np.count_nonzero(units.kind == FILLED) > 1:
        tried |= propose_fill_cycle_partitions(posterior, initial_effects)
    for probability in LIMITS.candidate_probabilities:
        for window in LIMITS.candidate_windows:
            tried |= _propose_partitions_by_iterating_effects(
                posterior, window * spread, probability, initial_effects
            )
    return tried


def propose_fill_cycle_partitions(
    posterior: PartitionPosterior, initial_effects: Floats
) -> set[PackedPartition]:
    """Propose partitions that alternate filling and emptying, iterated with their effects."""
    units, tried = posterior.units, set[PackedPartition]()
    for _ in range(LIMITS.partition_max_rounds):
        state = partition_by_fill_cycles(
            units.y - units.x @ initial_effects, posterior.variance, units.kind
        )
        if state.tobytes() in tried:
            break
        tried.add(state.tobytes())
        initial_effects = posterior.estimate_shared_effects(state)
    return tried


def _propose_partitions_by_iterating_effects(
    posterior: PartitionPosterior,
    max_level_distance: float,
    change_probability: float,
    initial_effects: Floats,
) -> set[PackedPartition]:
    """Candidates from iterating between partition and effects until the partition is stable."""
    units, weight = posterior.units, 1.0 / posterior.variance
    cost = np.full(units.y.size - 1, -2.0 * np.log(change_probability / (1.0 - change_probability)))
    cost[units.kind == 0] = LIMITS.impossible_change_cost
    tried: set[PackedPartition] = set()
    for _ in range(LIMITS.partition_max_rounds):
        state = find_least_cost_partition(
            units.y - units.x @ initial_effects, weight, cost, max_level_distance
        )
        key = state.tobytes()
        if key in tried:
            break
        tried.add(key)
        initial_effects = posterior.estimate_shared_effects(state)
    return tried


def partition_into_two_alternating_levels(
    values: Floats, variance: Floats, change_kinds: Ints
) -> Ints:
    """Partition the units by two alternating levels with the least sum of squares.

    Args:
        values: (n,) level of each unit, for given effects.
        variance: (n,) variance of each level.
        change_kinds: (n - 1,) kind of each boundary.

    Returns:
        (n,) numbers of the levels, from 0: one more at each change.
    """
    order = np.argsort(values, kind="stable")
    weight = (1.0 / variance)[order]
    below, first = np.cumsum(weight)[:-1], np.cumsum(weight * values[order])[:-1]
    total, whole = below[-1] + weight[-1], first[-1] + weight[-1] * values[order[-1]]
    above = total - below
    # units of negligible weight do not separate the levels
    between = np.divide(first**2, below, out=np.zeros(below.size), where=below > 0.0)
    between += np.divide((whole - first) ** 2, above, out=np.zeros(below.size), where=above > 0.0)
    heavy = values > values[order[int(np.argmax(between))]]
    return np.append(0, np.cumsum((np.diff(heavy) != 0) & (change_kinds > 0)))


def partition_by_fill_cycles(values: Floats, variance: Floats, change_kinds: Ints) -> Ints:
    """Partition the units by two levels: heavy after each filling until light fits better.

    Args:
        values: (n,) level of each unit, for given effects.
        variance: (n,) variance of each level.
        change_kinds: (n - 1,) kind of each boundary.

    Returns:
        (n,) numbers of the levels, from 0: one more at each change.
    """
    weight = 1.0 / variance
    part = np.append(0, np.cumsum(change_kinds == FILLED))
    first = np.flatnonzero(np.append(True, np.diff(part) > 0))
    size = np.diff(np.append(first, values.size))
    # initially each filling is emptied halfway; units before the first filling are light
    heavy = (np.arange(values.size) - first[part] < size[part] / 2.0) & (part > 0)
    for _ in range(LIMITS.partition_max_rounds):
        if heavy.all() or not heavy.any():
            break
        low, high = (np.average(values[each], weights=weight[each]) for each in (~heavy, heavy))
        gain = weight * ((values - low) ** 2 - (values - high) ** 2)
        before = heavy
        heavy = mark_heavy_units(gain, first)
        if np.array_equal(heavy, before):
            break
    return np.append(0, np.cumsum((np.diff(heavy) != 0) & (change_kinds > 0)))


@compiled_unless_short_log
def mark_heavy_units(gain_if_heavy: Floats, first_unit_of_stretch: Ints) -> NDArray[np.bool_]:
    """Mark the heavy units: each stretch up to its largest cumulative gain, (n,).

    Args:
        gain_if_heavy: (n,) gain of each unit if heavy.
        first_unit_of_stretch: (stretches,) first unit of each stretch.
    """
    heavy = np.zeros(gain_if_heavy.size, np.bool_)
    for part in range(first_unit_of_stretch.size):
        end = (
            first_unit_of_stretch[part + 1]
            if part + 1 < first_unit_of_stretch.size
            else gain_if_heavy.size
        )
        total, most, until = 0.0, 0.0, first_unit_of_stretch[part]
        for k in range(first_unit_of_stretch[part], end):
            total += gain_if_heavy[k]
            if total > most:
                most, until = total, k + 1
        heavy[first_unit_of_stretch[part] : until] = True
    return heavy


@compiled_unless_short_log
def find_least_cost_partition(
    values: Floats, weights: Floats, change_costs: Floats, max_level_distance: float
) -> Ints:
    """Partition that minimises Σ w (y - ȳ)² + log(W L²/2π) per level plus the changes' cost.

    Args:
        values: (n,) y.
        weights: (n,) w, reciprocal variance of each value; W is its sum over a level.
        change_costs: (n - 1,) cost of a change between neighbours; may be negative.
        max_level_distance: L, largest plausible distance between levels.

    Returns:
        (n,) numbers of the levels, from 0.
    """
    n = values.size
    y = values - sum_in_order(values) / n
    w, wy, wyy = np.zeros(n + 1), np.zeros(n + 1), np.zeros(n + 1)
    w[1:], wy[1:], wyy[1:] = np.cumsum(weights), np.cumsum(weights * y), np.cumsum(weights * y * y)
    area = max_level_distance * max_level_distance / (2.0 * np.pi)
    # smallest and largest cost of an additional level
    least_level, most_level = math.log(weights.min() * area), math.log(w[n] * area)
    before, starts = np.zeros(n + 1, np.int64), np.zeros(n, np.int64)
    # cost of the best partition that ends here, with and without the change
    paid, bare = np.zeros(n), np.zeros(n)
    alive = 0
    for end in range(1, n + 1):
        starts[alive] = end - 1
        alive += 1
        least = np.inf
        for k in range(alive):
            start = starts[k]
            inside, sums = w[end] - w[start], wy[end] - wy[start]
            bare[k] = paid[start] + wyy[end] - wyy[start] - sums * sums / inside
            if bare[k] + least_level < least:
                total = bare[k] + math.log(inside * area)
                if total < least:
                    least, before[end] = total, start
        if end == n:
            break
        paid[end] = least + change_costs[end - 1]
        # a start of a level that is worse by more than a change and a level never becomes the best
        kept = 0
        for k in range(alive):
            if bare[k] + least_level < paid[end] + most_level:
                starts[kept] = starts[k]
                kept += 1
        alive = kept
    return trace_back_level_of_each_unit(before)


@compiled_unless_short_log
def trace_back_level_of_each_unit(level_start_by_end: Ints) -> Ints:
    """Number of the level of each unit, (n,) from 0.

    Args:
        level_start_by_end: (n + 1,) first unit of the level that ends before each unit.
    """
    end = level_start_by_end.size - 1
    starts = np.zeros(end, np.int64)
    while end > 0:
        end = level_start_by_end[end]
        starts[end] = 1
    return np.cumsum(starts) - 1
