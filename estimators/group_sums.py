"""The normal equations by group of samples, and what noise of the columns adds to them."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from estimators.compiled import compiled
from estimators.estimate import Floats, Ints
from estimators.fit_loss import group_rows


@dataclass(frozen=True, slots=True)
class NoiseMoments:
    """What noise adds to the normal equations, by group in ascending order.

    Attributes:
        gram: (groups, p, p) added to AᵀA.
        cross: (groups, p) added to Aᵀf, by noise that a column shares with the response.
    """

    gram: Floats
    cross: Floats


@compiled
def noise_moments(
    slopes: Floats, covariances: Floats, which: Ints, group: Ints, groups: int
) -> tuple[Floats, Floats]:
    """Sum what noise of q channels adds to the normal equations of p columns.

    Args:
        slopes: (n, p, q) derivative of each column by each channel; the last channel is the
            response's.
        covariances: (kinds, q, q) of the channels' noise.
        which: (n,) the kind of each sample.
        group: (n,) the group of each sample, from 0.
        groups: how many there are.

    Returns:
        (groups, p, p) and (groups, p): see `NoiseMoments`.
    """
    n, p, q = slopes.shape
    gram, cross = np.zeros((groups, p, p)), np.zeros((groups, p))
    part = np.empty((p, q))
    for k in range(n):
        covariance, g = covariances[which[k]], group[k]
        for i in range(p):
            for y in range(q):
                total = 0.0
                for x in range(q):
                    total += slopes[k, i, x] * covariance[x, y]
                part[i, y] = total
            cross[g, i] += part[i, q - 1]
        for i in range(p):
            for j in range(p):
                total = 0.0
                for y in range(q):
                    total += part[i, y] * slopes[k, j, y]
                gram[g, i, j] += total
    return gram, cross


@dataclass(frozen=True, slots=True)
class GroupSums:
    """The normal equations by group, in ascending order of their numbers.

    Attributes:
        rows: of each group, its samples.
        grams: (groups, p, p) AᵀA.
        crosses: (groups, p) Aᵀf.
        noise_gram: (groups, p, p) what noise added to the first.
        noise_cross: (groups, p) likewise to the second.
    """

    rows: list[Ints]
    grams: Floats
    crosses: Floats
    noise_gram: Floats
    noise_cross: Floats

    @classmethod
    def of(
        cls, A: Floats, f: Floats, group: Ints, noise: NoiseMoments | None, scale: Floats
    ) -> Self:
        """Sum columns that were divided by a scale."""
        rows = group_rows(group)
        grams = np.stack([A[part].T @ A[part] for part in rows])
        crosses = np.stack([A[part].T @ f[part] for part in rows])
        if noise is None:
            return cls(rows, grams, crosses, np.zeros_like(grams), np.zeros_like(crosses))
        return cls(rows, grams, crosses, noise.gram / np.outer(scale, scale), noise.cross / scale)

    def by(self, unit: Ints) -> Self:
        """Add up the groups of one unit each, (groups,) from 0; the rows stay the groups'."""

        def added(values: Floats) -> Floats:
            out = np.zeros((int(unit.max()) + 1, *values.shape[1:]))
            np.add.at(out, unit, values)
            return out

        sums = (self.grams, self.crosses, self.noise_gram, self.noise_cross)
        return type(self)(self.rows, *(added(each) for each in sums))
