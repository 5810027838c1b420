"""Symmetric matrices that are diagonal except for their last rows and columns.

Normal equations have this shape if each group has its own level and all groups share the other
parameters. The cost then grows with the number of levels, not with its cube as for dense matrices.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats


class BorderedMatrix(NamedTuple):
    """A symmetric matrix of m levels and k shared parameters.

    Attributes:
        diagonal: (m,) diagonal elements of the levels.
        right: (m, k) elements of levels and shared parameters.
        below: (k, m) transpose of `right`, except for rounding.
        corner: (k, k) elements of the shared parameters.
    """

    diagonal: Floats
    right: Floats
    below: Floats
    corner: Floats

    def to_dense(self) -> Floats:
        """The matrix, (m + k, m + k)."""
        m = self.diagonal.size
        out = np.zeros((m + len(self.corner), m + len(self.corner)))
        out[range(m), range(m)] = self.diagonal
        out[:m, m:], out[m:, :m], out[m:, m:] = self.right, self.below, self.corner
        return out

    @property
    def trace(self) -> float:
        """Sum of the diagonal."""
        return float(self.diagonal.sum() + np.trace(self.corner))

    def multiply_by_number(self, factor: float) -> "BorderedMatrix":
        """The matrix times a number."""
        return BorderedMatrix(*(factor * part for part in self))

    def multiply(self, columns: Floats) -> Floats:
        """Product with columns (m + k, n)."""
        m = self.diagonal.size
        return np.concatenate(
            [
                self.diagonal[:, None] * columns[:m] + self.right @ columns[m:],
                self.below @ columns[:m] + self.corner @ columns[m:],
            ]
        )

    def solve(self, columns: Floats) -> Floats:
        """Solve for right-hand sides (m + k,).

        Raises:
            LinAlgError: the matrix is singular.
        """
        m = self.diagonal.size
        if not self.diagonal.all():
            raise np.linalg.LinAlgError("a level without samples")
        scaled = self.right / self.diagonal[:, None]
        reduced = self.corner - self.right.T @ scaled
        shared = np.asarray(
            np.linalg.solve(reduced, columns[m:] - scaled.T @ columns[:m]), np.float64
        )
        return np.concatenate([columns[:m] / self.diagonal - scaled @ shared, shared])

    def dominates_fraction_of(
        self, other: "BorderedMatrix", fraction: float, rounding: float
    ) -> bool:
        """Whether this matrix minus a fraction of another one is positive semidefinite.

        Directions smaller than `rounding` of the largest corner element are ignored.
        """
        diagonal = self.diagonal - fraction * other.diagonal
        if not (diagonal > 0.0).all():
            return False
        right = self.right - fraction * other.right
        corner = self.corner - fraction * other.corner
        schur = corner - right.T @ (right / diagonal[:, None])
        size = np.sqrt(np.maximum(np.diag(other.corner), rounding * np.diag(other.corner).max()))
        return float(np.linalg.eigvalsh(schur / np.outer(size, size))[0]) >= -rounding
