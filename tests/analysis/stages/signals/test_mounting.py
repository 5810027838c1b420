"""The IMU's axes and place turned into the machine's."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from analysis.model.machine_body import ImuMounting
from analysis.model.settings import AlignSettings
from analysis.stages.signals.mounting import (
    compute_pitch_and_roll,
    compute_rotation_to_machine_axes,
    rotate_imu_to_machine_axes,
    transfer_acceleration_to_origin,
)
from estimators.errors import DataError

AXES = ("specific_force_x_m_s2", "specific_force_y_m_s2", "specific_force_z_m_s2")
RATES = ("roll_rate_rad_s", "pitch_rate_rad_s", "yaw_rate_rad_s")
angles = st.floats(-180, 180)


def columns(names, vectors):
    return dict(zip(names, np.atleast_2d(vectors).T.astype(float), strict=True))


def turned(seen, imu):
    """What `rotate_imu_to_machine_axes` makes of columns that share their stamps."""
    stamps = {name: np.arange(x.size) * 10_000_000 for name, x in seen.items()}
    out = rotate_imu_to_machine_axes(
        {n: (stamps[n], x) for n, x in seen.items()}, imu, AlignSettings()
    )
    assert all(np.array_equal(out[name][0], t) for name, t in stamps.items())
    return {name: x for name, (_, x) in out.items()}


def stacked(out, names):
    return np.stack([out[name] for name in names], axis=1)


@given(angles, angles, angles)
def test_the_rotation_is_proper(roll, pitch, yaw):
    R = compute_rotation_to_machine_axes(ImuMounting(roll_deg=roll, pitch_deg=pitch, yaw_deg=yaw))
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)


@given(angles, angles, angles)
def test_gravity_seen_by_a_tilted_imu_comes_back_upright(roll, pitch, yaw):
    imu = ImuMounting(roll_deg=roll, pitch_deg=pitch, yaw_deg=yaw)
    upright = np.tile([0.0, 0.0, 9.81], (4, 1))
    seen = upright @ compute_rotation_to_machine_axes(imu)
    out = turned(columns(AXES, seen) | columns(RATES, seen), imu)
    # a turn of less than 1e-12 rad counts as none
    np.testing.assert_allclose(stacked(out, AXES), upright, atol=1e-10)
    np.testing.assert_allclose(stacked(out, RATES), upright, atol=1e-10)


@pytest.mark.parametrize(
    ("imu", "seen", "machine"),
    [
        # its x axis to the machine's left
        (ImuMounting(yaw_deg=90), [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]),
        # its nose down, right-handed about y (left)
        (ImuMounting(pitch_deg=90), [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]),
        # upside down
        (ImuMounting(roll_deg=180), [0.0, 0.0, -9.81], [0.0, 0.0, 9.81]),
        # the pitch turns before the yaw carries it round
        (ImuMounting(pitch_deg=90, yaw_deg=90), [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]),
    ],
    ids=["yaw", "pitch", "roll", "order"],
)
def test_angles_turn_right_handed_yaw_then_pitch_then_roll(imu, seen, machine):
    out = turned(columns(AXES, seen), imu)
    np.testing.assert_allclose(stacked(out, AXES)[0], machine, atol=1e-12)


def test_a_level_imu_at_the_origin_changes_nothing():
    given_columns = columns(AXES[:1], [[1.0]]) | {"speed_x_m_s": np.array([2.0])}
    assert turned(given_columns, ImuMounting()) == given_columns


@pytest.mark.parametrize("names", [AXES, RATES])
def test_a_rotated_sensor_needs_all_three_axes(names):
    with pytest.raises(DataError) as error:
        turned({names[0]: np.ones(3)}, ImuMounting(pitch_deg=5))
    assert str(error.value) == (
        "machine.imu is rotated, which needs all three axes; add "
        f"channels.{names[1]}, channels.{names[2]}"
    )


@given(
    st.tuples(st.floats(-3, 3), st.floats(-3, 3)),
    st.floats(-2, 2),
    st.floats(-2, 2),
    st.tuples(st.floats(-3, 3), st.floats(-3, 3)),
)
def test_the_lever_arm_is_taken_off_in_the_plane(position, rate, turn, origin):
    r = np.array([*position, 0.0])
    omega, alpha = np.array([0.0, 0.0, rate]), np.array([0.0, 0.0, turn])
    at_imu = np.array([*origin, 9.81]) + np.cross(alpha, r) + np.cross(omega, np.cross(omega, r))
    seen = columns(AXES, at_imu) | {
        "yaw_rate_rad_s": np.array([rate]),
        "yaw_acc_rad_s2": np.array([turn]),
    }
    out = transfer_acceleration_to_origin(seen, ImuMounting(position_m=tuple(r)))
    np.testing.assert_allclose(stacked(out, AXES)[0], [*origin, 9.81], atol=1e-9)


def test_the_columns_given_are_left_as_they_were():
    seen = columns(AXES, [[1.0, 2.0, 3.0]])
    imu = ImuMounting(yaw_deg=30, position_m=(1.0, 1.0, 0.0))
    turned(seen, imu)
    transfer_acceleration_to_origin(seen, imu)
    assert [x[0] for x in seen.values()] == [1.0, 2.0, 3.0]


@given(*[st.floats(-80, 80)] * 2, st.floats(-180, 180), angles, angles, angles, st.floats(0.1, 10))
def test_the_machines_pitch_and_roll_whatever_its_heading_and_however_its_imu_sits(
    nose_down, roll, heading, imu_roll, imu_pitch, imu_yaw, length
):
    imu = ImuMounting(roll_deg=imu_roll, pitch_deg=imu_pitch, yaw_deg=imu_yaw)
    attitude = Rotation.from_euler("ZYX", [heading, nose_down, roll], degrees=True)
    # from IMU axes to those of the machine, then to the world's
    seen = (
        attitude * Rotation.from_matrix(compute_rotation_to_machine_axes(imu))
    ).as_quat() * length
    found = compute_pitch_and_roll(seen[:, None], imu)
    # REP-103 counts a nose that points down, payscope one that points up
    np.testing.assert_allclose(found["pitch"], np.deg2rad(-nose_down), atol=1e-7)
    np.testing.assert_allclose(found["roll"], np.deg2rad(roll), atol=1e-7)


def test_an_imu_without_an_orientation_gives_no_angle():
    found = compute_pitch_and_roll(np.zeros((4, 2)), ImuMounting())
    assert np.isnan(found["pitch"]).all()
    assert np.isnan(found["roll"]).all()


def test_an_axis_with_stamps_of_its_own_is_interpolated_and_not_extrapolated():
    """Its z axis comes between the others' stamps, and stops half a second before them."""
    t = np.arange(100) * 10_000_000
    late = t[:50] + 4_000_000
    seen = {name: (t, np.ones(100)) for name in RATES[:2]} | {RATES[2]: (late, late * 1e-7)}
    out = rotate_imu_to_machine_axes(seen, ImuMounting(roll_deg=180), AlignSettings())
    stamps, yaw_rate = out[RATES[2]]
    np.testing.assert_array_equal(stamps, t[1:50])
    np.testing.assert_allclose(yaw_rate, -1e-7 * stamps)
    np.testing.assert_array_equal(out[RATES[0]][0], stamps)
