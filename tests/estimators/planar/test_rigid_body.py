"""The regressor (5) against two independent forms of Newton-Euler; (3) as printed fails."""

import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from estimators.planar import rigid_body
from estimators.planar.rigid_body import (
    PARAMETERS,
    make_diagonal_matrix,
    make_inertia_operator,
    make_rigid_body_regressor,
    make_skew_matrix,
)

vectors = arrays(np.float64, (4, 3), elements=st.floats(-1e3, 1e3))
UPPER = ([0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2])
GRAVITY_M_S2 = np.array([0.0, 0.0, -9.81])


def random_bodies_in_motion(n, seed=0):
    """n bodies with a centre of mass off the origin, attitudes R and motions, in body axes."""
    rng = np.random.default_rng(seed)
    R = np.linalg.qr(rng.normal(size=(n, 3, 3)))[0]
    R[np.linalg.det(R) < 0, :, 0] *= -1
    spread = rng.normal(size=(n, 3, 3))
    mass = rng.uniform(1.0, 5000.0, n)
    return {
        "mass": mass,
        "com": rng.normal(size=(n, 3)),
        # Σ r rᵀ of a real body, so that the inertia obeys the triangle inequalities
        "inertia_at_com": mass[:, None, None]
        * (
            np.trace(spread @ spread.mT, axis1=1, axis2=2)[:, None, None] * np.eye(3)
            - spread @ spread.mT
        ),
        "friction_turning": rng.uniform(0.0, 3000.0, (n, 3)),
        "friction_moving": rng.uniform(0.0, 3000.0, (n, 3)),
        "R": R,
        "omega": rng.normal(size=(n, 3)),
        "omega_dot": rng.normal(size=(n, 3)),
        "velocity": rng.normal(size=(n, 3)),
        "acceleration": rng.normal(size=(n, 3)),
    }


def spatial_newton_euler(body, i, printed=False):
    """(1) for body i by spatial algebra (Featherstone), friction added, gravity taken off.

    `printed` has the bottom row of (3) as the paper prints it.
    """
    m, c = body["mass"][i], body["com"][i]
    omega, v = body["omega"][i], body["velocity"][i]
    d_ddot = body["acceleration"][i]
    cx = np.array([[0, -c[2], c[1]], [c[2], 0, -c[0]], [-c[1], c[0], 0]])
    inertia = body["inertia_at_com"][i] + m * cx @ cx.T
    spatial_inertia = np.block([[inertia, m * cx], [m * cx.T, m * np.eye(3)]])
    acceleration = np.concatenate([body["omega_dot"][i], d_ddot - np.cross(omega, v)])
    momentum = spatial_inertia @ np.concatenate([omega, v])
    bias = np.concatenate(
        [np.cross(omega, momentum[:3]) + np.cross(v, momentum[3:]), np.cross(omega, momentum[3:])]
    )
    if printed:
        bias[3:] += -2.0 * m * np.cross(omega, v)
    weight = m * body["R"][i].T @ GRAVITY_M_S2
    friction = np.concatenate([body["friction_turning"][i] * omega, body["friction_moving"][i] * v])
    return (
        spatial_inertia @ acceleration
        + bias
        + friction
        - np.concatenate([np.cross(c, weight), weight])
    )


def regressor_and_parameters(body):
    m, c = body["mass"], body["com"]
    off = np.einsum("ni,ni->n", c, c)[:, None, None] * np.eye(3) - np.einsum("ni,nj->nij", c, c)
    inertia = body["inertia_at_com"] + m[:, None, None] * off
    phi = np.column_stack(
        [
            m,
            m[:, None] * c,
            inertia[:, *UPPER],
            body["friction_turning"],
            body["friction_moving"],
        ]
    )
    specific_force = body["acceleration"] - np.einsum("nji,j->ni", body["R"], GRAVITY_M_S2)
    A = make_rigid_body_regressor(
        body["omega"], body["omega_dot"], body["velocity"], specific_force
    )
    return A, phi


def relative_errors(found, expected):
    """Of torque and of force, so that neither hides behind the other."""
    return [
        np.linalg.norm(found[:, part] - expected[:, part], axis=1)
        / np.linalg.norm(expected[:, part], axis=1)
        for part in (slice(0, 3), slice(3, 6))
    ]


def test_the_regressor_is_newton_euler_by_spatial_algebra_to_12_digits_on_1000_random_states():
    body = random_bodies_in_motion(1000)
    A, phi = regressor_and_parameters(body)
    expected = np.stack([spatial_newton_euler(body, i) for i in range(1000)])
    for error in relative_errors(np.einsum("nij,nj->ni", A, phi), expected):
        assert error.max() <= 1e-12


def test_the_bottom_row_of_3_as_printed_is_wrong_by_twice_m_omega_cross_v():
    body = random_bodies_in_motion(1000)
    A, phi = regressor_and_parameters(body)
    found = np.einsum("nij,nj->ni", A, phi)
    printed = np.stack([spatial_newton_euler(body, i, printed=True) for i in range(1000)])
    torque_error, force_error = relative_errors(found, printed)
    assert torque_error.max() <= 1e-12
    assert np.median(force_error) > 0.1
    assert force_error.max() > 1.0
    np.testing.assert_allclose(
        found[:, 3:] - printed[:, 3:],
        2.0 * body["mass"][:, None] * np.cross(body["omega"], body["velocity"]),
        rtol=1e-9,
        atol=1e-9,
    )


@pytest.mark.skipif(sys.platform == "win32", reason="pinocchio has no wheels for Windows")
def test_the_regressor_is_pinocchios_inverse_dynamics_of_a_free_flyer_to_12_digits():
    import pinocchio as pin

    body = random_bodies_in_motion(1000, seed=1)
    body["friction_turning"][:] = body["friction_moving"][:] = 0.0
    A, phi = regressor_and_parameters(body)
    expected = np.empty((1000, 6))
    columns = np.empty((1000, 6, 10))
    for i in range(1000):
        model = pin.Model()
        joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
        inertia = pin.Inertia(body["mass"][i], body["com"][i], body["inertia_at_com"][i])
        model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
        model.gravity.linear = GRAVITY_M_S2
        data = model.createData()
        q = np.concatenate([np.zeros(3), pin.Quaternion(body["R"][i]).coeffs()])
        omega, v = body["omega"][i], body["velocity"][i]
        v_dot = body["acceleration"][i] - np.cross(omega, v)
        motion = q, np.concatenate([v, omega]), np.concatenate([v_dot, body["omega_dot"][i]])
        expected[i] = np.roll(pin.rnea(model, data, *motion), 3)
        columns[i] = np.roll(pin.computeJointTorqueRegressor(model, data, *motion), 3, axis=0)
    for error in relative_errors(np.einsum("nij,nj->ni", A, phi), expected):
        assert error.max() <= 1e-12
    # pinocchio orders the inertia as xx xy yy xz yz zz
    np.testing.assert_allclose(A[:, :, [0, 1, 2, 3, 4, 5, 7, 6, 8, 9]], columns, atol=1e-12)


def test_a_body_at_rest_weighs_its_mass_times_gravity_and_turns_about_its_centre():
    A = make_rigid_body_regressor(
        *np.zeros((3, 1, 3)), specific_force=np.array([[0.0, 0.0, 9.81]])
    )[0]
    at = {name: i for i, name in enumerate(PARAMETERS)}
    phi = np.zeros(16)
    phi[at["mass_kg"]] = 3614.0
    phi[at["first_moment_x_kg_m"]] = 500.0
    force = dict(zip(rigid_body.ROWS, A @ phi, strict=True))
    assert force["force_z_N"] == pytest.approx(3614.0 * 9.81)
    assert force["torque_y_N_m"] == pytest.approx(-500.0 * 9.81)
    assert force["force_x_N"] == force["force_y_N"] == 0.0


@given(vectors, vectors)
def test_s_is_the_cross_product_and_d_the_product_entry_by_entry(a, b):
    atol = 1e-9
    np.testing.assert_allclose(
        np.einsum("nij,nj->ni", make_skew_matrix(a), b), np.cross(a, b), atol=atol
    )
    np.testing.assert_allclose(np.einsum("nij,nj->ni", make_diagonal_matrix(a), b), a * b)


@given(vectors, arrays(np.float64, (3, 3), elements=st.floats(-1e3, 1e3)))
def test_l_times_the_six_inertias_is_the_inertia_matrix_times_the_vector(a, half):
    inertia = half + half.T
    found = make_inertia_operator(a) @ inertia[UPPER]
    np.testing.assert_allclose(found, a @ inertia, atol=1e-6)


@given(vectors)
def test_one_instant_never_determines_the_sixteen(a):
    blocks = make_rigid_body_regressor(a, a[::-1], a + 1.0, a - 1.0)
    assert (np.linalg.matrix_rank(blocks) <= 6).all()
