"""Planar motion of a log with the known parameters of its machine: the input of terms."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import polars as pl

from analysis.model.machine import Machine
from analysis.model.schema import get_column_values
from analysis.planar.planar_limits import LIMITS
from analysis.planar.planar_samples import PlanarSamples
from estimators.arrays import Bools, Floats
from estimators.planar.planar_rows import PARAMETERS

_AT = {name: number for number, name in enumerate(PARAMETERS)}


class TurningSamples(NamedTuple):
    """Samples (m,) of a slice of planar motion.

    Force and torque are those of the model unless called measured, since noise of measured ones
    would explain itself. They are means over a second; their rates are not averaged.
    """

    acc_x: Floats
    acc_y: Floats
    speed: Floats
    yaw_rate: Floats
    yaw_acc: Floats
    measured_force: Floats
    measured_torque: Floats
    force: Floats
    torque: Floats
    force_rate: Floats
    torque_rate: Floats
    slip_rate: Floats
    direction_x: Floats
    direction_x_spinning: Floats
    rolling_z: Floats
    direction_z: Floats
    progress: Floats
    heading_rad: Floats
    one: Floats
    drive: "PlanarDrive"


@dataclass(frozen=True, slots=True)
class PlanarDrive:
    """Planar samples, directions of motion and a nearly known machine, for the terms of a fit.

    Attributes:
        plane: motion and forces.
        machine: machine file.
        coefficients: (6,) coefficients of the planar regressor; 0 if not determined.
        term_inputs: (11, n) fields of `TurningSamples` from force to heading.
        peak_force_N: large quantile of the force, in N.
        peak_torque_N_m: large quantile of the yaw torque, in N·m.
        peak_speed_m_s: large quantile of the speed, in m/s.
        peak_yaw_rate_rad_s: large quantile of the yaw rate, in rad/s.
        peak_acc_y_m_s2: large quantile of the lateral acceleration, in m/s².
    """

    plane: PlanarSamples
    machine: Machine
    coefficients: Floats
    term_inputs: Floats
    peak_force_N: float
    peak_torque_N_m: float
    peak_speed_m_s: float
    peak_yaw_rate_rad_s: float
    peak_acc_y_m_s2: float

    @property
    def gravity_m_s2(self) -> float:
        """Gravity by the machine file, in m/s²."""
        return self.machine.machine.gravity_m_s2

    @property
    def mass_kg(self) -> float:
        """Mass in kg by the previous fit, else by the machine file; 0 if unknown."""
        fitted_kg = self._read_term_coefficient("mass_kg")
        return fitted_kg if fitted_kg > 0.0 else self.machine.machine.empty_mass_kg or 0.0

    @property
    def inertia_z_kg_m2(self) -> float:
        """Yaw inertia in kg·m² by the previous fit; 0 if undetermined."""
        return self._read_term_coefficient("inertia_z_kg_m2")

    @property
    def moment_x_kg_m(self) -> float:
        """First moment in x (forward), in kg·m, by the previous fit; 0 if undetermined."""
        return self._read_term_coefficient("first_moment_x_kg_m")

    @property
    def moment_y_kg_m(self) -> float:
        """First moment in y (left), in kg·m, by the previous fit; 0 if undetermined."""
        return self._read_term_coefficient("first_moment_y_kg_m")

    @property
    def turning_friction(self) -> float:
        """Viscous friction of turning, in N·m·s."""
        return self._read_term_coefficient("friction_z_N_m_s")

    @property
    def half_track_m(self) -> float:
        """Lever arm of each side's force, in m; 1 m without a track width."""
        return read_half_track_m(self.machine)

    @property
    def weight_newtons(self) -> float:
        """Weight of the machine, in N."""
        return self.mass_kg * self.gravity_m_s2

    def _read_term_coefficient(self, term_name: str) -> float:
        return float(self.coefficients[_AT[term_name]])

    def select_slice(self, sample_slice: slice) -> "PlanarDrive":
        """Cut the drive to a slice of samples."""
        return replace(
            self,
            plane=self.plane.select_slice(sample_slice),
            term_inputs=self.term_inputs[:, sample_slice],
        )

    def make_turning_samples(self, sample_slice: slice) -> TurningSamples:
        """Samples of a slice in the form from which the columns of the terms are computed."""
        moved = self.plane.motion
        return TurningSamples(
            moved.specific_force_x[sample_slice],
            moved.specific_force_y[sample_slice],
            moved.speed[sample_slice],
            moved.yaw_rate[sample_slice],
            moved.yaw_acceleration[sample_slice],
            *self.plane.f[sample_slice].T,
            *self.term_inputs[:, sample_slice],
            one=np.ones(moved.speed[sample_slice].size),
            drive=self,
        )


def make_planar_drive(
    samples: PlanarSamples, excitation: pl.DataFrame, machine: Machine, coefficients: Floats
) -> PlanarDrive:
    """Compute the inputs of the terms.

    Args:
        samples: motion and forces, of all samples of `excitation`.
        excitation: frame with the rate of the speed.
        machine: machine file.
        coefficients: (6,) coefficients of the previous fit; 0 if not determined.
    """
    motion, rate_hz = samples.motion, machine.settings.align.rate_hz
    used = samples.usable & samples.moving
    force, torque = (motion[:] @ coefficients).T
    span = max(machine.settings.smooth.samples // 2, 1)
    step_s = 2.0 * span / rate_hz

    def compute_central_difference(x: Floats) -> Floats:
        out = np.zeros(x.size)
        out[span:-span] = (x[2 * span :] - x[: -2 * span]) / step_s
        return out

    def average(x: Floats) -> Floats:
        from scipy.ndimage import uniform_filter1d  # slow to import

        rows = max(round(LIMITS.model_mean_s * rate_hz), 1)
        return uniform_filter1d(np.nan_to_num(x), rows, mode="nearest")

    def compute_smoothed_direction(speed: Floats, acceleration: Floats, min_speed: float) -> Floats:
        # moving mean of the sign, for motion that passes zero at a constant rate
        passes = np.abs(acceleration) * machine.settings.smooth.samples / rate_hz / 2.0
        return np.clip(speed / np.maximum(passes, min_speed), -1.0, 1.0)

    t = np.arange(motion.speed.size) / rate_hz
    acc_x = get_column_values(excitation, "speed_rate_x_m_s2")
    direction_x = compute_smoothed_direction(motion.speed, acc_x, LIMITS.moving_min_m_s)
    direction_z = compute_smoothed_direction(
        motion.yaw_rate, motion.yaw_acceleration, LIMITS.turning_min_rad_s
    )
    half_track_m = read_half_track_m(machine)
    left, right = (
        compute_smoothed_direction(
            motion.speed + side * motion.yaw_rate,
            acc_x + side * motion.yaw_acceleration,
            LIMITS.moving_min_m_s,
        )
        for side in (-half_track_m, half_track_m)
    )
    spins = np.abs(motion.speed) < half_track_m * np.abs(motion.yaw_rate)
    term_inputs = np.stack(
        [
            average(force),
            average(torque),
            compute_central_difference(force),
            compute_central_difference(torque),
            compute_central_difference(motion.speed * np.abs(force)),
            (left + right) / 2.0,
            np.where(spins, direction_x, 0.0),
            np.where(samples.turning, half_track_m * (right - left) / 2.0, 0.0),
            np.where(samples.turning, direction_z, 0.0),
            t / max(float(t[-1]), 1.0) - 0.5,
            np.cumsum(np.nan_to_num(motion.yaw_rate)) / rate_hz,
        ]
    )
    turns = used & samples.turning
    return PlanarDrive(
        samples,
        machine,
        coefficients,
        np.nan_to_num(term_inputs),
        estimate_robust_maximum(samples.f[:, 0], used),
        estimate_robust_maximum(samples.f[:, 1], turns),
        estimate_robust_maximum(motion.speed, used),
        estimate_robust_maximum(motion.yaw_rate, turns),
        estimate_robust_maximum(motion.specific_force_y, turns),
    )


def read_half_track_m(machine: Machine) -> float:
    """Distance of each side's wheels from the middle, in m; 1 m without a track width."""
    return (machine.machine.track_width_m or 2.0) / 2.0


def has_forward_accelerometer(machine: Machine) -> bool:
    """Whether an accelerometer measures the forward specific force, gravity included."""
    return machine.settings.forces.acceleration == "specific_force"


def has_lateral_accelerometer(machine: Machine) -> bool:
    """Whether an accelerometer measures the lateral specific force."""
    return has_forward_accelerometer(machine) and "specific_force_y_m_s2" in machine.channels


def estimate_robust_maximum(values: Floats, is_used: Bools) -> float:
    """Maximum without outliers; a small positive number if there are no samples."""
    found = (
        float(np.quantile(np.abs(values[is_used]), LIMITS.reached_quantile))
        if is_used.any()
        else 0.0
    )
    return max(found, 1e-6)
