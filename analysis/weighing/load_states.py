"""Load states: which manoeuvres carry the same load, and how their masses scatter.

A manoeuvre's mass is what it says once the nuisances that all manoeuvres share are taken off.
A load changes between manoeuvres, where the machine stood.
"""

from dataclasses import dataclass, replace

import numpy as np

from analysis.stages.signals.grid_rate import count_rows_in_duration
from analysis.weighing.fitted_stretches import mark_stretch_ends, mark_stretch_starts, memoise
from analysis.weighing.load_limits import LIMITS
from analysis.weighing.motion_samples import Floats, Ints, MotionSamples
from estimators.joint.changepoints import Partitions, find_best_partitions
from estimators.joint.group_effects import FILLED, HINTED, NAMED, RESTARTED, TURNED, GroupEffects
from estimators.joint.partition_posterior import Partition, PartitionPosterior, Stretches
from estimators.joint.random_intercepts import RandomIntercepts


@dataclass(frozen=True)
class AlternativePartition:
    """The next likely partition into loads, if the log does not exclude it.

    Attributes:
        membership: (units,) load state of each manoeuvre.
        differs_kg: (units,) difference of each manoeuvre's mass.
        scatter_kg: standard deviation of manoeuvres about their state.
        probability: probability that the chosen states are wrong.
    """

    membership: Ints
    differs_kg: Floats
    scatter_kg: float
    probability: float


@dataclass(frozen=True)
class LoadStates:
    """The load state of each manoeuvre.

    Attributes:
        unit: (units,) numbers of the manoeuvres in the samples, ascending.
        membership: (units,) load state of each manoeuvre, numbered by time.
        level_kg: (units,) mass of each manoeuvre by itself, without the nuisances.
        std_kg: (units,) its standard deviation from the manoeuvre alone.
        scatter_kg: standard deviation of manoeuvres about their state.
        freedom: degrees of freedom of the scatter; infinite if the machine file states it.
        birge_ratio: deviation between manoeuvres over that within each; NaN if there is nothing to
            compare.
        single_probability: probability of a single state.
        other: the alternative partition, if the log cannot decide; else None.
        load_returns: whether a load recurs after another one, such as the empty machine.
        log_odds: log odds of these states against a single one.
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
    def state_count(self) -> int:
        """Number of states."""
        return int(self.membership.max()) + 1

    @property
    def means_kg(self) -> Floats:
        """(states,) mean mass of each state's manoeuvres, in kg."""
        weight = 1.0 / (self.std_kg**2 + self.scatter_kg**2)
        return weighted_means_by_state(self.level_kg, weight, self.membership)

    @property
    def bayesian_information_criterion(self) -> float:
        """Bayesian information criterion of the states (Schwarz 1978)."""
        variance = self.scatter_kg**2 + float(np.median(self.std_kg**2))
        return self.membership.size * float(np.log(variance)) + self.state_count * float(
            np.log(self.membership.size)
        )

    @property
    def has_excess_scatter(self) -> bool:
        """Whether manoeuvres disagree by more than chance explains."""
        if not 0 < self.freedom < np.inf:
            return self.scatter_kg > float(np.median(self.std_kg))
        return self.birge_ratio**2 > 1.0 + LIMITS.excess_scatter_std * float(
            np.sqrt(2.0 / self.freedom)
        )

    @property
    def is_scatter_estimated(self) -> bool:
        """Whether the scatter is estimated rather than assumed."""
        return self.freedom >= LIMITS.scatter_min_freedom

    def renumber_for_motion(self, motion: MotionSamples) -> "LoadStates":
        """These states for a motion with other manoeuvres, numbered again."""
        unit = np.unique(find_manoeuvre_of_stretches(motion))
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

    def alternative_partition_std_kg(self, coefficients: Floats) -> float:
        """Standard deviation of a sum of masses due to the alternative partition, in kg.

        A manoeuvre drawn from each state has the variance between the two partitions.

        Args:
            coefficients: (states,) weight of each mass.
        """
        if self.other is None:
            return 0.0
        count = np.bincount(self.membership)
        mean_kg = np.bincount(self.membership, weights=self.other.differs_kg) / count
        within = np.bincount(
            self.membership, weights=(self.other.differs_kg - mean_kg[self.membership]) ** 2
        )
        variance = float(coefficients @ mean_kg) ** 2 + float(coefficients**2 @ (within / count))
        return float(np.sqrt(self.other.probability * variance))

    def make_random_intercepts(self, motion: MotionSamples) -> RandomIntercepts:
        """States of the motion's stretches, as random intercepts."""
        number = np.searchsorted(self.unit, find_manoeuvre_of_stretches(motion))
        scatter_kg = self.scatter_kg if self.freedom > 0 else 0.0
        return RandomIntercepts(self.membership[number], number, scatter_kg, self.freedom)


@memoise
def find_manoeuvre_of_stretches(motion: MotionSamples) -> Ints:
    """Manoeuvre of each stretch, (stretches,).

    A stretch too short or too steady to determine a mass joins the manoeuvre before it, or the one
    after it if only that border has no sign of a load change.
    """
    unit = motion.unit[mark_stretch_starts(motion.group)]
    number, of = np.unique(unit, return_inverse=True)
    samples = np.bincount(of, weights=np.bincount(motion.group[motion.is_fittable]))
    tells = samples >= min(
        count_rows_in_duration(
            LIMITS.informative_manoeuvre_s, motion.rate_hz, LIMITS.informative_manoeuvre_samples
        ),
        samples.max(),
    )
    # where a record begins or ends while the machine cruises, a mass would be any
    gained_m_s = find_speed_ranges_m_s(motion, of, number.size)
    tells &= gained_m_s >= LIMITS.informative_speed_share * float(np.median(gained_m_s[tells]))
    place = np.arange(number.size)
    before = np.maximum.accumulate(np.where(tells, place, -1))
    after = np.minimum.accumulate(np.where(tells, place, number.size)[::-1])[::-1]
    goes = np.where(before < 0, np.argmax(tells), before)
    group = motion.group
    first, last = (np.flatnonzero(f(group)) for f in (mark_stretch_starts, mark_stretch_ends))
    for short in np.flatnonzero(~tells & (before >= 0) & (after < number.size)):
        left, here, right = (of == each for each in (before[short], short, after[short]))
        begin, end = first[here][0], last[here][-1]
        sooner, later = (last[left][-1], begin), (end, first[right][0])
        at_begin, at_end = (classify_load_change(motion, *span, *span) for span in (sooner, later))
        if at_begin > 1 and at_end == 1:
            goes[short] = after[short]
    return number[goes][of]


def find_speed_ranges_m_s(motion: MotionSamples, manoeuvre_of_stretch: Ints, count: int) -> Floats:
    """Range of the speeds of each manoeuvre, (units,) in m/s.

    Args:
        motion: the samples.
        manoeuvre_of_stretch: (stretches,) manoeuvre of each, from 0.
        count: number of manoeuvres.
    """
    used = np.flatnonzero(motion.is_fittable)
    of, speed = manoeuvre_of_stretch[motion.group[used]], motion.speed[used]
    least, most = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(least, of, speed)
    np.maximum.at(most, of, speed)
    return most - least


def find_manoeuvre_of_fitted_samples(motion: MotionSamples) -> Ints:
    """Manoeuvre of each fitted sample, (used samples,)."""
    return find_manoeuvre_of_stretches(motion)[motion.group[motion.is_fittable]]


def classify_load_change_evidence(motion: MotionSamples) -> Ints:
    """Kind of evidence for a load change between successive manoeuvres, (units - 1,).

    Returns:
        0 if the machine drove on, is named empty or is known to carry one load, 1 if only the
        masses can tell, `TURNED` at a change of direction, `RESTARTED` after a gap as between
        files, `HINTED` if boom or bucket moved, `FILLED` if the machine dug, `NAMED` at a border of
        the times named empty.
    """
    used = np.flatnonzero(motion.is_fittable)
    first = np.flatnonzero(np.append(True, np.diff(find_manoeuvre_of_fitted_samples(motion)) > 0))
    last = np.append(first[1:], used.size) - 1
    # a boom may go up before the machine stands, and come down when it moves again
    middle = used[(first + last) // 2]
    spans = zip(used[last[:-1]], used[first[1:]], middle[:-1], middle[1:], strict=True)
    kind = np.array([classify_load_change(motion, *span) for span in spans], np.int64)
    # a bucket is in front: it is filled and emptied where the machine arrives, and then backs out
    arrives, leaves = motion.direction[used[last[:-1]]], motion.direction[used[first[1:]]]
    backs_out = (kind == 1) & (arrives > 0.0) & (leaves < 0.0)
    seen = np.isin(kind, (HINTED, FILLED)).any()
    kind = np.where(backs_out & ~seen, TURNED, kind)
    return np.zeros_like(kind) if motion.has_single_load else kind


def classify_load_change(
    motion: MotionSamples, end_row: int, begin_row: int, boom_begin_row: int, boom_end_row: int
) -> int:
    """Kind of evidence for a load change between two manoeuvres.

    Args:
        motion: samples, with arm angles and digging.
        end_row: last sample of the first manoeuvre.
        begin_row: first sample of the second one.
        boom_begin_row: first sample of the boom to examine.
        boom_end_row: end sample of the boom to examine.
    """
    if motion.digs is not None and motion.digs[end_row : begin_row + 1].any():
        return FILLED
    if motion.empty is not None and motion.empty[end_row] != motion.empty[begin_row]:
        return NAMED
    if motion.empty is not None and motion.empty[end_row]:
        return 0
    if motion.stood is not None and motion.stood[end_row] == motion.stood[begin_row]:
        return 0
    moved = any(
        _range_without_nan(arm[boom_begin_row : boom_end_row + 1]) > LIMITS.arm_movement_rad
        for arm in motion.arms
    )
    if moved:
        return HINTED
    silent = motion.silences is not None and motion.silences[end_row] != motion.silences[begin_row]
    return RESTARTED if silent else 1


def _range_without_nan(values: Floats) -> float:
    """Maximum minus minimum of the known values; 0 if none is known."""
    known = values[np.isfinite(values)]
    return float(np.ptp(known)) if known.size else 0.0


def find_load_states(
    masses: GroupEffects, manoeuvre_ids: Ints, repeatability_kg: float | None
) -> LoadStates:
    """Find the most probable load states.

    Args:
        masses: mass estimate of each manoeuvre.
        manoeuvre_ids: (units,) number of each manoeuvre in the log.
        repeatability_kg: scatter of manoeuvres of one load, if the machine file states it.
    """
    if not (np.isfinite(masses.y).all() and (masses.variance > 0.0).all()):
        return make_single_unknown_state(manoeuvre_ids)
    typical_kg = median_manoeuvre_mass_kg(masses)
    found = find_best_partitions(
        masses,
        LIMITS.largest_load_fraction * typical_kg,
        LIMITS.repeatability_fraction * typical_kg,
        repeatability_kg,
    )
    best = found.best if _is_partition_credible(found, repeatability_kg) else found.single
    other = found.several if best.level_stretch_count == 1 else found.single
    states = _make_load_states(masses, manoeuvre_ids, best)
    if repeatability_kg is not None:
        states = replace(states, scatter_kg=repeatability_kg, freedom=np.inf)
    probability = (
        found.single_probability if best.level_stretch_count > 1 else 1.0 - found.single_probability
    )
    return replace(
        states,
        single_probability=found.single_probability,
        other=find_alternative_partition(masses, best, other, probability),
        log_odds=best.log_posterior - found.single.log_posterior,
    )


def make_states_of_partition(
    masses: GroupEffects, manoeuvre_ids: Ints, membership: Ints, *, usual_scatter: bool = True
) -> LoadStates:
    """Load states of a given partition.

    Args:
        masses: mass estimate of each manoeuvre.
        manoeuvre_ids: (units,) number of each manoeuvre in the log.
        membership: (units,) load state of each manoeuvre, numbered by time.
        usual_scatter: whether to assume the usual scatter, if `masses` are of other loads.
    """
    typical_kg = median_manoeuvre_mass_kg(masses)
    posterior = PartitionPosterior(masses, LIMITS.largest_load_fraction * typical_kg, 0.0, None)
    partition = posterior.score_partition(Stretches.from_boundaries(membership, masses.kind))
    states = _make_load_states(masses, manoeuvre_ids, partition)
    if not usual_scatter:
        return states
    return replace(states, scatter_kg=LIMITS.repeatability_fraction * typical_kg, freedom=np.inf)


def _make_load_states(masses: GroupEffects, manoeuvre_ids: Ints, best: Partition) -> LoadStates:
    level_kg = masses.y - masses.x @ best.effects
    return LoadStates(
        manoeuvre_ids,
        best.state,
        level_kg,
        np.sqrt(masses.variance),
        *estimate_scatter_dof_and_birge_ratio(level_kg, masses.variance, best),
        load_returns=np.unique(best.level).size < best.level_stretch_count
        or _count_mass_reversals_of_states(best) >= LIMITS.load_return_reversals,
    )


def median_manoeuvre_mass_kg(masses: GroupEffects) -> float:
    """Typical mass in kg; the noise level if no manoeuvre has a mass."""
    return float(max(np.median(np.abs(masses.y)), np.median(np.sqrt(masses.variance))))


def _count_mass_reversals_of_states(states: Partition) -> int:
    """Number of increases followed by a decrease of the load, or vice versa."""
    rises = np.sign(np.diff(states.levels))
    return int(np.count_nonzero(np.diff(rises[rises != 0.0])))


def find_alternative_partition(
    masses: GroupEffects, best: Partition, other: Partition | None, other_probability: float
) -> AlternativePartition | None:
    """The alternative partition that the manoeuvres allow; None if the log determines one."""
    doubted = LIMITS.single_load_min_probability
    if best.level_stretch_count == 1:
        doubted = LIMITS.several_loads_min_probability
    if other is None or other_probability < doubted:
        return None
    level_kg = masses.y - masses.x @ other.effects
    scatter_kg, _, _ = estimate_scatter_dof_and_birge_ratio(level_kg, masses.variance, other)
    differs_kg = other.levels[other.state] - best.levels[best.state]
    return AlternativePartition(other.state, differs_kg, scatter_kg, other_probability)


def make_single_unknown_state(manoeuvre_ids: Ints) -> LoadStates:
    """One state of these manoeuvres, with unknown mass."""
    one, nothing = np.zeros(manoeuvre_ids.size, np.int64), np.full(manoeuvre_ids.size, np.nan)
    return LoadStates(manoeuvre_ids, one, nothing, nothing, 0.0, 0.0, float("nan"))


def _is_partition_credible(posterior: Partitions, repeatability_kg: float | None) -> bool:
    """Whether to accept the most probable partition rather than a single state."""
    few = posterior.best.degrees_of_freedom < LIMITS.scatter_min_freedom
    doubted = posterior.single_probability > LIMITS.single_load_min_probability
    return repeatability_kg is not None or not (few and doubted)


def weighted_means_by_state(mass_kg: Floats, weight: Floats, state: Ints) -> Floats:
    """Weighted means by state, (states,).

    Args:
        mass_kg: (units,) mass of each manoeuvre.
        weight: (units,) weight of each manoeuvre.
        state: (units,) state of each manoeuvre, from 0.
    """
    return np.bincount(state, weights=weight * mass_kg) / np.bincount(state, weights=weight)


def estimate_scatter_dof_and_birge_ratio(
    mass_kg: Floats, variance: Floats, partition: Partition
) -> tuple[float, float, float]:
    """Scatter about the states (Paule & Mandel 1982), degrees of freedom and Birge ratio."""
    freedom, state = partition.degrees_of_freedom, partition.level[partition.state]
    if freedom < 1:
        return 0.0, 0.0, float("nan")

    def reduced_chi_square(tau: float) -> float:
        weight = 1.0 / (variance + tau**2)
        mean = weighted_means_by_state(mass_kg, weight, state)
        return float(weight @ (mass_kg - mean[state]) ** 2) / freedom

    if (ratio := float(np.sqrt(reduced_chi_square(0.0)))) <= 1.0:
        return 0.0, float(freedom), ratio
    low, high = 0.0, float(np.ptp(mass_kg)) + 1e-9
    for _ in range(LIMITS.scatter_rounds):
        middle = (low + high) / 2.0
        low, high = (middle, high) if reduced_chi_square(middle) > 1.0 else (low, middle)
    return high, float(freedom), ratio
