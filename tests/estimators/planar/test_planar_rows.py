"""The rows that wheels measure are rows of (5), and the paper's three stages are parts of them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from estimators.planar import planar_rows, rigid_body
from tests.estimators.motions import MOTIONS, T_S, constant_arc, measured

column = arrays(np.float64, 7, elements=st.floats(-1e3, 1e3))
COLUMNS = [rigid_body.PARAMETERS.index(name) for name in planar_rows.PARAMETERS]
ROWS = [rigid_body.ROWS.index(name) for name in planar_rows.ROWS]


def columns_of(A, names):
    return A[..., [planar_rows.PARAMETERS.index(name) for name in names]]


@pytest.mark.heavy
@given(column, column, column, column, column, column, column)
def test_the_two_rows_are_those_of_the_whole_regressor_which_hold_no_other_parameter(
    force_x, force_y, force_z, v, lateral, omega, omega_dot
):
    zero = np.zeros(7)
    whole = rigid_body.make_rigid_body_regressor(
        np.column_stack([zero, zero, omega]),
        np.column_stack([zero, zero, omega_dot]),
        np.column_stack([v, lateral, zero]),
        np.column_stack([force_x, force_y, force_z]),
    )[:, ROWS]
    np.testing.assert_array_equal(
        planar_rows.make_planar_regressor(force_x, force_y, v, omega, omega_dot),
        whole[..., COLUMNS],
    )
    assert not np.delete(whole, COLUMNS, axis=-1).any()


def test_a_motion_makes_the_regressor_of_any_slice_and_cuts_to_it():
    channels = MOTIONS["joint"]
    whole, motion = (
        planar_rows.make_planar_regressor(**channels),
        planar_rows.PlanarRegressor(**channels),
    )
    assert motion.shape == whole.shape
    np.testing.assert_array_equal(motion[40:90], whole[40:90])
    np.testing.assert_array_equal(motion.slice_samples(slice(40, 90))[10:20], whole[50:60])


def test_stage_1_is_the_x_row_without_yaw():
    motion = MOTIONS["straight"]
    A = planar_rows.make_planar_regressor(**motion)[:, 0]
    expected = columns_of(A, planar_rows.STRAIGHT_PARAMETERS)
    found = planar_rows.make_straight_regressor(motion["specific_force_x"], motion["speed"])
    np.testing.assert_array_equal(found, expected)
    with_coulomb = planar_rows.make_straight_regressor(
        motion["specific_force_x"], motion["speed"], np.sign(motion["speed"])
    )
    np.testing.assert_array_equal(with_coulomb[:, :2], expected)
    np.testing.assert_array_equal(with_coulomb[:, 2], 1.0)


def test_stage_2_is_the_yaw_row_of_a_spin_about_the_origin():
    motion = MOTIONS["spin about the origin"]
    A = planar_rows.make_planar_regressor(**motion)[:, 1]
    found = planar_rows.make_spin_regressor(motion["yaw_acceleration"], motion["yaw_rate"])
    np.testing.assert_array_equal(found, columns_of(A, planar_rows.SPIN_PARAMETERS))
    others = [name for name in planar_rows.PARAMETERS if name not in planar_rows.SPIN_PARAMETERS]
    assert not columns_of(A, others).any()


def test_stage_3_is_both_rows_of_a_constant_arc():
    motion = constant_arc()
    A = planar_rows.make_planar_regressor(**motion)
    found = planar_rows.make_arc_regressor(motion["speed"], motion["yaw_rate"])
    np.testing.assert_allclose(found, columns_of(A, planar_rows.ARC_PARAMETERS))
    others = [name for name in planar_rows.PARAMETERS if name not in planar_rows.ARC_PARAMETERS]
    assert not columns_of(A, others).any()


def test_the_z_row_of_7_as_printed_weighs_a_loader_as_next_to_nothing():
    """(7) sets m·a_z to zero, and an accelerometer reads 9.81 m/s² there."""
    motion = MOTIONS["straight"]
    A = planar_rows.make_straight_regressor(motion["specific_force_x"], motion["speed"])
    f = A @ [3614.0, 2891.0]
    upright = np.column_stack([np.full(T_S.size, 9.81), np.zeros(T_S.size)])
    printed = np.linalg.lstsq(np.concatenate([A, upright]), np.concatenate([f, 0 * f]), rcond=None)[
        0
    ]
    right = np.linalg.lstsq(A, f, rcond=None)[0]
    assert right[0] == pytest.approx(3614.0)
    assert abs(printed[0]) < 100.0


@pytest.mark.parametrize("motion", MOTIONS)
def test_the_noise_of_the_columns_is_what_noise_on_the_channels_makes_of_them(motion):
    sigma = dict(zip(MOTIONS[motion], [0.02, 0.03, 0.005, 0.004, 0.01], strict=True))
    noisy = measured(MOTIONS[motion], sigma, np.random.default_rng(5), mean=1)
    A = planar_rows.make_planar_regressor(**noisy)
    error = A - planar_rows.make_planar_regressor(**MOTIONS[motion])
    expected = np.sqrt(np.mean(error**2, axis=0))
    turning = np.sqrt(np.mean(noisy["yaw_rate"] ** 2))
    # of a machine that does not turn, ω² is noise alone, to second order
    np.testing.assert_allclose(
        planar_rows.compute_column_noise_rms(turning, **sigma), expected, rtol=0.05, atol=0.004**2
    )
