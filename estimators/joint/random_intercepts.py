"""Random intercepts: levels of the first parameter by group, and their scatter."""

from dataclasses import dataclass

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.interpreted import compiled_unless_short_log
from estimators.numerics.bordered_matrix import BorderedMatrix


@dataclass(frozen=True, slots=True)
class RandomIntercepts:
    """A level of the first parameter for each group; the units at a level scatter about it.

    Attributes:
        membership: (groups,) level of each group, from 0, groups in ascending order.
        unit: (groups,) unit of each group, from 0; the groups of a unit have the same deviation
            from their level.
        scatter: standard deviation of the units about their level.
        degrees_of_freedom: degrees of freedom of the scatter.
    """

    membership: Ints
    unit: Ints
    scatter: float = 0.0
    degrees_of_freedom: float = np.inf

    @property
    def level_count(self) -> int:
        """Number of levels."""
        return int(self.membership.max()) + 1


@dataclass(frozen=True, slots=True)
class InterceptShape:
    """Mapping of the p parameters of a group to all parameters: levels first, then shared ones."""

    levels: RandomIntercepts
    p: int
    scale: float

    def expand_to_levels(self, values: Floats) -> Floats:
        """Expand (p,) of a group to (wide,), with the first value at every level."""
        return np.concatenate([np.full(self.levels.level_count, values[0]), values[1:]])

    def select_group_parameters(self, theta: Floats) -> Floats:
        """Parameters of each group, (groups, p)."""
        membership = self.levels.membership
        shared = np.broadcast_to(theta[self.levels.level_count :], (membership.size, self.p - 1))
        return np.column_stack([theta[membership], shared])

    def expand_group_rows(self, values: Floats) -> Floats:
        """Expand (groups, p) to (groups, wide)."""
        count, membership = self.levels.level_count, self.levels.membership
        out = np.zeros((membership.size, count + self.p - 1))
        out[np.arange(membership.size), membership] = values[:, 0]
        out[:, count:] = values[:, 1:]
        return out

    def expand_group_matrices(self, values: Floats) -> BorderedMatrix:
        """Expand each of (groups, p, p) to (wide, wide), and add them up."""
        return BorderedMatrix(
            *sum_matrices_by_level(values, self.levels.membership, self.levels.level_count)
        )

    @property
    def level_of_each_unit(self) -> Ints:
        """(units,) level of each unit."""
        out = np.zeros(int(self.levels.unit.max()) + 1, np.int64)
        out[self.levels.unit] = self.levels.membership
        return out


@compiled_unless_short_log
def sum_matrices_by_level(
    values: Floats, level_of_group: Ints, level_count: int
) -> tuple[Floats, Floats, Floats, Floats]:
    """Parts of a `BorderedMatrix`: sum of (groups, p, p), first row and column at their level."""
    groups, p, _ = values.shape
    k = p - 1
    diagonal, right, below = (
        np.zeros(level_count),
        np.zeros((level_count, k)),
        np.zeros((k, level_count)),
    )
    corner = np.zeros((k, k))
    for g in range(groups):
        level = level_of_group[g]
        diagonal[level] += values[g, 0, 0]
        for i in range(k):
            right[level, i] += values[g, 0, i + 1]
            below[i, level] += values[g, i + 1, 0]
            for j in range(k):
                corner[i, j] += values[g, i + 1, j + 1]
    return diagonal, right, below, corner
