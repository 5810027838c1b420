"""The rows of (5) that a machine on the ground measures, and the paper's three stages (7)-(9).

Wheels measure two of the six forces: f_x and τ_z. The lateral force f_y is a reaction of the ground
that nothing measures, so it is no row here. Of the 16 parameters these two rows hold six, whatever
the machine does in the plane, and even on a slope, since (5) multiplies none of the others here:

    f_x = s_x m - ω² mc_x - ω̇ mc_y + v b_x
    τ_z = s_y mc_x - s_x mc_y + ω̇ Izz + ω b_ψ

with the specific force s of the origin (s_x = dv/dt, s_y = ω v for wheels that do not slip on level
ground). What each motion lets one tell apart, as rank of these rows:

    straight                        3   m, mc_y, b_x
    spin about the origin           4   mc_x, mc_y, Izz, b_ψ
    spin about a centre 0.2 m ahead 4   mc_y, b_ψ, m - 5 mc_x, Izz - 0.2 mc_x
    one constant arc                2   none by itself
    v and ω both triangular         6   all

The last needs two periods, or one out of step: where dv/dt = k ω̇ throughout, m mixes with mc_y and
the rank is 5. A row for f_y would make the third 5 (with b_y) and the fourth 3; it is not measured.
"""

from dataclasses import dataclass

import numpy as np

from estimators.arrays import Bools, Floats

#: The parameters of the two rows, one name per column, as in `rigid_body.PARAMETERS`. Combinations
#: are expressed by their first parameter, so mass and inertia precede the moments.
PARAMETERS = (
    "mass_kg",
    "inertia_z_kg_m2",
    "first_moment_x_kg_m",
    "first_moment_y_kg_m",
    "friction_x_N_s_m",
    "friction_z_N_m_s",
)

#: The first moments among the parameters, ahead and to the left.
MOMENTS = ("first_moment_x_kg_m", "first_moment_y_kg_m")

#: Names of the two rows.
ROWS = ("force_x_N", "torque_z_N_m")

STRAIGHT_PARAMETERS = ("mass_kg", "friction_x_N_s_m")
SPIN_PARAMETERS = ("inertia_z_kg_m2", "friction_z_N_m_s")
ARC_PARAMETERS = ("first_moment_x_kg_m", "friction_x_N_s_m", "friction_z_N_m_s")


def make_straight_regressor(
    specific_force_x: Floats, speed: Floats, direction: Floats | None = None
) -> Floats:
    """Stage 1, the x row of (7) alone: s_x m + v b_x [+ sign(v) c] = f_x.

    The printed y and z rows set m·a_y and m·a_z to zero; with the accelerometer's 9.81 m/s² in a_z
    they would make the mass wrong.

    Args:
        specific_force_x: (n,) in m/s².
        speed: (n,) v in m/s.
        direction: (n,) sign of v, filtered like the other columns; adds Coulomb friction in N.

    Returns:
        (n, 2) for `STRAIGHT_PARAMETERS`, or (n, 3).
    """
    columns = (
        [specific_force_x, speed] if direction is None else [specific_force_x, speed, direction]
    )
    return np.stack(columns, -1)


def make_spin_regressor(yaw_acceleration: Floats, yaw_rate: Floats) -> Floats:
    """Stage 2, the yaw row of (8) alone: ω̇ Izz + ω b_ψ = τ_z, for a spin about the origin.

    The printed rows 1 and 2 require ω̇ I13 - ω² I23 = 0 and ω̇ I23 + ω² I13 = 0, which is true only
    for I13 = I23 = 0: they describe reactions of the ground, which are not measured.

    Args:
        yaw_acceleration: (n,) ω̇ in rad/s².
        yaw_rate: (n,) ω in rad/s.

    Returns:
        (n, 2) for `SPIN_PARAMETERS`.
    """
    return np.stack([yaw_acceleration, yaw_rate], -1)


def make_arc_regressor(speed: Floats, yaw_rate: Floats) -> Floats:
    """Stage 3, an arc at constant v and ω: f_x = -ω² mc_x + v b_x, τ_z = ω v mc_x + ω b_ψ.

    The printed (9) equates a vector to a scalar and drops d̈ = ω × v, which is not zero on an arc.
    One arc determines none of the three parameters; mc_x requires b_x or b_ψ from earlier stages,
    or a second arc at another v or ω.

    Args:
        speed: (n,) v in m/s.
        yaw_rate: (n,) ω in rad/s.

    Returns:
        (n, 2, 3): `ROWS` for `ARC_PARAMETERS`.
    """
    zero = np.zeros_like(speed)
    force_x = np.stack([-(yaw_rate**2), speed, zero], -1)
    torque_z = np.stack([yaw_rate * speed, zero, yaw_rate], -1)
    return np.stack([force_x, torque_z], -2)


def make_planar_regressor(
    specific_force_x: Floats,
    specific_force_y: Floats,
    speed: Floats,
    yaw_rate: Floats,
    yaw_acceleration: Floats,
) -> Floats:
    """Regressor of all three stages, for any motion in the plane.

    Args:
        specific_force_x: (n,) at the origin, in m/s².
        specific_force_y: (n,) at the origin, in m/s²; ω v for wheels that do not slip.
        speed: (n,) v in m/s.
        yaw_rate: (n,) ω in rad/s.
        yaw_acceleration: (n,) ω̇ in rad/s².

    Returns:
        (n, 2, 6): `ROWS` for `PARAMETERS`.
    """
    zero = np.zeros_like(speed)
    force_x = [specific_force_x, zero, -(yaw_rate**2), -yaw_acceleration, speed, zero]
    torque_z = [zero, yaw_acceleration, specific_force_y, -specific_force_x, zero, yaw_rate]
    return np.stack([np.stack(force_x, -1), np.stack(torque_z, -1)], -2)


@dataclass(frozen=True, slots=True)
class PlanarRegressor:
    """Regressor of a planar motion, built a slice at a time; a shift's would take gigabytes.

    Attributes:
        specific_force_x: (n,) samples; this and the others are as in `make_planar_regressor`.
    """

    specific_force_x: Floats
    specific_force_y: Floats
    speed: Floats
    yaw_rate: Floats
    yaw_acceleration: Floats

    @property
    def _channels(self) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        return (
            self.specific_force_x,
            self.specific_force_y,
            self.speed,
            self.yaw_rate,
            self.yaw_acceleration,
        )

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape (n, 2, 6) of the regressor."""
        return self.speed.size, len(ROWS), len(PARAMETERS)

    def __getitem__(self, part: slice) -> Floats:
        """Regressor of a slice of samples, (m, 2, 6)."""
        return make_planar_regressor(*(x[part] for x in self._channels))

    def slice_samples(self, sample_slice: slice) -> "PlanarRegressor":
        """Slice of the samples, sharing their memory."""
        return PlanarRegressor(*(x[sample_slice] for x in self._channels))

    def mark_complete_samples(self) -> Bools:
        """(n,) whether every channel of a sample is known."""
        return np.logical_and.reduce([np.isfinite(x) for x in self._channels])


def compute_column_noise_rms(
    yaw_rate_rms: float,
    specific_force_x: float,
    specific_force_y: float,
    speed: float,
    yaw_rate: float,
    yaw_acceleration: float,
) -> Floats:
    """R.m.s. noise of each regressor column, in the force row and in the yaw torque row.

    Args:
        yaw_rate_rms: r.m.s. of the yaw rate itself, in rad/s.
        specific_force_x: r.m.s. noise after smoothing, in m/s².
        specific_force_y: r.m.s. noise after smoothing, in m/s²; about v times that of ω where no
            accelerometer measures it.
        speed: r.m.s. noise after smoothing, in m/s.
        yaw_rate: r.m.s. noise after smoothing, in rad/s.
        yaw_acceleration: r.m.s. noise after smoothing, in rad/s².

    Returns:
        (2, 6): rows force and yaw torque, columns in the order of `PARAMETERS`; 0 where a column is
        not in the row. For `base_parameters.fit`.
    """
    omega_squared = 2.0 * yaw_rate_rms * yaw_rate
    force_x = [specific_force_x, 0.0, omega_squared, yaw_acceleration, speed, 0.0]
    torque_z = [0.0, yaw_acceleration, specific_force_y, specific_force_x, 0.0, yaw_rate]
    return np.array([force_x, torque_z])
