"""Posterior probability of a partition, with levels and shared effects integrated out.

The prior is not tuned: one level is as probable as several; with several levels every rate of
changes is equally probable, and so is every choice of the same number of boundaries (Scott & Berger
2010, Bayes and empirical-Bayes multiplicity adjustment). At the ends of records three cases are
equally probable: one level for all records, mostly one level per record, and any rate of changes.
All levels differ, or two levels alternate, or one level recurs, like that of an empty machine, at
every second stretch or before every filling: these three are equally probable. Levels are normal
about a mean of their own, with a spread that the series determines, up to `spread` (Gelman 2006,
Prior distributions for variance parameters). The scatter is half-normal: scatter and a level for
each unit are equivalent, and only the size distinguishes them.
"""

from dataclasses import dataclass
from typing import Final, NamedTuple, Self

import numpy as np
from scipy.linalg.lapack import dposv
from scipy.special import betaln, gammaln

from estimators.arrays import Bools, Floats, Ints
from estimators.interpreted import compiled_unless_short_log
from estimators.joint.change_rates import (
    LOG_HALF,
    LOG_THIRD,
    compute_log_odds_of_changes_by_place,
    compute_log_prior_of_unknown_change_rate,
)
from estimators.joint.joint_limits import LIMITS
from estimators.joint.unit_levels import DUMPED, FILLED, HINTED, NAMED, UnitLevels

#: Standard deviations of the levels, as fractions of the largest spread.
_DEVIATIONS: Final = 0.5 ** np.arange(6)


@dataclass(frozen=True, slots=True)
class Partition:
    """A partition with its levels, effects and posterior probability.

    Attributes:
        state: (n,) stretch number of each unit, from 0.
        levels: (states,) level of each stretch.
        level: (states,) index of each stretch's level; a level may recur.
        scatter: standard deviation between units of one level.
        effects: (r,) β.
        log_posterior: log posterior probability, up to a constant of the series.
        log_place_odds: log odds of its changes by the recurrent places of the boundaries.
    """

    state: Ints
    levels: Floats
    level: Ints
    scatter: float
    effects: Floats
    log_posterior: float
    log_place_odds: float = 0.0

    @property
    def log_posterior_by_place(self) -> float:
        """Log posterior among partitions with several levels, with the recurrent places."""
        return self.log_posterior + self.log_place_odds

    @property
    def stretch_count(self) -> int:
        """Number of stretches."""
        return self.levels.size

    @property
    def degrees_of_freedom(self) -> int:
        """Number of units minus number of levels."""
        return self.state.size - int(self.level.max()) - 1


class LevelAssignment(NamedTuple):
    """A way in which levels recur in a partition.

    Attributes:
        log_probability: log prior probability.
        level: (stretches,) index of each stretch's level.
        has_lightest_first: whether it applies only if no level is clearly below the first.
    """

    log_probability: float
    level: Ints
    has_lightest_first: bool = False


@dataclass(frozen=True, slots=True)
class Stretches:
    """Stretches of a partition, with prior probabilities.

    Attributes:
        state: (n,) stretch number of each unit, ascending from 0.
        levels: possible assignments of levels to the stretches.
        log_prior: log prior probability of the partition.
        log_place_odds: log odds of the changes by the recurrent places.
    """

    state: Ints
    levels: list[LevelAssignment]
    log_prior: float
    log_place_odds: float = 0.0

    @classmethod
    def from_boundaries(cls, state_of_unit: Ints, units: UnitLevels) -> Self:
        """Number the stretches of a partition, and compute its log prior probability."""
        has_change = np.diff(state_of_unit) > 0
        return cls(
            state_of_unit,
            list_level_assignments(units.kind[has_change] == FILLED),
            compute_log_prior_of_changes(units.kind, has_change),
            0.0
            if units.place is None
            else compute_log_odds_of_changes_by_place(units.kind, units.place, has_change),
        )


class PartitionPosterior:
    """Posterior of partitions of units with a given scatter.

    Args:
        units: the units in order.
        spread: largest plausible distance between levels.
        scatter: standard deviation between units of one level.
        usual: typical scatter; None if `scatter` is known.
    """

    def __init__(
        self, units: UnitLevels, spread: float, scatter: float, usual: float | None
    ) -> None:
        self.units, self.spread, self.scatter = units, spread, scatter
        self.variance = units.variance + scatter**2
        self._middle = float(units.y.mean())
        known = np.column_stack([units.x, units.y - self._middle])
        weight = 1.0 / self.variance
        # for each unit: weight, weighted effects and weighted value
        self._sums = np.column_stack([weight, weight[:, None] * known])
        self._squares = known.T @ self._sums[:, 1:]
        self._log = -0.5 * float(np.log(self.variance).sum())
        if usual is not None:
            self._log -= (scatter / usual) ** 2 / 2.0

    def estimate_shared_effects(self, state_of_unit: Ints) -> Floats:
        """Posterior mean of the effects β, (r,), with one level for every stretch.

        Args:
            state_of_unit: (n,) stretch numbers, ascending.
        """
        whole, right, _ = self._eliminate_levels(self._sum_equations_by_state(state_of_unit))
        return solve_with_log_determinant(whole, right)[0]

    def fit_partition(self, stretches: Stretches) -> Partition:
        """Fit levels and effects of a partition, and compute its log posterior."""
        by_state = self._sum_equations_by_state(stretches.state)
        best, logs = None, []
        for weight, level, has_lightest_first in stretches.levels:
            sums = sum_by_level(by_state, level)
            log, levels, effects = self._integrate_levels_and_effects_out(sums)
            apart = LIMITS.lighter_level_std * np.sqrt(1.0 / sums[:, 0] + 1.0 / sums[0, 0])
            if has_lightest_first and (levels < levels[0] - apart).any():
                continue
            logs.append(weight + log)
            if best is None or logs[-1] > best[0]:
                best = logs[-1], levels[level], level, effects
        assert best is not None
        posterior = float(np.logaddexp.reduce(logs)) + self._log + stretches.log_prior
        return Partition(
            stretches.state,
            *(best[1], best[2], self.scatter, best[3], posterior),
            stretches.log_place_odds,
        )

    def _sum_equations_by_state(self, state_of_unit: Ints) -> Floats:
        """Sum the normal equations of consecutive units in one state."""
        first = np.append(0, np.flatnonzero(np.diff(state_of_unit)) + 1)
        return np.add.reduceat(self._sums, first)

    def _eliminate_levels(self, sums: Floats) -> tuple[Floats, Floats, float]:
        """Normal equations of β, (r, r) and (r,), and the remaining sum of squares.

        Args:
            sums: (levels, 2 + r) sums of the weights, and of weighted effects and values.
        """
        within = self._squares - sums[:, 1:].T @ (sums[:, 1:] / sums[:, :1])
        units = self.units
        return units.gram + within[:-1, :-1], units.cross + within[:-1, -1], float(within[-1, -1])

    def _integrate_levels_and_effects_out(self, sums: Floats) -> tuple[float, Floats, Floats]:
        """Log likelihood with levels and β integrated out, the levels, and β."""
        whole, right, squares = self._eliminate_levels(sums)
        effects, log_determinant = solve_with_log_determinant(whole, right)
        own = 1.0 / sums[:, 0]
        levels = self._middle + own * (sums[:, -1] - sums[:, 1:-1] @ effects)
        # the misfit of β follows from its normal equations, up to a constant
        logs = log_determinant - float(np.log(2.0 * np.pi * own).sum())
        log = -0.5 * (squares - float(effects @ right) + logs)
        return log + compute_log_likelihood_of_levels(levels, own, self.spread), levels, effects


@compiled_unless_short_log
def sum_by_level(values_by_state: Floats, level_of_state: Ints) -> Floats:
    """Sum (states, columns) by level, (levels, columns)."""
    sums = np.zeros((level_of_state.max() + 1, values_by_state.shape[1]))
    for state in range(level_of_state.size):
        for i in range(values_by_state.shape[1]):
            sums[level_of_state[state], i] += values_by_state[state, i]
    return sums


def solve_with_log_determinant(
    normal_matrix: Floats, right_hand_side: Floats
) -> tuple[Floats, float]:
    """Solve normal equations; return the solution and the log determinant.

    If rounding makes the equations singular, both refer to the determined subspace.
    """
    if not right_hand_side.size:
        return right_hand_side, 0.0
    # one factorisation gives both; numpy's two functions take three times as long
    factor, solution, fault = dposv(normal_matrix, right_hand_side)
    if fault:
        values, vectors = np.linalg.eigh(normal_matrix)
        kept = values > np.finfo(np.float64).eps * values.size * values[-1]
        values, vectors = values[kept], vectors[:, kept]
        return vectors @ (vectors.T @ right_hand_side / values), float(np.log(values).sum())
    return solution, 2.0 * float(np.log(factor.diagonal()).sum())


def list_level_assignments(ends_in_filling: Bools) -> list[LevelAssignment]:
    """List the possible assignments of levels to the stretches of a partition.

    Args:
        ends_in_filling: (stretches - 1,) whether each stretch but the last ends at a filling.
    """
    own = np.arange(ends_in_filling.size + 1)
    if own.size <= 2:
        return [LevelAssignment(0.0, own)]
    recurs = [own % 2 == 0, own % 2 == 1]
    # emptied in several parts, a load has more than two states, and the last one recurs
    emptied = np.append(ends_in_filling, False)
    is_known = any((emptied[:-1] == each[:-1]).all() for each in recurs)
    # neighbours of one level would be one state
    if emptied.sum() > 1 and not is_known and not (emptied[1:] & emptied[:-1]).any():
        recurs.append(emptied)
    back = LOG_THIRD - float(np.log(len(recurs)))
    return [
        LevelAssignment(LOG_THIRD, own),
        LevelAssignment(LOG_THIRD, own % 2),
        *(
            LevelAssignment(
                back,
                np.unique(np.where(each, -1, own), return_inverse=True)[1],
                # nothing is lighter than what is emptied before it is filled
                has_lightest_first=each is emptied,
            )
            for each in recurs
        ),
    ]


def compute_log_likelihood_of_levels(
    level_values: Floats, variance: Floats, level_spread: float
) -> float:
    """Log likelihood of levels with the given variances, with their spread integrated out."""
    if level_values.size == 1:
        return -float(np.log(level_spread))
    each = (_DEVIATIONS[:, None] * level_spread) ** 2 + variance
    total = (1.0 / each).sum(axis=1)
    mean = (level_values / each).sum(axis=1) / total
    misfit = ((level_values - mean[:, None]) ** 2 / each).sum(axis=1)
    logs = np.log(2.0 * np.pi * each).sum(axis=1) + np.log(total / (2.0 * np.pi))
    return float(
        np.logaddexp.reduce(-0.5 * (misfit + logs)) - np.log(level_spread * _DEVIATIONS.size)
    )


def compute_log_prior_of_changes(change_kinds: Ints, has_change: Bools) -> float:
    """Log prior probability of the changes.

    With fillings, one emptying between two fillings is as probable as any other pattern.
    """
    named, filling = change_kinds == NAMED, change_kinds == FILLED
    if named.any():
        said = np.where(
            has_change[named],
            np.log1p(-LIMITS.misnamed_probability),
            np.log(LIMITS.misnamed_probability),
        )
        return float(said.sum()) + compute_log_prior_of_changes(
            change_kinds[~named], has_change[~named]
        )
    if not filling.any():
        return compute_log_prior_of_unknown_change_rate(change_kinds, has_change)
    # or apparent fillings are unrelated to the level in this series
    apart = compute_log_prior_of_unknown_change_rate(
        np.where(filling, 1, change_kinds), has_change
    ) + float(np.log(LIMITS.unrelated_filling_probability))
    return float(
        np.logaddexp(
            apart,
            compute_log_prior_of_work_cycles(change_kinds, has_change)
            + np.log1p(-LIMITS.unrelated_filling_probability),
        )
    )


def compute_log_prior_of_work_cycles(change_kinds: Ints, has_change: Bools) -> float:
    """Log prior probability of changes of the load as work cycles, without its constant.

    A cycle has one change at its filling and another, the dump, before the next filling, preferably
    where there is a hint. How many loads are dumped in several parts is unknown, so that a pattern
    frequent in a series costs little (a beta-binomial prior).

    Args:
        change_kinds: (n - 1,) kind of each boundary between manoeuvres.
        has_change: (n - 1,) whether the load changes there.
    """
    filling = change_kinds == FILLED
    cycle = np.cumsum(filling & has_change)
    count = int(cycle[-1]) + 1
    weight = LIMITS.hinted_emptying_ratio ** (
        np.float64(change_kinds >= HINTED) + (change_kinds == DUMPED)
    )
    weight[filling | (change_kinds == 0)] = 0.0
    total = np.bincount(cycle, weight, minlength=count)
    emptied = has_change & ~filling
    parts = np.bincount(cycle[emptied], minlength=count)
    # no dump can be seen without a boundary, and a log may begin or end anywhere in a cycle
    is_cut = np.zeros(count, np.bool_)
    is_cut[[0, -1]] = parts[[0, -1]] == 0
    none, once, several = np.bincount(
        np.minimum(parts[(total > 0.0) & ~is_cut], 2), minlength=3
    ).tolist()
    rare, cycles = LIMITS.unusual_emptying_probability, LIMITS.usual_emptying_cycles
    # ∫ over the unknown share of loads that are emptied in several parts
    log = none * float(np.log(rare)) + (once + several) * float(np.log1p(-rare))
    log += float(
        betaln(cycles * rare + several, cycles * (1.0 - rare) + once)
        - betaln(cycles * rare, cycles * (1.0 - rare))
    )
    log += LOG_HALF * (int(is_cut.sum()) + int((parts[parts > 1] - 1).sum()))
    # any choice of so many boundaries, each by its weight, the second another than the first
    log += float(gammaln(parts + 1).sum() + np.log(weight[emptied] / total[cycle[emptied]]).sum())
    same = np.bincount(cycle, weight**2, minlength=count)[parts > 1] / total[parts > 1] ** 2
    log -= float(np.log1p(-same).sum())
    fillings = np.where(
        has_change[filling],
        np.log1p(-LIMITS.unfilled_probability),
        np.log(LIMITS.unfilled_probability),
    )
    return log + float(fillings.sum())
