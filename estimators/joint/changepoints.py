"""Exact change-point search with shared effects: which values of a series share a level.

Each unit (a manoeuvre, say) has y = level + x β + δ + ε: ε of a known variance v, δ the scatter
between units of one level, β effects that all units share and about which the units know something
of their own. The partition is the one with the largest posterior probability
(`partition_posterior`). Given β and the scatter it is found exactly (`optimal_partition`), and so
are two levels that take turns. Of the most probable one only the changes are kept that are sure,
one after another.

Jackson et al. 2005, An algorithm for optimal partitioning of data on an interval; Killick et al.
2012, Optimal detection of changepoints with a linear computational cost.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Floats, Ints
from estimators.interpreted import compiled_ahead
from estimators.joint.group_effects import FILLED, HINTED, NAMED, RESTARTED, TURNED, GroupEffects
from estimators.joint.joint_limits import LIMITS
from estimators.joint.partition_posterior import Partition, PartitionPosterior, Stretches
from estimators.numerics.in_order import sum_in_order

#: A change is said where it is at least so much likelier than none, as a logarithm.
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
    """

    best: Partition
    single: Partition
    several: Partition | None
    single_probability: float


def find_partitions(
    units: GroupEffects, spread: float, usual: float, scatter: float | None = None
) -> Partitions:
    """Find the most probable partition.

    Args:
        units: the units in order.
        spread: largest plausible distance between levels.
        usual: typical standard deviation between units of one level.
        scatter: known standard deviation between units of one level; None if unknown.
    """
    n = units.y.size
    typical = float(np.sqrt(np.median(units.variance)))
    scatters = (
        [times * typical for times in LIMITS.tried_scatters] if scatter is None else [scatter]
    )
    one, each_own = np.zeros(n, np.int64), np.append(0, np.cumsum(units.kind > 0))
    # with many changes, effects that one level needs hide them from every search that begins there
    least_kinds = (TURNED, RESTARTED, HINTED, FILLED, NAMED)
    hinted = [np.append(0, np.cumsum(units.kind >= least)) for least in least_kinds if n > 1]
    noise_alone = PartitionPosterior(units, spread, 0.0, None)
    begin = [noise_alone.effects(one), noise_alone.effects(np.arange(n))]
    found: dict[bytes, tuple[Partition, PartitionPosterior]] = {}
    stretches: dict[bytes, Stretches] = {}
    for tau in scatters:
        posterior = PartitionPosterior(units, spread, tau, usual if scatter is None else None)
        tried = {each.tobytes() for each in (one, each_own, *hinted)}
        for effects in begin if n > 1 else []:
            tried |= _propose_partitions(posterior, effects)
        # in an order that does not change from process to process, as sums depend on it
        for key in sorted(tried):
            if key not in stretches:
                stretches[key] = Stretches.from_boundaries(np.frombuffer(key, np.int64), units.kind)
            each = posterior.evaluate(stretches[key])
            if key not in found or each.log_posterior > found[key][0].log_posterior:
                found[key] = each, posterior
    single, _ = found[one.tobytes()]
    others = [each for key, each in found.items() if key != one.tobytes()]
    logs = np.array([each.log_posterior for each, _ in found.values()])
    probability = float(np.exp(single.log_posterior - np.logaddexp.reduce(logs)))
    if not others:
        return Partitions(single, single, None, probability)
    several, posterior = max(others, key=lambda each: each[0].log_posterior)
    several = move_to_record_ends(several, posterior)
    best = single
    if several.log_posterior > single.log_posterior:
        best = _drop_unsure_changes(several, posterior)
    return Partitions(best, single, best if best.states > 1 else several, probability)


def move_to_record_ends(best: Partition, posterior: PartitionPosterior) -> Partition:
    """Move changes to the nearest end of a record if that is more probable.

    The searches assume one probability of a change everywhere; the posterior knows the boundaries'
    kinds.
    """
    kind = posterior.units.kind
    ends = np.flatnonzero(kind == RESTARTED) + 1
    for change in np.flatnonzero(np.diff(best.state)) + 1 if ends.size else ():
        changes = np.flatnonzero(np.diff(best.state)) + 1
        low = max(changes[changes < change], default=0)
        high = min(changes[changes > change], default=kind.size + 1)
        for end in (*ends[ends < change][-1:], *ends[ends > change][:1]):
            if low < end < high:
                moved = np.sort(np.append(changes[changes != change], end))
                state = np.searchsorted(moved, np.arange(kind.size + 1), "right")
                tried = posterior.evaluate(Stretches.from_boundaries(state, kind))
                best = max((best, tried), key=lambda each: each.log_posterior)
    return best


def _drop_unsure_changes(best: Partition, posterior: PartitionPosterior) -> Partition:
    """Drop uncertain changes, the least certain first."""
    while best.states > 1:
        first = np.flatnonzero(np.diff(best.state)) + 1
        least = np.argsort(np.abs(np.diff(best.levels)), kind="stable")[: LIMITS.removable_changes]
        # each change alone, and both of a level, which lets its neighbours be one
        joints = [first[k : k + many] for k in least for many in (1, 2)]
        plainer = [
            posterior.evaluate(
                Stretches.from_boundaries(_merge_states_at(best.state, joint), posterior.units.kind)
            )
            for joint in joints
        ]
        allowed = [_min_log_odds_of_change(posterior.units.kind[joint - 1]) for joint in joints]
        margin = [
            each.log_posterior - (best.log_posterior - odds)
            for each, odds in zip(plainer, allowed, strict=True)
        ]
        likeliest = int(np.argmax(margin))
        if margin[likeliest] < 0.0:
            break
        best = plainer[likeliest]
    return best


def _min_log_odds_of_change(kind: Ints) -> float:
    """Minimum log odds of a change that is reported.

    At the end of a record even odds suffice, since both sides are separate records.
    """
    return 0.0 if (kind == RESTARTED).all() else _SURE


def _merge_states_at(state: Ints, boundaries: Ints) -> Ints:
    """Merge the states on both sides of the given boundaries."""
    changes = np.diff(state, prepend=0)
    changes[boundaries] = 0
    return np.cumsum(changes)


def _propose_partitions(posterior: PartitionPosterior, effects: Floats) -> set[bytes]:
    """Candidates for the most probable partition, starting from given effects."""
    units, spread = posterior.units, posterior.spread
    level = units.y - units.x @ effects
    tried = {assign_two_levels(level, posterior.variance, units.kind).tobytes()}
    if np.count_nonzero(units.kind == FILLED) > 1:
        tried |= find_fill_cycles(posterior, effects)
    for probability in LIMITS.candidate_probabilities:
        for window in LIMITS.candidate_windows:
            tried |= _iterate_partition_and_effects(
                posterior, window * spread, probability, effects
            )
    return tried


def find_fill_cycles(posterior: PartitionPosterior, effects: Floats) -> set[bytes]:
    """Candidates with alternate filling and emptying, iterated with their effects."""
    units, tried = posterior.units, set[bytes]()
    for _ in range(LIMITS.partition_max_rounds):
        state = assign_cycle_states(units.y - units.x @ effects, posterior.variance, units.kind)
        if state.tobytes() in tried:
            break
        tried.add(state.tobytes())
        effects = posterior.effects(state)
    return tried


def _iterate_partition_and_effects(
    posterior: PartitionPosterior, spread: float, probability: float, effects: Floats
) -> set[bytes]:
    """Candidates from iterating between partition and effects until nothing changes."""
    units, weight = posterior.units, 1.0 / posterior.variance
    cost = np.full(units.y.size - 1, -2.0 * np.log(probability / (1.0 - probability)))
    cost[units.kind == 0] = LIMITS.impossible_change_cost
    tried: set[bytes] = set()
    for _ in range(LIMITS.partition_max_rounds):
        state = optimal_partition(units.y - units.x @ effects, weight, cost, spread)
        key = state.tobytes()
        if key in tried:
            break
        tried.add(key)
        effects = posterior.effects(state)
    return tried


def assign_two_levels(level: Floats, variance: Floats, kind: Ints) -> Ints:
    """Assign the units to two alternating levels with the least sum of squares.

    Args:
        level: (n,) level of each unit, for given effects.
        variance: (n,) variance of each level.
        kind: (n - 1,) kind of each boundary.
    """
    order = np.argsort(level, kind="stable")
    weight = (1.0 / variance)[order]
    below, first = np.cumsum(weight)[:-1], np.cumsum(weight * level[order])[:-1]
    total, whole = below[-1] + weight[-1], first[-1] + weight[-1] * level[order[-1]]
    above = total - below
    # units that weigh next to nothing beside the others part nothing
    between = np.divide(first**2, below, out=np.zeros(below.size), where=below > 0.0)
    between += np.divide((whole - first) ** 2, above, out=np.zeros(below.size), where=above > 0.0)
    heavy = level > level[order[int(np.argmax(between))]]
    return np.append(0, np.cumsum((np.diff(heavy) != 0) & (kind > 0)))


def assign_cycle_states(level: Floats, variance: Floats, kind: Ints) -> Ints:
    """Assign two levels: heavy after each filling, until the light level fits better.

    Args:
        level: (n,) level of each unit, for given effects.
        variance: (n,) variance of each level.
        kind: (n - 1,) kind of each boundary.
    """
    weight = 1.0 / variance
    part = np.append(0, np.cumsum(kind == FILLED))
    first = np.flatnonzero(np.append(True, np.diff(part) > 0))
    size = np.diff(np.append(first, level.size))
    # at first each is emptied halfway; what comes before the first filling is light
    heavy = (np.arange(level.size) - first[part] < size[part] / 2.0) & (part > 0)
    for _ in range(LIMITS.partition_max_rounds):
        if heavy.all() or not heavy.any():
            break
        low, high = (np.average(level[each], weights=weight[each]) for each in (~heavy, heavy))
        gain = weight * ((level - low) ** 2 - (level - high) ** 2)
        before = heavy
        heavy = find_heavy_units(gain, first)
        if np.array_equal(heavy, before):
            break
    return np.append(0, np.cumsum((np.diff(heavy) != 0) & (kind > 0)))


@compiled_ahead
def find_heavy_units(gain: Floats, first: Ints) -> NDArray[np.bool_]:
    """Mark the heavy units: each stretch up to its largest cumulative gain, (n,).

    Args:
        gain: (n,) gain of each unit if heavy.
        first: (stretches,) first unit of each stretch.
    """
    heavy = np.zeros(gain.size, np.bool_)
    for part in range(first.size):
        end = first[part + 1] if part + 1 < first.size else gain.size
        total, most, until = 0.0, 0.0, first[part]
        for k in range(first[part], end):
            total += gain[k]
            if total > most:
                most, until = total, k + 1
        heavy[first[part] : until] = True
    return heavy


@compiled_ahead
def optimal_partition(level: Floats, weight: Floats, cost: Floats, spread: float) -> Ints:
    """Partition that minimises Σ w (y - ȳ)² + log(W L²/2π) per level plus the changes' cost.

    Args:
        level: (n,) y.
        weight: (n,) w, reciprocal variance of each value; W is its sum over a level.
        cost: (n - 1,) cost of a change between neighbours; may be negative.
        spread: L, largest plausible distance between levels.

    Returns:
        (n,) numbers of the levels, from 0.
    """
    n = level.size
    y = level - sum_in_order(level) / n
    w, wy, wyy = np.zeros(n + 1), np.zeros(n + 1), np.zeros(n + 1)
    w[1:], wy[1:], wyy[1:] = np.cumsum(weight), np.cumsum(weight * y), np.cumsum(weight * y * y)
    area = spread * spread / (2.0 * np.pi)
    # what one level more costs: at least, and at most
    least_level, most_level = math.log(weight.min() * area), math.log(w[n] * area)
    before, begins = np.zeros(n + 1, np.int64), np.zeros(n, np.int64)
    # the best that ends here, the change included
    paid, bare = np.zeros(n), np.zeros(n)
    alive = 0
    for end in range(1, n + 1):
        begins[alive] = end - 1
        alive += 1
        least = np.inf
        for k in range(alive):
            begin = begins[k]
            inside, sums = w[end] - w[begin], wy[end] - wy[begin]
            bare[k] = paid[begin] + wyy[end] - wyy[begin] - sums * sums / inside
            if bare[k] + least_level < least:
                total = bare[k] + math.log(inside * area)
                if total < least:
                    least, before[end] = total, begin
        if end == n:
            break
        paid[end] = least + cost[end - 1]
        # a level that is worse by more than a change and a level cost never comes back
        kept = 0
        for k in range(alive):
            if bare[k] + least_level < paid[end] + most_level:
                begins[kept] = begins[k]
                kept += 1
        alive = kept
    return _number_levels_from_begins(before)


@compiled_ahead
def _number_levels_from_begins(first_unit_of_level: Ints) -> Ints:
    """Level number of each unit (n,), from the first unit of the level that ends there."""
    end = first_unit_of_level.size - 1
    begins = np.zeros(end, np.int64)
    while end > 0:
        end = first_unit_of_level[end]
        begins[end] = 1
    return np.cumsum(begins) - 1
