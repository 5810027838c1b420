"""The regressor (5) of a rigid body: [τ; f] = A φ for all 10 inertial and 6 friction parameters.

The equations are (4) about the origin of the body frame, in body axes, with three repairs.

- (3) prints m S(ω)ᵀ v in its bottom row; Newton-Euler has m S(ω) v, which (2) then cancels.
- (4) counts gravity among the measured forces, though no sensor measures it and it holds m. Here
  it moves to the right: d̈ becomes d̈ - g, the raw specific force of an accelerometer at the origin.
- (5) has 16 columns and names 13 parameters: the first moments m·c are missing from its vector.
"""

import numpy as np

from estimators.arrays import Floats

#: φ of (5), a name a column. Moments are about the body frame's origin; inertia_xy is I12 of the
#: inertia matrix itself (the negative of the product of inertia).
PARAMETERS = (
    "mass_kg",
    "first_moment_x_kg_m",
    "first_moment_y_kg_m",
    "first_moment_z_kg_m",
    "inertia_xx_kg_m2",
    "inertia_xy_kg_m2",
    "inertia_xz_kg_m2",
    "inertia_yy_kg_m2",
    "inertia_yz_kg_m2",
    "inertia_z_kg_m2",
    "friction_x_N_m_s",
    "friction_y_N_m_s",
    "friction_z_N_m_s",
    "friction_x_N_s_m",
    "friction_y_N_s_m",
    "friction_z_N_s_m",
)

#: Names of the rows of A φ: the torque about the origin, then the force.
ROWS = ("torque_x_N_m", "torque_y_N_m", "torque_z_N_m", "force_x_N", "force_y_N", "force_z_N")


def make_skew_matrix(vector: Floats) -> Floats:
    """S of the paper: S(a) b = a × b. (..., 3) to (..., 3, 3)."""
    x, y, z = np.moveaxis(vector, -1, 0)
    zero = np.zeros_like(x)
    rows = [(zero, -z, y), (z, zero, -x), (-y, x, zero)]
    return np.stack([np.stack(row, -1) for row in rows], -2)


def make_inertia_operator(vector: Floats) -> Floats:
    """L of the paper: L(a) [I11 I12 I13 I22 I23 I33]ᵀ = I a. (..., 3) to (..., 3, 6)."""
    x, y, z = np.moveaxis(vector, -1, 0)
    zero = np.zeros_like(x)
    rows = [
        (x, y, z, zero, zero, zero),
        (zero, x, zero, y, z, zero),
        (zero, zero, x, zero, y, z),
    ]
    return np.stack([np.stack(row, -1) for row in rows], -2)


def make_diagonal_matrix(vector: Floats) -> Floats:
    """D of the paper: the matrix that multiplies entry by entry. (..., 3) to (..., 3, 3)."""
    return vector[..., :, None] * np.eye(3)


def make_rigid_body_regressor(
    angular_velocity: Floats,
    angular_acceleration: Floats,
    velocity: Floats,
    specific_force: Floats,
) -> Floats:
    """Matrix A of (5); its product with `PARAMETERS` is the spatial force named by `ROWS`.

    Args:
        angular_velocity: (n, 3) ω in rad/s.
        angular_acceleration: (n, 3) ω̇ in rad/s².
        velocity: (n, 3) v at the origin in m/s.
        specific_force: (n, 3) d̈ - g at the origin in m/s²: (0, 0, 9.81) at rest on level ground.

    Returns:
        (n, 6, 16). A single block is never invertible; stack those of a motion.
    """
    spin = make_skew_matrix(angular_velocity)
    A = np.zeros((*angular_velocity.shape[:-1], len(ROWS), len(PARAMETERS)))
    torque, force = A[..., :3, :], A[..., 3:, :]
    torque[..., 1:4] = -make_skew_matrix(specific_force)
    torque[..., 4:10] = make_inertia_operator(angular_acceleration) + spin @ make_inertia_operator(
        angular_velocity
    )
    torque[..., 10:13] = make_diagonal_matrix(angular_velocity)
    force[..., 0] = specific_force
    force[..., 1:4] = make_skew_matrix(angular_acceleration) + spin @ spin
    force[..., 13:16] = make_diagonal_matrix(velocity)
    return A
