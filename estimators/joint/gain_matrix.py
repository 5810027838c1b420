"""Gain of an estimate, θ = gain · scores + …, and the inverse matrix (bread) that belongs to it.

H = C S⁻¹ C + P with C the normal equations, S the covariance of the scores and P the priors;
bread = H⁻¹, gain = H⁻¹ C S⁻¹. With few levels both are dense matrices. With many levels they are
found from [S C; C −P] [y; θ] = [b; −P θ₀] by eliminating the levels one by one: both are then
diagonal plus a product of (wide, r) matrices, r being twice the number of shared parameters plus 1.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from estimators.arrays import Floats
from estimators.joint.joint_limits import LIMITS
from estimators.numerics.bordered_matrix import BorderedMatrix


class Gain(Protocol):
    """Gain (wide, wide) and bread (wide, wide) of a solution."""

    @property
    def bread(self) -> Floats:
        """H⁻¹."""
        ...

    def apply_to_rows(self, rows: Floats) -> Floats:
        """Response to scores by row: rows (n, wide) times the transposed gain."""
        ...

    def apply_to_vector(self, vector: Floats, factor: float) -> Floats:
        """Response to `factor` times a vector of scores (wide,)."""
        ...

    def propagate_covariance(self, covariance: BorderedMatrix | Floats) -> Floats:
        """Covariance (wide, wide) of the estimates, by that of the scores."""
        ...


@dataclass(frozen=True, slots=True)
class DenseGain:
    """Gain with few levels, as dense matrices.

    Attributes:
        bread: H⁻¹.
        gain: H⁻¹ C S⁻¹.
    """

    bread: Floats
    gain: Floats

    def apply_to_rows(self, rows: Floats) -> Floats:
        """See `Gain`."""
        return rows @ self.gain.T

    def apply_to_vector(self, vector: Floats, factor: float) -> Floats:
        """See `Gain`."""
        return factor * self.gain @ vector

    def propagate_covariance(self, covariance: BorderedMatrix | Floats) -> Floats:
        """See `Gain`."""
        dense = covariance.to_dense() if isinstance(covariance, BorderedMatrix) else covariance
        return self.gain @ dense @ self.gain.T


@dataclass(frozen=True, slots=True)
class FactoredGain:
    """Gain with many levels: diag(own) + left · rightᵀ.

    Attributes:
        own: (wide,) diagonal of the gain; 0 for shared parameters.
        left: (wide, r) left factor, with the inverse of the reduced system.
        right: (wide, r) right factor.
        bread_own: (wide,) diagonal of the bread.
        bread_right: (wide, r) right factor of the bread.
    """

    own: Floats
    left: Floats
    right: Floats
    bread_own: Floats
    bread_right: Floats

    @property
    def bread(self) -> Floats:
        """See `Gain`."""
        return np.diag(self.bread_own) + self.left @ self.bread_right.T

    def apply_to_rows(self, rows: Floats) -> Floats:
        """See `Gain`."""
        return rows * self.own + (rows @ self.right) @ self.left.T

    def apply_to_vector(self, vector: Floats, factor: float) -> Floats:
        """See `Gain`."""
        return factor * self.apply_to_rows(vector[None])[0]

    def propagate_covariance(self, covariance: BorderedMatrix | Floats) -> Floats:
        """See `Gain`."""
        if not isinstance(covariance, BorderedMatrix):
            gain = np.diag(self.own) + self.left @ self.right.T
            return gain @ covariance @ gain.T
        spread = covariance.multiply(self.right)
        half = self.own[:, None] * spread + self.left @ (self.right.T @ spread) / 2.0
        crossed = half @ self.left.T
        m = covariance.diagonal.size
        crossed += crossed.T
        # the shared parameters have no diagonal of their own
        crossed[range(m), range(m)] += self.own[:m] ** 2 * covariance.diagonal
        return crossed


def solve_by_elimination(
    normal_matrix: BorderedMatrix,
    scores: tuple[BorderedMatrix, Floats, float],
    priors: tuple[Floats, Floats],
    right_hand_side: Floats,
    variance: float,
) -> tuple[Floats, FactoredGain]:
    """Solve for the estimates (wide,) and their gain by eliminating level by level.

    Args:
        normal_matrix: normal equations C.
        scores: covariance S of the scores over σ²: a bordered matrix, a vector (wide,) that is
            added times itself, and a number that is added to the diagonal.
        priors: (wide,) P, and P θ₀.
        right_hand_side: (wide,) right-hand side b.
        variance: σ².

    Raises:
        LinAlgError: the samples do not determine the estimates.
    """
    gram, doubted, ridge = scores
    precision, believed = (variance * each for each in priors)
    m, k = normal_matrix.right.shape
    c, p = normal_matrix.diagonal, precision[:m]
    s = gram.diagonal + ridge
    determinant = -(s * p + c**2)
    if not determinant.all():
        raise np.linalg.LinAlgError("a level without samples")
    # inverse of [s c; c -p], level by level
    k_yy, k_yt, k_tt = -p / determinant, -c / determinant, s / determinant
    zeros = np.zeros((m, k))
    of_y = np.concatenate([gram.right, normal_matrix.right, doubted[:m, None]], axis=1)
    of_t = np.concatenate([normal_matrix.right, zeros, np.zeros((m, 1))], axis=1)
    q_y = k_yy[:, None] * of_y + k_yt[:, None] * of_t
    q_t = k_yt[:, None] * of_y + k_tt[:, None] * of_t
    size = 2 * k + 1
    reduced = np.zeros((size, size))
    reduced[:k, :k] = gram.corner + ridge * np.eye(k)
    reduced[:k, k : 2 * k], reduced[k : 2 * k, :k] = normal_matrix.corner, normal_matrix.corner.T
    reduced[range(k, 2 * k), range(k, 2 * k)] = -precision[m:]
    reduced[:k, -1] = reduced[-1, :k] = doubted[m:]
    reduced[-1, -1] = -1.0
    reduced -= of_y.T @ q_y + of_t.T @ q_t
    inverse = np.linalg.inv(reduced)
    known = np.concatenate([right_hand_side[m:], -believed[m:], [0.0]])
    shared = inverse @ (known - q_y.T @ right_hand_side[:m] + q_t.T @ believed[:m])
    levels = k_yt * right_hand_side[:m] - k_tt * believed[:m] - q_t @ shared
    theta = np.concatenate([levels, shared[k : 2 * k]])
    unit = np.eye(size)
    outer_t = np.concatenate([q_t, -unit[k : 2 * k]])
    outer_y = np.concatenate([q_y, -unit[:k]])
    left = outer_t @ inverse
    nothing = np.zeros(k)
    return theta, FactoredGain(
        np.concatenate([k_yt, nothing]),
        left,
        outer_y,
        np.concatenate([-variance * k_tt, nothing]),
        -variance * outer_t,
    )


def is_level_elimination_worthwhile(equations: BorderedMatrix) -> bool:
    """Whether there are enough levels for their elimination to be faster than dense matrices."""
    return equations.diagonal.size >= LIMITS.eliminated_levels


def raise_meats_to_white_noise_floor(
    meats: BorderedMatrix, gram: BorderedMatrix, white_variance: float
) -> BorderedMatrix | Floats:
    """Raise each direction of the meats to a minimum fraction of its white-noise value.

    Otherwise estimated correlations may imply a negative variance.

    Returns:
        The meats times the variance `white_variance` of the residuals.
    """
    if is_level_elimination_worthwhile(gram) and meats.dominates_fraction_of(
        gram, LIMITS.min_white_fraction, LIMITS.gain_rounding_fraction
    ):
        return meats.multiply_by_number(white_variance)
    squares, vectors = np.linalg.eigh(gram.to_dense())
    root = vectors * np.sqrt(np.maximum(squares, squares[-1] * LIMITS.gain_rounding_fraction))
    half = np.linalg.solve(root, meats.to_dense())
    of_white, directions = np.linalg.eigh(np.linalg.solve(root, half.T))
    if of_white[0] >= LIMITS.min_white_fraction:
        return meats.multiply_by_number(white_variance)
    kept = root @ directions
    return (kept * np.maximum(of_white, LIMITS.min_white_fraction)) @ kept.T * white_variance
