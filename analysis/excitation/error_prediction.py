"""Predict the errors of least squares over one window, before anything is measured.

The predicted estimator is that of the paper: every channel after the moving mean, the yaw
acceleration as central difference of the yaw rate, and the rows of `estimators.planar.planar_rows`
divided by the noise of force and torque. To first order the error of θ̂ is linear in every noise
sample, so the weight of each sample is known, and the variance is the sum of their squares. There
is also a bias: with noise N in the regressor and effects that the model lacks (Coulomb friction),
the estimate is (AᵀA + E[NᵀN])⁻¹ Aᵀy instead of θ.
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple, Self, TypeAlias

import numpy as np

from analysis.simulation import Channels, Scenario
from analysis.simulation.motion.body import RigidBody
from estimators.arrays import Floats
from estimators.planar import planar_rows

Drive: TypeAlias = Literal["straight", "spin", "joint"]

#: Columns of `planar_rows.PARAMETERS` and rows of `planar_rows.ROWS` in each drive.
COLUMNS: dict[Drive, list[int]] = {
    "straight": [planar_rows.PARAMETERS.index(name) for name in planar_rows.STRAIGHT_PARAMETERS],
    "spin": [planar_rows.PARAMETERS.index(name) for name in planar_rows.SPIN_PARAMETERS],
    "joint": list(range(len(planar_rows.PARAMETERS))),
}
_ROWS: dict[Drive, list[int]] = {"straight": [0], "spin": [1], "joint": [0, 1]}


class MeasuredSignals(NamedTuple):
    """Sensor signals at n instants, each (n,), or their white noise per sample."""

    force_x_N: Floats
    torque_z_N_m: Floats
    specific_force_x_m_s2: Floats
    specific_force_y_m_s2: Floats
    speed_x_m_s: Floats
    yaw_rate_rad_s: Floats

    @classmethod
    def from_motion(cls, motion: Channels) -> Self:
        """Signals of ideal instruments for a motion."""
        return cls(*(getattr(motion, name) for name in cls._fields))


def compute_sensor_noise_stds(scenario: Scenario) -> MeasuredSignals:
    """Noise standard deviation of one sample of each signal; force and torque by (17) and (18)."""
    sensors = scenario.sensors
    values = (
        sensors.force_noise_N,
        sensors.force_noise_N * scenario.machine.track_width_m / 2.0,
        sensors.acc_noise_m_s2,
        sensors.acc_noise_m_s2,
        sensors.speed_noise_m_s,
        sensors.gyro_noise_rad_s,
    )
    return MeasuredSignals(*(np.array(value) for value in values))


def compute_true_planar_parameters(body: RigidBody) -> Floats:
    """True values (6,) of `planar_rows.PARAMETERS` for a body."""
    return np.array(
        [
            body.mass_kg,
            body.inertia_z_kg_m2,
            body.first_moment_x_kg_m,
            body.first_moment_y_kg_m,
            body.friction_x_N_s_m,
            body.friction_z_N_m_s,
        ]
    )


@dataclass(frozen=True)
class Filters:
    """Moving mean of `samples` and its central difference, as the fit of a window applies them."""

    samples: int
    rate_hz: float

    @property
    def margin_samples_of_filters(self) -> int:
        """Total number of samples that the filters need before and after a window."""
        return self.samples + 1

    @property
    def moving_mean_weights(self) -> Floats:
        """Weights (samples + 2,) of the moving mean, padded to the length of `difference`."""
        return np.r_[0.0, np.full(self.samples, 1.0 / self.samples), 0.0]

    @property
    def central_difference_weights(self) -> Floats:
        """Weights (samples + 2,) of the central difference of moving means."""
        ones = np.full(self.samples, 1.0 / self.samples)
        return (np.r_[0.0, 0.0, ones] - np.r_[ones, 0.0, 0.0]) * self.rate_hz / 2.0

    def compute_filtered_regressor_and_forces(
        self, raw_channels: MeasuredSignals
    ) -> tuple[Floats, Floats]:
        """Filtered regressor of all six parameters from raw channels of n + margin samples.

        Returns:
            (n, 2, 6) regressor and (n, 2) force and torque.
        """
        force, torque, s_x, s_y, speed, yaw_rate = (
            filter_channel_without_ends(each, self.moving_mean_weights) for each in raw_channels
        )
        turn = filter_channel_without_ends(
            raw_channels.yaw_rate_rad_s, self.central_difference_weights
        )
        return planar_rows.make_planar_regressor(s_x, s_y, speed, yaw_rate, turn), np.stack(
            [force, torque], -1
        )


def filter_channel_without_ends(channel: Floats, weights: Floats) -> Floats:
    """Apply filter weights to a raw channel; returns (n - weights + 1,), without its ends."""
    return np.convolve(channel, weights[::-1], "valid")


def make_whitened_window_system(
    motion_kind: Drive, filters: Filters, raw_channels: MeasuredSignals, noise: MeasuredSignals
) -> tuple[Floats, Floats]:
    """Regressor (rows, p) and right-hand side (rows,) of a window, divided by the noise.

    Args:
        motion_kind: axes that are fitted, which select rows and columns.
        filters: moving mean and difference applied to every channel.
        raw_channels: the channels, true or noisy.
        noise: noise of one sample; only that of force and torque is used.
    """
    A, y = filters.compute_filtered_regressor_and_forces(raw_channels)
    rows, weights = _ROWS[motion_kind], compute_reciprocal_row_noise_stds(motion_kind, noise)
    part = A[:, rows][:, :, COLUMNS[motion_kind]] * weights[:, None]
    return part.reshape(-1, part.shape[-1]), (y[:, rows] * weights).ravel()


def compute_reciprocal_row_noise_stds(motion_kind: Drive, noise: MeasuredSignals) -> Floats:
    """Reciprocal noise (rows,) of force and torque; 1 if they have none."""
    each = np.array([float(noise.force_x_N), float(noise.torque_z_N_m)])
    return 1.0 / np.where(each > 0.0, each, 1.0)[_ROWS[motion_kind]]


@dataclass(frozen=True)
class ErrorPrediction:
    """Predicted error of one estimated quantity.

    Attributes:
        value: the true value.
        variance_per_force: variance per N² of variance of the force; the torque's noise scales with
            the force's.
        variance_rest: variance by all other noise.
        bias: systematic error.
        force_N: noise standard deviation of one sample of the force.
    """

    value: float
    variance_per_force: float
    variance_rest: float
    bias: float
    force_N: float

    @property
    def predicted_error_std(self) -> float:
        """Predicted standard deviation of the error."""
        return float(np.sqrt(self.variance_per_force * self.force_N**2 + self.variance_rest))

    @property
    def predicted_rms_error(self) -> float:
        """Predicted r.m.s. error, from standard deviation and bias."""
        return float(np.hypot(self.predicted_error_std, self.bias))

    def compute_allowed_force_noise_std_newtons(self, error: float) -> float | None:
        """Force noise in N at which the r.m.s. error is `error`; None if there is none."""
        left = error**2 - self.bias**2 - self.variance_rest
        return float(np.sqrt(left / self.variance_per_force)) if left > 0.0 else None


def predict_estimate_errors_of_drive(
    motion_kind: Drive,
    filters: Filters,
    truth: MeasuredSignals,
    body: RigidBody,
    noise: MeasuredSignals,
) -> dict[str, ErrorPrediction]:
    """Predict the errors of the mass, the yaw inertia and the centre of mass that a drive fits.

    Args:
        motion_kind: axes whose equations are fitted.
        filters: filters applied to every channel.
        truth: (n + margin,) noise-free channels of the window.
        body: the machine.
        noise: noise of one sample of each channel; that of the force must not be 0.

    Returns:
        Predictions by name: `mass_kg`, `inertia_z_kg_m2`, `com_x_m`.
    """
    columns, rows = COLUMNS[motion_kind], _ROWS[motion_kind]
    A, y = make_whitened_window_system(motion_kind, filters, truth, noise)
    # noise in the regressor adds E[NᵀN] to AᵀA
    gram = A.T @ A + np.diag(
        compute_expected_regressor_noise_squares(motion_kind, filters, truth, noise)
    )
    inverse = np.linalg.solve(gram, A.T)
    theta = compute_true_planar_parameters(body)[columns]
    bias = inverse @ y - theta
    phi = np.zeros(len(planar_rows.PARAMETERS))
    phi[columns] = theta
    full = filters.compute_filtered_regressor_and_forces(truth)[0]
    predictions: dict[str, ErrorPrediction] = {}
    for name, (value, gradient) in compute_true_quantities_and_gradients(body).items():
        if set(np.flatnonzero(gradient)) <= set(columns):
            weight = (gradient[columns] @ inverse).reshape(
                -1, len(rows)
            ) * compute_reciprocal_row_noise_stds(motion_kind, noise)
            both = np.zeros((weight.shape[0], 2))
            both[:, rows] = weight
            shares = predict_error_variances_by_force_and_motion_noise(
                filters, both, phi, full, noise
            )
            predictions[name] = ErrorPrediction(
                value=value,
                variance_per_force=shares[0] / float(noise.force_x_N) ** 2,
                variance_rest=shares[1],
                bias=float(gradient[columns] @ bias),
                force_N=float(noise.force_x_N),
            )
    return predictions


def compute_true_quantities_and_gradients(body: RigidBody) -> dict[str, tuple[float, Floats]]:
    """True value of each quantity, and its gradient in `planar_rows.PARAMETERS`."""
    mass = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    inertia = np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0])
    com_x = np.array([-body.com_x_m, 0.0, 1.0, 0.0, 0.0, 0.0]) / body.mass_kg
    return {
        "mass_kg": (body.mass_kg, mass),
        "inertia_z_kg_m2": (body.inertia_z_kg_m2, inertia),
        "com_x_m": (body.com_x_m, com_x),
    }


def predict_error_variances_by_force_and_motion_noise(
    filters: Filters,
    error_weights: Floats,
    true_parameters: Floats,
    regressor: Floats,
    noise: MeasuredSignals,
) -> tuple[float, float]:
    """Variance of an error Σ weights (n, 2) · rows by force and torque, and by other channels."""
    m, inertia, mc_x, mc_y, b_x, b_psi = true_parameters
    w_x, w_z = error_weights.T
    omega = regressor[:, 1, planar_rows.PARAMETERS.index("friction_z_N_m_s")]
    through_mean = MeasuredSignals(
        force_x_N=w_x,
        torque_z_N_m=w_z,
        specific_force_x_m_s2=-m * w_x + mc_y * w_z,
        specific_force_y_m_s2=-mc_x * w_z,
        speed_x_m_s=-b_x * w_x,
        yaw_rate_rad_s=2.0 * omega * mc_x * w_x - b_psi * w_z,
    )
    weights = [np.convolve(each, filters.moving_mean_weights) for each in through_mean]
    weights[-1] = weights[-1] + np.convolve(
        mc_y * w_x - inertia * w_z, filters.central_difference_weights
    )
    variances = [
        float(std) ** 2 * float(each @ each) for std, each in zip(noise, weights, strict=True)
    ]
    return sum(variances[:2]), sum(variances[2:])


def compute_expected_regressor_noise_squares(
    motion_kind: Drive, filters: Filters, truth: MeasuredSignals, noise: MeasuredSignals
) -> Floats:
    """Diagonal (p,) of E[NᵀN] over a window; mean and central difference are uncorrelated."""
    mean, difference = (
        float(each @ each)
        for each in (filters.moving_mean_weights, filters.central_difference_weights)
    )
    s_x, s_y, speed, yaw_rate = (float(each) ** 2 * mean for each in noise[2:])
    turn = float(noise.yaw_rate_rad_s) ** 2 * difference
    A, _ = filters.compute_filtered_regressor_and_forces(truth)
    samples = A.shape[0]
    omega = A[:, 1, planar_rows.PARAMETERS.index("friction_z_N_m_s")]
    square = 4.0 * float(omega @ omega) / samples * yaw_rate
    each = np.array([[s_x, 0.0, square, turn, speed, 0.0], [0.0, turn, s_y, s_x, 0.0, yaw_rate]])
    rows = _ROWS[motion_kind]
    weighted = each[rows] * compute_reciprocal_row_noise_stds(motion_kind, noise)[:, None] ** 2
    return samples * weighted.sum(0)[COLUMNS[motion_kind]]


def predict_noise_scaled_condition_number(
    motion_kind: Drive, filters: Filters, truth: MeasuredSignals, noise: MeasuredSignals
) -> float:
    """Condition number of AᵀA after each column is divided by its noise."""
    A, _ = make_whitened_window_system(motion_kind, filters, truth, noise)
    inside = np.sqrt(compute_expected_regressor_noise_squares(motion_kind, filters, truth, noise))
    if not (inside > 0.0).all():
        inside = np.linalg.norm(A, axis=0)
    return float(np.linalg.cond(A / inside)) ** 2
