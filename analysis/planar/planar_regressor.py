"""The planar regressor with additional term columns, built in blocks."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.planar.planar_motion import (
    PlanarDrive,
    has_forward_accelerometer,
    has_lateral_accelerometer,
)
from analysis.planar.planar_terms import TERMS, Term
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
        combinations: (2, 6, terms) part of each term in the six columns, by row.
    """

    drive: PlanarDrive
    columns: Ints
    terms: Sequence[Term]
    axes: slice
    combinations: Floats

    @classmethod
    def from_drive(
        cls, drive: PlanarDrive, columns: Ints, terms: Sequence[Term], axes: slice
    ) -> "Regressor":
        """Build the regressor, computing the combinations once."""
        combinations = np.zeros((2, len(PARAMETERS), len(terms)))
        for number, term in enumerate(terms):
            for axis, parts in enumerate(term.combination(drive)):
                for column, factor in parts.items():
                    combinations[axis, column, number] = factor
        return cls(drive, columns, terms, axes, combinations)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape of the regressor."""
        rows = len(range(2)[self.axes])
        return self.drive.plane.motion.speed.size, rows, self.columns.size + len(self.terms)

    def __getitem__(self, part: slice) -> Floats:
        """Regressor of a slice of samples, (m, rows, columns)."""
        plain = self.drive.plane.motion[part]
        motion = self.drive.make_turning_samples(part)
        more = np.einsum("nkc,kct->nkt", plain, self.combinations)
        for number, term in enumerate(self.terms):
            for axis, column in enumerate(term.columns(motion)):
                if column is not None:
                    more[:, axis, number] += column
        return np.concatenate([plain[..., self.columns], more], axis=-1)[:, self.axes]

    @property
    def noise_mixing(self) -> Floats:
        """(rows, p, p) factor of each column's noise (last axis) in each column, 1 on the diagonal.

        It is the argument `noise_mixing` of `base_parameters.fit`.
        """
        size, own = self.shape[-1], self.columns.size
        found = np.tile(np.eye(size), (2, 1, 1))
        found[:, :own, :own] = of_columns = self._compute_noise_mixing_of_selected_columns()
        found[:, own:, :own] = self.combinations[:, self.columns].transpose(0, 2, 1) @ of_columns
        return found[self.axes]

    @property
    def imu_position_m(self) -> tuple[float, float]:
        """Lever arm, ahead and to the left, by which yaw noise enters the accelerometer's columns.

        It is (0, 0) if no accelerometer is used, or if not all six columns are fitted.
        """
        if self.columns.size < len(PARAMETERS) or not has_forward_accelerometer(self.drive.machine):
            return 0.0, 0.0
        return self.drive.machine.machine.imu.position_m[:2]

    def _compute_noise_mixing_of_selected_columns(self) -> Floats:
        """Loading (2, c, c) of the selected columns on the noise of each other."""
        found = np.tile(np.eye(self.columns.size), (2, 1, 1))
        x_m, y_m = self.imu_position_m
        if x_m or y_m:
            mass, inertia, moment_x, moment_y, *_ = range(len(PARAMETERS))
            # `transfer_acceleration_to_origin` adds ω² x + ω̇ y to s_x, and ω² y - ω̇ x to s_y
            found[0, mass, [moment_x, moment_y]] = -x_m, -y_m
            found[1, moment_y, inertia] = -y_m
            if has_lateral_accelerometer(self.drive.machine):
                found[1, moment_x, inertia] = -x_m
        return found


def select_terms_of_drive(drive: PlanarDrive, axes: str = "xz") -> tuple[tuple[Term, float], ...]:
    """Terms that apply to a drive on the given axes, with their prior standard deviations."""
    found: list[tuple[Term, float]] = []
    for term in TERMS:
        if term.applies(drive.machine) and set(term.axes) & set(axes):
            width = term.compute_prior_std(drive, drive.machine.settings.priors)
            # an exactly known effect, or one that the machine cannot have, is no term
            if width > 0.0 and np.isfinite(width):
                found.append((term, width))
    return tuple(found)
