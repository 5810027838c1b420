"""Groups of a fit that disagree with each other, or that all miss the model in the same way."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.linalg import toeplitz

from estimators.arrays import Floats, Ints
from estimators.joint.gain_matrix import Gain
from estimators.joint.random_intercepts import InterceptShape
from estimators.numerics.autocorrelation import pooled_autocorrelation, student_factor

#: Groups disagree when the ratio of variances exceeds 1 by so many of its deviations.
_DISAGREE: Final = 2.5
#: What all groups miss alike counts from this ratio to its noise on.
_MISFIT: Final = 2.0


@dataclass(frozen=True)
class InformativeGroups:
    """Groups with enough samples to be compared.

    Attributes:
        rows: samples of each group.
        turns: (groups, p, p) transformation of its scores by the scatter of its level.
        shape: relation of a group's parameters to all parameters.
        number: index of each among all groups.
    """

    rows: list[Ints]
    turns: Floats
    shape: InterceptShape
    number: list[int]

    def common_residual_scores(self, A: Floats, direction: Floats, length: int) -> Floats:
        """(length, wide) scores caused by a common residual of 1 at each place in the groups."""
        count = self.shape.levels.count
        total = np.zeros((length, count + A.shape[1] - 1))
        for part, turn, number in zip(self.rows, self.turns, self.number, strict=True):
            inside = part[:length]
            own = A[inside] @ turn.T * direction[part[part.size // 2]]
            total[: inside.size, self.shape.levels.membership[number]] += own[:, 0]
            total[: inside.size, count:] += own[:, 1:]
        return total


def between_group_covariance(
    gain: Gain, scores: Floats, covariance: Floats, levels: int
) -> tuple[Floats, float]:
    """Covariance due to disagreeing groups, (p, p), and Birge ratio of the first parameter."""
    count = len(scores)
    freedom = count - levels
    if freedom < 1:
        return np.zeros_like(covariance), float("nan")
    moved = gain.apply_to_rows(scores)
    between = (moved[:, :levels] ** 2).sum(axis=0) * count / freedom
    own = np.diag(covariance)[:levels]
    if not (own > 0.0).all():
        return np.zeros_like(covariance), float("nan")
    ratio = float((between / own).mean())
    if ratio <= 1.0 + _DISAGREE * np.sqrt(2.0 / freedom):
        return np.zeros_like(covariance), float(np.sqrt(ratio))
    # every parameter grows as the first does: a full matrix of few groups is no covariance
    grown = covariance * (ratio * student_factor(float(freedom)) ** 2 - 1.0)
    return grown, float(np.sqrt(ratio))


def common_misfit(
    gain: Gain, A: Floats, residual: Floats, informative: InformativeGroups, direction: Floats
) -> tuple[Floats, float]:
    """Covariance due to a residual common to all groups, (wide, wide), and its ratio to noise.

    Noise averaged over the groups, aligned at their begins, keeps 1/groups of its variance. The
    excess counts as one draw of an error with that average's correlation: repetition in every group
    does not average it out.
    """
    wide, rows = informative.shape.levels.count + A.shape[1] - 1, informative.rows
    nothing = np.zeros((wide, wide))
    if len(rows) < 3:
        return nothing, float("nan")
    length = int(np.median([part.size for part in rows]))
    each = np.full((len(rows), length), np.nan)
    for i, part in enumerate(rows):
        part = part[:length]
        each[i, : part.size] = residual[part] * direction[part[part.size // 2]]
    count = np.isfinite(each).sum(axis=0)
    known = count >= 2
    mean = np.nanmean(each[:, known], axis=0)
    left = float((np.nanvar(each[:, known], axis=0, ddof=1) / count[known]).mean())
    square = float((mean**2).mean())
    ratio = square / left if left > 0 else float("nan")
    if not ratio > _MISFIT:
        return nothing, ratio
    correlation, _ = pooled_autocorrelation(mean, np.zeros(mean.size, np.int64), None)
    moved = gain.apply_to_rows(informative.common_residual_scores(A, direction, length))
    lasts = toeplitz(np.concatenate([correlation, np.zeros(length)])[:length])
    return moved.T @ lasts @ moved * (square - left), ratio
