"""Load states: which manoeuvres carry one load, and how they scatter about it.

A manoeuvre's mass is what it says once the nuisances that all manoeuvres share are taken off.
A load changes between manoeuvres, where the machine stood.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from analysis.stages.signals.grid_rate import rows_in_duration
from analysis.weighing.motion_samples import (
    Floats,
    Ints,
    MotionSamples,
    first_of_stretch,
    last_of_stretch,
)
from analysis.weighing.weighing_limits import LIMITS
from estimators.joint.changepoints import Partitions, partitions
from estimators.joint.group_effects import FILLED, HINTED, NAMED, RESTARTED, TURNED, GroupEffects
from estimators.joint.partition_posterior import Partition, PartitionPosterior, Stretches
from estimators.joint.random_intercepts import RandomIntercepts

#: With fewer degrees of freedom the manoeuvres do not tell how they scatter.
FEWEST_FREEDOM: Final = 4
_ROUNDS: Final = 60


@dataclass(frozen=True)
class AlternativePartition:
    """The next likely partition of the manoeuvres, if the log does not decide.

    Attributes:
        membership: (units,) the load state of each.
        differs_kg: (units,) by how much its mass then differs.
        scatter_kg: standard deviation of manoeuvres about their state.
        probability: that it is not as the states have it.
    """

    membership: Ints
    differs_kg: Floats
    scatter_kg: float
    probability: float


@dataclass(frozen=True)
class LoadStates:
    """The load state of each manoeuvre.

    Attributes:
        unit: (units,) numbers of the manoeuvres, as the samples have them, ascending.
        membership: (units,) the load state of each, from 0 on in time.
        level_kg: (units,) mass that each says, the nuisances taken off.
        std_kg: (units,) its deviation by the manoeuvre alone.
        scatter_kg: standard deviation of manoeuvres about their state.
        freedom: degrees of freedom that tell it; infinite where the machine file does.
        birge_ratio: deviation from manoeuvre to manoeuvre over that of each alone; NaN where there
            is nothing to compare.
        single_probability: how probable it is that there is one state.
        other: the other reading, where the log cannot tell; else None.
        load_returns: whether a load is there again after another: an empty machine, say.
        log_odds: of these states over a single one, as a logarithm.
    """

    unit: Ints
    membership: Ints
    level_kg: Floats
    std_kg: Floats
    scatter_kg: float
    freedom: float
    birge_ratio: float
    single_probability: float = 1.0
    other: AlternativePartition | None = None
    load_returns: bool = False
    log_odds: float = 0.0

    @property
    def count(self) -> int:
        """How many states there are."""
        return int(self.membership.max()) + 1

    @property
    def means_kg(self) -> Floats:
        """(states,) the mass of each by its manoeuvres."""
        weight = 1.0 / (self.std_kg**2 + self.scatter_kg**2)
        return means_by_state(self.level_kg, weight, self.membership)

    @property
    def misfit(self) -> float:
        """How far manoeuvres are from their states, and how many these are (Schwarz 1978)."""
        variance = self.scatter_kg**2 + float(np.median(self.std_kg**2))
        return self.membership.size * float(np.log(variance)) + self.count * float(
            np.log(self.membership.size)
        )

    @property
    def scatters(self) -> bool:
        """Whether manoeuvres disagree by more than chance lets them."""
        if not 0 < self.freedom < np.inf:
            return self.scatter_kg > float(np.median(self.std_kg))
        return self.birge_ratio**2 > 1.0 + LIMITS.excess_scatter_std * float(
            np.sqrt(2.0 / self.freedom)
        )

    @property
    def scatter_known(self) -> bool:
        """Whether the scatter is more than a guess."""
        return self.freedom >= FEWEST_FREEDOM

    def among(self, motion: MotionSamples) -> "LoadStates":
        """The same of a motion that may have fewer manoeuvres, or others: states are renumbered."""
        unit = np.unique(unit_of_each_stretch(motion))
        place = np.searchsorted(self.unit, unit, "right") - 1
        place = place.clip(0, self.unit.size - 1)
        return replace(
            self,
            unit=unit,
            membership=np.unique(self.membership[place], return_inverse=True)[1],
            level_kg=self.level_kg[place],
            std_kg=self.std_kg[place],
            other=self.other
            and replace(
                self.other,
                membership=self.other.membership[place],
                differs_kg=self.other.differs_kg[place],
            ),
        )

    def alternative_std_kg(self, weights: Floats) -> float:
        """What the doubt of the states does to a sum of their masses, in kg.

        The mass of a manoeuvre drawn from each state has the variance between the two readings.

        Args:
            weights: (states,) of each mass in the sum.
        """
        if self.other is None:
            return 0.0
        count = np.bincount(self.membership)
        mean_kg = np.bincount(self.membership, weights=self.other.differs_kg) / count
        within = np.bincount(
            self.membership, weights=(self.other.differs_kg - mean_kg[self.membership]) ** 2
        )
        variance = float(weights @ mean_kg) ** 2 + float(weights**2 @ (within / count))
        return float(np.sqrt(self.other.probability * variance))

    def levels(self, motion: MotionSamples) -> RandomIntercepts:
        """The states of the stretches of the motion whose manoeuvres these are."""
        number = np.searchsorted(self.unit, unit_of_each_stretch(motion))
        scatter_kg = self.scatter_kg if self.freedom > 0 else 0.0
        return RandomIntercepts(self.membership[number], number, scatter_kg, self.freedom)


def unit_of_each_stretch(motion: MotionSamples) -> Ints:
    """The manoeuvre of each stretch, (stretches,).

    One that is too short to tell a mass, or that hardly changes its speed, goes with the one before
    it, or with the one after it where something tells that the load changed before and not after.
    """
    unit = motion.unit[first_of_stretch(motion.group)]
    number, of = np.unique(unit, return_inverse=True)
    samples = np.bincount(of, weights=np.bincount(motion.group[motion.used]))
    tells = samples >= min(
        rows_in_duration(
            LIMITS.informative_manoeuvre_s, motion.rate_hz, LIMITS.informative_manoeuvre_samples
        ),
        samples.max(),
    )
    # where a record begins or ends while the machine cruises, a mass would be any
    gained_m_s = _gained_speeds_m_s(motion, of, number.size)
    tells &= gained_m_s >= LIMITS.informative_speed_share * float(np.median(gained_m_s[tells]))
    place = np.arange(number.size)
    before = np.maximum.accumulate(np.where(tells, place, -1))
    after = np.minimum.accumulate(np.where(tells, place, number.size)[::-1])[::-1]
    goes = np.where(before < 0, np.argmax(tells), before)
    group = motion.group
    first, last = (np.flatnonzero(each(group)) for each in (first_of_stretch, last_of_stretch))
    for short in np.flatnonzero(~tells & (before >= 0) & (after < number.size)):
        left, here, right = (of == each for each in (before[short], short, after[short]))
        begin, end = first[here][0], last[here][-1]
        sooner, later = (last[left][-1], begin), (end, first[right][0])
        if _change_kind(motion, *sooner, *sooner) > 1 and _change_kind(motion, *later, *later) == 1:
            goes[short] = after[short]
    return number[goes][of]


def _gained_speeds_m_s(motion: MotionSamples, unit: Ints, units: int) -> Floats:
    """How far apart the speeds of each manoeuvre are, (units,).

    Args:
        motion: the samples.
        unit: (stretches,) the manoeuvre of each, from 0.
        units: how many there are.
    """
    used = np.flatnonzero(motion.used)
    of, speed = unit[motion.group[used]], motion.speed[used]
    least, most = np.full(units, np.inf), np.full(units, -np.inf)
    np.minimum.at(least, of, speed)
    np.maximum.at(most, of, speed)
    return most - least


def unit_of_each_sample(motion: MotionSamples) -> Ints:
    """The manoeuvre of each fitted sample, (used samples,)."""
    return unit_of_each_stretch(motion)[motion.group[motion.used]]


def places(motion: MotionSamples) -> Ints:
    """What tells a change of load between one manoeuvre and the next, (units - 1,).

    Returns:
        0 where the machine drove on or is named as empty, 1 where only the masses can, `TURNED`
        where it went from forwards to reverse, `RESTARTED` where the log was silent as between two
        files, `HINTED` where the boom or the bucket moved as well, `FILLED` where the machine dug,
        `NAMED` where the time begins or ends in which it is named as empty.
    """
    used = np.flatnonzero(motion.used)
    first = np.flatnonzero(np.append(True, np.diff(unit_of_each_sample(motion)) > 0))
    last = np.append(first[1:], used.size) - 1
    # a boom may go up before the machine stands, and come down when it moves again
    middle = used[(first + last) // 2]
    spans = zip(used[last[:-1]], used[first[1:]], middle[:-1], middle[1:], strict=True)
    kind = np.array([_change_kind(motion, *span) for span in spans], np.int64)
    # a bucket is in front: it is filled and emptied where the machine arrives, and then backs out
    arrives, leaves = motion.direction[used[last[:-1]]], motion.direction[used[first[1:]]]
    backs_out = (kind == 1) & (arrives > 0.0) & (leaves < 0.0)
    seen = np.isin(kind, (HINTED, FILLED)).any()
    return np.where(backs_out & ~seen, TURNED, kind)


def _change_kind(motion: MotionSamples, end: int, begin: int, since: int, until: int) -> int:
    """What tells a change of load between two manoeuvres.

    Args:
        motion: arms and digging.
        end: last sample of the first manoeuvre.
        begin: first sample of the second one.
        since: from where on the boom is looked at.
        until: likewise.
    """
    if motion.digs is not None and motion.digs[end : begin + 1].any():
        return FILLED
    if motion.empty is not None and motion.empty[end] != motion.empty[begin]:
        return NAMED
    if motion.empty is not None and motion.empty[end]:
        return 0
    if motion.stood is not None and motion.stood[end] == motion.stood[begin]:
        return 0
    moved = any(_range(arm[since : until + 1]) > LIMITS.arm_movement_rad for arm in motion.arms)
    if moved:
        return HINTED
    silent = motion.silences is not None and motion.silences[end] != motion.silences[begin]
    return RESTARTED if silent else 1


def _range(x: Floats) -> float:
    """From the least to the largest that is known, 0 where nothing is."""
    known = x[np.isfinite(x)]
    return float(np.ptp(known)) if known.size else 0.0


def find_states(units: GroupEffects, number: Ints, repeatability_kg: float | None) -> LoadStates:
    """Find the states.

    Args:
        units: what each manoeuvre says.
        number: (units,) of the manoeuvres.
        repeatability_kg: how manoeuvres of one load scatter, where the machine file knows.
    """
    if not (np.isfinite(units.y).all() and (units.variance > 0.0).all()):
        return single_unknown_state(number)
    typical_kg = _typical_mass_kg(units)
    found = partitions(
        units,
        LIMITS.largest_load_fraction * typical_kg,
        LIMITS.repeatability_fraction * typical_kg,
        repeatability_kg,
    )
    best = found.best if _is_partition_credible(found, repeatability_kg) else found.single
    other = found.several if best.states == 1 else found.single
    states = _states_of_partition(units, number, best)
    if repeatability_kg is not None:
        states = replace(states, scatter_kg=repeatability_kg, freedom=np.inf)
    probability = found.single_probability if best.states > 1 else 1.0 - found.single_probability
    return replace(
        states,
        single_probability=found.single_probability,
        other=_alternative_partition(units, best, other, probability),
        log_odds=best.log_posterior - found.single.log_posterior,
    )


def states_of(
    units: GroupEffects, number: Ints, membership: Ints, *, usual_scatter: bool = True
) -> LoadStates:
    """The states of a partition that is given.

    Args:
        units: what each manoeuvre says.
        number: (units,) of the manoeuvres.
        membership: (units,) the load state of each, from 0 on in time.
        usual_scatter: whether manoeuvres scatter about them as they usually do, since the units are
            of other loads: what they scatter by is then what these differ by.
    """
    typical_kg = _typical_mass_kg(units)
    posterior = PartitionPosterior(units, LIMITS.largest_load_fraction * typical_kg, 0.0, None)
    partition = posterior.evaluate(Stretches.from_boundaries(membership, units.kind))
    states = _states_of_partition(units, number, partition)
    if not usual_scatter:
        return states
    return replace(states, scatter_kg=LIMITS.repeatability_fraction * typical_kg, freedom=np.inf)


def _states_of_partition(units: GroupEffects, number: Ints, best: Partition) -> LoadStates:
    level_kg = units.y - units.x @ best.effects
    return LoadStates(
        number,
        best.state,
        level_kg,
        np.sqrt(units.variance),
        *_between_manoeuvre_scatter(level_kg, units.variance, best),
        load_returns=np.unique(best.level).size < best.states
        or _count_reversals(best) >= LIMITS.load_return_reversals,
    )


def _typical_mass_kg(units: GroupEffects) -> float:
    """The scale of loads; of manoeuvres of no mass what their own noise lets them say."""
    return float(max(np.median(np.abs(units.y)), np.median(np.sqrt(units.variance))))


def _count_reversals(found: Partition) -> int:
    """How often a load that was put on is taken off, or the other way round."""
    rises = np.sign(np.diff(found.levels))
    return int(np.count_nonzero(np.diff(rises[rises != 0.0])))


def _alternative_partition(
    units: GroupEffects, best: Partition, other: Partition | None, probability: float
) -> AlternativePartition | None:
    """What the units may as well say; None where the log can tell."""
    doubted = (
        LIMITS.several_loads_min_probability
        if best.states == 1
        else LIMITS.single_load_min_probability
    )
    if other is None or probability < doubted:
        return None
    level_kg = units.y - units.x @ other.effects
    scatter_kg, _, _ = _between_manoeuvre_scatter(level_kg, units.variance, other)
    differs_kg = other.levels[other.state] - best.levels[best.state]
    return AlternativePartition(other.state, differs_kg, scatter_kg, probability)


def single_unknown_state(number: Ints) -> LoadStates:
    """One state of these manoeuvres, of which nothing is known."""
    one, nothing = np.zeros(number.size, np.int64), np.full(number.size, np.nan)
    return LoadStates(number, one, nothing, nothing, 0.0, 0.0, float("nan"))


def _is_partition_credible(found: Partitions, repeatability_kg: float | None) -> bool:
    """Whether the most probable partition is taken, or one state where nothing can tell."""
    few = found.best.freedom < FEWEST_FREEDOM
    doubted = found.single_probability > LIMITS.single_load_min_probability
    return repeatability_kg is not None or not (few and doubted)


def means_by_state(level: Floats, weight: Floats, state: Ints) -> Floats:
    """Weighted means by state, (states,).

    Args:
        level: (units,) what each says.
        weight: (units,) of each.
        state: (units,) from 0.
    """
    return np.bincount(state, weights=weight * level) / np.bincount(state, weights=weight)


def _between_manoeuvre_scatter(
    level: Floats, variance: Floats, found: Partition
) -> tuple[float, float, float]:
    """Scatter about the levels (Paule & Mandel 1982), its degrees of freedom, Birge's ratio."""
    freedom, state = found.freedom, found.level[found.state]
    if freedom < 1:
        return 0.0, 0.0, float("nan")

    def excess(tau: float) -> float:
        weight = 1.0 / (variance + tau**2)
        mean = means_by_state(level, weight, state)
        return float(weight @ (level - mean[state]) ** 2) / freedom

    if (ratio := float(np.sqrt(excess(0.0)))) <= 1.0:
        return 0.0, float(freedom), ratio
    low, high = 0.0, float(np.ptp(level)) + 1e-9
    for _ in range(_ROUNDS):
        middle = (low + high) / 2.0
        low, high = (middle, high) if excess(middle) > 1.0 else (low, middle)
    return high, float(freedom), ratio
