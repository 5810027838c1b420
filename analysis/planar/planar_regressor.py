"""The planar regressor with additional term columns, built in blocks."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.planar.planar_motion import Drive
from analysis.planar.planar_terms import Term
from estimators.arrays import Floats, Ints
from estimators.planar.planar_rows import PARAMETERS


@dataclass(frozen=True, slots=True)
class Regressor:
    """Selected rows and columns of the planar regressor, followed by term columns.

    Attributes:
        drive: the samples.
        columns: selected columns among the six.
        terms: terms of the additional columns.
        axes: selected rows: force, yaw torque, or both.
        mixtures: (2, 6, terms) part of each term in the six columns, by row.
    """

    drive: Drive
    columns: Ints
    terms: Sequence[Term]
    axes: slice
    mixtures: Floats

    @classmethod
    def from_drive(
        cls, drive: Drive, columns: Ints, terms: Sequence[Term], axes: slice
    ) -> "Regressor":
        """Build the regressor, computing the mixtures once."""
        mixtures = np.zeros((2, len(PARAMETERS), len(terms)))
        for number, term in enumerate(terms):
            for axis, parts in enumerate(term.mixture(drive)):
                for column, factor in parts.items():
                    mixtures[axis, column, number] = factor
        return cls(drive, columns, terms, axes, mixtures)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape of the regressor."""
        rows = len(range(2)[self.axes])
        return self.drive.plane.motion.speed.size, rows, self.columns.size + len(self.terms)

    def __getitem__(self, part: slice) -> Floats:
        """Regressor of a slice of samples, (m, rows, columns)."""
        plain = self.drive.plane.motion[part]
        motion = self.drive.turning_samples(part)
        more = np.einsum("nkc,kct->nkt", plain, self.mixtures)
        for number, term in enumerate(self.terms):
            for axis, column in enumerate(term.columns(motion)):
                if column is not None:
                    more[:, axis, number] += column
        return np.concatenate([plain[..., self.columns], more], axis=-1)[:, self.axes]

    @property
    def noise_loading(self) -> Floats:
        """(rows, p, p) loading of each column on the noise of each, see `base_parameters.fit`."""
        size = self.shape[-1]
        found = np.zeros((2, size, size))
        found[:, range(size), range(size)] = 1.0
        found[:, self.columns.size :, : self.columns.size] = self.mixtures[
            :, self.columns
        ].transpose(0, 2, 1)
        return found[self.axes]
