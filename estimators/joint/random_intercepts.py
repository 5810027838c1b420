"""The levels of a first parameter: which group of samples has which, and how they scatter."""

from dataclasses import dataclass

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.interpreted import compiled_ahead


@dataclass(frozen=True, slots=True)
class RandomIntercepts:
    """The first parameter's levels.

    Attributes:
        of: (groups,) level of each group, from 0, groups in ascending order.
        unit: (groups,) what scatters as one, from 0; a unit has one level.
        scatter: standard deviation of the units about their level.
        freedom: degrees of freedom by which that is known.
    """

    membership: Ints
    unit: Ints
    scatter: float = 0.0
    freedom: float = np.inf

    @property
    def count(self) -> int:
        """How many levels there are."""
        return int(self.membership.max()) + 1


@dataclass(frozen=True, slots=True)
class InterceptShape:
    """How p parameters of a group are those of the whole: a level first, then everyone's."""

    levels: RandomIntercepts
    p: int
    scale: float

    def widen(self, values: Floats) -> Floats:
        """(p,) of a group as (wide,), the first for every level."""
        return np.concatenate([np.full(self.levels.count, values[0]), values[1:]])

    def by_group(self, theta: Floats) -> Floats:
        """(groups, p) parameters of each."""
        membership = self.levels.membership
        shared = np.broadcast_to(theta[self.levels.count :], (membership.size, self.p - 1))
        return np.column_stack([theta[membership], shared])

    def expand_rows(self, values: Floats) -> Floats:
        """(groups, wide) of (groups, p)."""
        count, membership = self.levels.count, self.levels.membership
        out = np.zeros((membership.size, count + self.p - 1))
        out[np.arange(membership.size), membership] = values[:, 0]
        out[:, count:] = values[:, 1:]
        return out

    def expand_square(self, values: Floats) -> Floats:
        """The sum (wide, wide) of (groups, p, p)."""
        return _sum_outer_products(values, self.levels.membership, self.levels.count)

    @property
    def level_of_units(self) -> Ints:
        """(units,) level of each."""
        out = np.zeros(int(self.levels.unit.max()) + 1, np.int64)
        out[self.levels.unit] = self.levels.membership
        return out


@compiled_ahead
def _sum_outer_products(values: Floats, membership: Ints, count: int) -> Floats:
    """The sum (wide, wide) of (groups, p, p), the first row and column of each at its level."""
    groups, p, _ = values.shape
    out = np.zeros((count + p - 1, count + p - 1))
    for g in range(groups):
        for i in range(p):
            row = membership[g] if i == 0 else count + i - 1
            for j in range(p):
                out[row, membership[g] if j == 0 else count + j - 1] += values[g, i, j]
    return out
