"""Load states: which manoeuvres carry the same load, and how their masses scatter.

A manoeuvre's mass is its own estimate, corrected for the nuisances that all manoeuvres share.
A load changes between manoeuvres, where the machine stood still.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from analysis.weighing.load_changes import find_manoeuvre_of_stretches
from analysis.weighing.load_limits import LIMITS
from analysis.weighing.motion_samples import Floats, Ints, MotionSamples
from estimators.joint.changepoints import Partitions, find_best_partitions
from estimators.joint.partition_posterior import Partition, PartitionPosterior, Stretches
from estimators.joint.random_intercepts import RandomIntercepts
from estimators.joint.unit_levels import BY_IMPLEMENT, UnitLevels


@dataclass(frozen=True)
class AlternativePartition:
    """The second most probable partition into loads, if the log does not exclude it.

    Attributes:
        state_of_manoeuvre: (manoeuvres,) load state of each manoeuvre.
        mass_difference_kg: (manoeuvres,) mass of each manoeuvre's load minus that of the answer.
        scatter_kg: standard deviation of manoeuvres about their state.
        probability: probability that this partition is true instead of the chosen one.
    """

    state_of_manoeuvre: Ints
    mass_difference_kg: Floats
    scatter_kg: float
    probability: float


@dataclass(frozen=True)
class LoadStates:
    """The load state of each manoeuvre.

    Attributes:
        manoeuvre_ids: (manoeuvres,) numbers of the manoeuvres in the samples, ascending.
        state_of_manoeuvre: (manoeuvres,) load state of each manoeuvre, numbered by time.
        manoeuvre_mass_kg: (manoeuvres,) mass of each manoeuvre by itself, corrected for nuisances.
        std_kg: (manoeuvres,) its standard deviation from the manoeuvre alone.
        scatter_kg: standard deviation of manoeuvres about their state.
        degrees_of_freedom: degrees of freedom of the scatter; infinite if it is stated or assumed.
        birge_ratio: scatter between the manoeuvres of a state over that expected from their own
            standard deviations; NaN without two manoeuvres in one state.
        single_probability: probability of a single state.
        alternative_partition: another partition that the log does not exclude; else None.
        load_returns: whether a load recurs after another one, such as the empty machine.
        log_odds: log odds of these states against a single one.
        assumes_scatter: whether the usual scatter is assumed, since the load changes are small and
            only the masses show them.
    """

    manoeuvre_ids: Ints
    state_of_manoeuvre: Ints
    manoeuvre_mass_kg: Floats
    std_kg: Floats
    scatter_kg: float
    degrees_of_freedom: float
    birge_ratio: float
    single_probability: float = 1.0
    alternative_partition: AlternativePartition | None = None
    load_returns: bool = False
    log_odds: float = 0.0
    assumes_scatter: bool = False

    @property
    def state_count(self) -> int:
        """Number of states."""
        return int(self.state_of_manoeuvre.max()) + 1

    @property
    def means_kg(self) -> Floats:
        """(states,) mean mass of each state's manoeuvres, in kg."""
        weight = 1.0 / (self.std_kg**2 + self.scatter_kg**2)
        return compute_weighted_mean_mass_by_state_kg(
            self.manoeuvre_mass_kg, weight, self.state_of_manoeuvre
        )

    @property
    def bayesian_information_criterion(self) -> float:
        """Bayesian information criterion of the states (Schwarz 1978)."""
        variance = self.scatter_kg**2 + float(np.median(self.std_kg**2))
        return self.state_of_manoeuvre.size * float(np.log(variance)) + self.state_count * float(
            np.log(self.state_of_manoeuvre.size)
        )

    @property
    def has_excess_scatter(self) -> bool:
        """Whether manoeuvres disagree by more than chance explains."""
        if not 0 < self.degrees_of_freedom < np.inf:
            return self.scatter_kg > float(np.median(self.std_kg))
        return self.birge_ratio**2 > 1.0 + LIMITS.excess_scatter_std * float(
            np.sqrt(2.0 / self.degrees_of_freedom)
        )

    @property
    def is_scatter_estimated(self) -> bool:
        """Whether the scatter is an estimate with enough degrees of freedom, not an assumption."""
        return (
            self.degrees_of_freedom >= LIMITS.scatter_min_degrees_of_freedom
            and not self.assumes_scatter
        )

    def copy_with_stated_scatter(self, repeatability_kg: float) -> "LoadStates":
        """The same states with the scatter of manoeuvres that the machine file states."""
        return replace(
            self, scatter_kg=repeatability_kg, degrees_of_freedom=np.inf, assumes_scatter=False
        )

    def reassign_to_manoeuvres_of_motion(self, motion: MotionSamples) -> "LoadStates":
        """Assign these states to the manoeuvres of another motion, and renumber them."""
        new_ids = np.unique(find_manoeuvre_of_stretches(motion))
        place = np.searchsorted(self.manoeuvre_ids, new_ids, "right") - 1
        place = place.clip(0, self.manoeuvre_ids.size - 1)
        return replace(
            self,
            manoeuvre_ids=new_ids,
            state_of_manoeuvre=np.unique(self.state_of_manoeuvre[place], return_inverse=True)[1],
            manoeuvre_mass_kg=self.manoeuvre_mass_kg[place],
            std_kg=self.std_kg[place],
            alternative_partition=self.alternative_partition
            and replace(
                self.alternative_partition,
                state_of_manoeuvre=self.alternative_partition.state_of_manoeuvre[place],
                mass_difference_kg=self.alternative_partition.mass_difference_kg[place],
            ),
        )

    def compute_mass_sum_std_by_alternative_partition_kg(self, coefficients: Floats) -> float:
        """Standard deviation of a sum of masses due to the alternative partition, in kg.

        The variance is that of the difference between the partitions, for one manoeuvre drawn from
        each state.

        Args:
            coefficients: (states,) weight of each mass.
        """
        if self.alternative_partition is None:
            return 0.0
        count = np.bincount(self.state_of_manoeuvre)
        mean_kg = (
            np.bincount(
                self.state_of_manoeuvre, weights=self.alternative_partition.mass_difference_kg
            )
            / count
        )
        within = np.bincount(
            self.state_of_manoeuvre,
            weights=(
                self.alternative_partition.mass_difference_kg - mean_kg[self.state_of_manoeuvre]
            )
            ** 2,
        )
        variance = float(coefficients @ mean_kg) ** 2 + float(coefficients**2 @ (within / count))
        return float(np.sqrt(self.alternative_partition.probability * variance))

    def assign_random_intercepts_to_stretches(self, motion: MotionSamples) -> RandomIntercepts:
        """Random intercepts of the motion's stretches: load state and manoeuvre of each."""
        number = np.searchsorted(self.manoeuvre_ids, find_manoeuvre_of_stretches(motion))
        scatter_kg = self.scatter_kg if self.degrees_of_freedom > 0 else 0.0
        return RandomIntercepts(
            self.state_of_manoeuvre[number], number, scatter_kg, self.degrees_of_freedom
        )


def find_load_states(
    masses: UnitLevels, manoeuvre_ids: Ints, repeatability_kg: float | None
) -> LoadStates:
    """Find the most probable load states.

    Args:
        masses: mass estimate of each manoeuvre.
        manoeuvre_ids: (manoeuvres,) number of each manoeuvre in the log.
        repeatability_kg: scatter of manoeuvres of one load, if the machine file states it.
    """
    if not (np.isfinite(masses.y).all() and (masses.variance > 0.0).all()):
        return make_single_unknown_state(manoeuvre_ids)
    typical_kg = compute_median_manoeuvre_mass_kg(masses)
    found = find_best_partitions(
        masses,
        LIMITS.largest_load_fraction * typical_kg,
        LIMITS.repeatability_fraction * typical_kg,
        repeatability_kg,
    )
    best = (
        found.best if _is_load_state_partition_credible(found, repeatability_kg) else found.single
    )
    is_single = best.stretch_count == 1
    other = found.several if is_single else found.single
    states = _make_load_states(masses, manoeuvre_ids, best)
    if repeatability_kg is not None:
        states = states.copy_with_stated_scatter(repeatability_kg)
    # recurrent places make loads more probable, and are not needed to exclude a single load
    single_probability = (
        found.single_probability_by_place if is_single else found.single_probability
    )
    other_probability = 1.0 - single_probability if is_single else single_probability
    return replace(
        states,
        single_probability=single_probability,
        alternative_partition=find_alternative_partition(masses, best, other, other_probability),
        log_odds=best.log_posterior - found.single.log_posterior,
    )


def make_states_of_partition(
    masses: UnitLevels,
    manoeuvre_ids: Ints,
    state_of_manoeuvre: Ints,
    *,
    usual_scatter: bool = True,
) -> LoadStates:
    """Load states of a given partition.

    Args:
        masses: mass estimate of each manoeuvre.
        manoeuvre_ids: (manoeuvres,) number of each manoeuvre in the log.
        state_of_manoeuvre: (manoeuvres,) load state of each manoeuvre, numbered by time.
        usual_scatter: whether to assume the usual scatter, since `masses` were fitted for other
            loads; otherwise the scatter is estimated.
    """
    typical_kg = compute_median_manoeuvre_mass_kg(masses)
    posterior = PartitionPosterior(masses, LIMITS.largest_load_fraction * typical_kg, 0.0, None)
    partition = posterior.fit_partition(Stretches.from_boundaries(state_of_manoeuvre, masses))
    states = _make_load_states(masses, manoeuvre_ids, partition)
    if not usual_scatter:
        return states
    return replace(
        states, scatter_kg=LIMITS.repeatability_fraction * typical_kg, degrees_of_freedom=np.inf
    )


def _make_load_states(masses: UnitLevels, manoeuvre_ids: Ints, best: Partition) -> LoadStates:
    level_kg = masses.y - masses.x @ best.effects
    scatter = estimate_or_assume_mass_scatter_about_states(
        level_kg, masses.variance, best, masses.kind
    )
    return LoadStates(
        manoeuvre_ids,
        best.state,
        level_kg,
        np.sqrt(masses.variance),
        scatter.scatter_kg,
        scatter.degrees_of_freedom,
        scatter.birge_ratio,
        load_returns=np.unique(best.level).size < best.stretch_count
        or _count_load_reversals(best) >= LIMITS.load_return_reversals,
        assumes_scatter=scatter.is_assumed,
    )


def compute_median_manoeuvre_mass_kg(masses: UnitLevels) -> float:
    """Median mass of the manoeuvres in kg, but at least the median of their noise."""
    return float(max(np.median(np.abs(masses.y)), np.median(np.sqrt(masses.variance))))


def _count_load_reversals(states: Partition) -> int:
    """Number of times that an increase of the load is followed by a decrease, or vice versa."""
    rises = np.sign(np.diff(states.levels))
    return int(np.count_nonzero(np.diff(rises[rises != 0.0])))


def find_alternative_partition(
    masses: UnitLevels, best: Partition, other: Partition | None, other_probability: float
) -> AlternativePartition | None:
    """Make the alternative partition from `other`; None if it is too improbable."""
    doubted = LIMITS.single_load_min_probability
    if best.stretch_count == 1:
        doubted = LIMITS.several_loads_min_probability
    if other is None or other_probability < doubted:
        return None
    level_kg = masses.y - masses.x @ other.effects
    scatter_kg = estimate_or_assume_mass_scatter_about_states(
        level_kg, masses.variance, other, masses.kind
    ).scatter_kg
    differs_kg = other.levels[other.state] - best.levels[best.state]
    return AlternativePartition(other.state, differs_kg, scatter_kg, other_probability)


def make_single_unknown_state(manoeuvre_ids: Ints) -> LoadStates:
    """One load state with all of these manoeuvres, whose mass is unknown."""
    one, nothing = np.zeros(manoeuvre_ids.size, np.int64), np.full(manoeuvre_ids.size, np.nan)
    return LoadStates(manoeuvre_ids, one, nothing, nothing, 0.0, 0.0, float("nan"))


def _is_load_state_partition_credible(
    posterior: Partitions, repeatability_kg: float | None
) -> bool:
    """Whether to accept the most probable partition rather than a single state."""
    few = posterior.best.degrees_of_freedom < LIMITS.scatter_min_degrees_of_freedom
    doubted = posterior.single_probability > LIMITS.single_load_min_probability
    return repeatability_kg is not None or not (few and doubted)


def compute_weighted_mean_mass_by_state_kg(
    mass_kg: Floats, statistical_weight: Floats, state_of_manoeuvre: Ints
) -> Floats:
    """Weighted means by state, (states,).

    Args:
        mass_kg: (manoeuvres,) mass of each manoeuvre.
        statistical_weight: (manoeuvres,) weight of each manoeuvre.
        state_of_manoeuvre: (manoeuvres,) state of each manoeuvre, from 0.
    """
    return np.bincount(state_of_manoeuvre, weights=statistical_weight * mass_kg) / np.bincount(
        state_of_manoeuvre, weights=statistical_weight
    )


class ScatterAboutStates(NamedTuple):
    """Scatter of masses about their states; see the attributes of `LoadStates`."""

    scatter_kg: float
    degrees_of_freedom: float
    birge_ratio: float
    is_assumed: bool = False


def estimate_or_assume_mass_scatter_about_states(
    mass_kg: Floats, variance: Floats, partition: Partition, change_kinds: Ints
) -> ScatterAboutStates:
    """Scatter about the states, estimated or assumed.

    Small changes to new loads that only the masses show were chosen to minimise the scatter.
    Therefore each of them takes a degree of freedom, and if too few are left, the usual scatter is
    assumed if it is larger.
    """
    begins = np.flatnonzero(np.diff(partition.state)) + 1
    usual_kg = LIMITS.repeatability_fraction * float(np.median(np.abs(mass_kg)))
    is_small = np.abs(np.diff(partition.levels)) < LIMITS.small_change_repeatabilities * usual_kg
    # a load that recurs is not new, and digging, boom or bucket are other evidence of a change
    is_new = np.isin(np.arange(begins.size + 1), np.unique(partition.level, return_index=True)[1])
    by_masses = ~np.isin(change_kinds, BY_IMPLEMENT).any() & (change_kinds[begins - 1] == 1)
    small_changes = int(np.count_nonzero(is_small & is_new[1:] & by_masses))
    degrees_of_freedom = partition.degrees_of_freedom - small_changes
    if not small_changes or degrees_of_freedom >= LIMITS.scatter_min_degrees_of_freedom:
        return estimate_scatter_and_birge_ratio(mass_kg, variance, partition, degrees_of_freedom)
    found = estimate_scatter_and_birge_ratio(
        mass_kg, variance, partition, partition.degrees_of_freedom
    )
    if found.scatter_kg > usual_kg:
        return found._replace(degrees_of_freedom=float(max(degrees_of_freedom, 1)))
    return ScatterAboutStates(usual_kg, np.inf, found.birge_ratio, is_assumed=True)


def estimate_scatter_and_birge_ratio(
    mass_kg: Floats, variance: Floats, partition: Partition, degrees_of_freedom: int
) -> ScatterAboutStates:
    """Scatter about the states (Paule & Mandel 1982), degrees of freedom and Birge ratio."""
    state = partition.level[partition.state]
    if degrees_of_freedom < 1:
        return ScatterAboutStates(0.0, 0.0, float("nan"))

    def compute_reduced_chi_square(tau: float) -> float:
        weight = 1.0 / (variance + tau**2)
        mean = compute_weighted_mean_mass_by_state_kg(mass_kg, weight, state)
        return float(weight @ (mass_kg - mean[state]) ** 2) / degrees_of_freedom

    if (ratio := float(np.sqrt(compute_reduced_chi_square(0.0)))) <= 1.0:
        return ScatterAboutStates(0.0, float(degrees_of_freedom), ratio)
    low, high = 0.0, float(np.ptp(mass_kg)) + 1e-9
    for _ in range(LIMITS.scatter_rounds):
        middle = (low + high) / 2.0
        low, high = (middle, high) if compute_reduced_chi_square(middle) > 1.0 else (low, middle)
    return ScatterAboutStates(high, float(degrees_of_freedom), ratio)
