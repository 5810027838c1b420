"""Force (17), yaw torque (18) and what multiplies the mass."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.model.machine_body import Body
from analysis.model.schema import build_frame
from analysis.stages.motion.forces import (
    compute_excitation,
    compute_longitudinal_force,
    compute_regressor_acceleration,
    compute_yaw_torque,
)

G = 9.80665
torques = st.lists(st.floats(-5000, 5000), min_size=3, max_size=3)


def smoothed(n=3, **columns):
    base = {"t_ns": np.arange(n) * 10_000_000, "speed_x_m_s": np.zeros(n)}
    return build_frame("aligned", {**base, **columns, "gap": np.zeros(n, bool)})


def body(**known):
    return Body(name="loader", **known)


@given(torques, torques, st.floats(0.1, 1), st.floats(0.1, 1), st.floats(0.5, 3))
def test_wheel_torques_become_force_and_yaw_torque_over_the_share(
    left, right, radius, share, track
):
    frame = smoothed(torque_left_N_m=np.array(left), torque_right_N_m=np.array(right))
    known = body(wheel_radius_m=radius, force_share=share, track_width_m=track)
    force = (np.array(right) + left) / radius / share
    torque = (np.array(right) - left) / radius * track / 2 / share
    np.testing.assert_allclose(
        compute_longitudinal_force(frame, known), force, rtol=1e-9, atol=1e-6
    )
    np.testing.assert_allclose(compute_yaw_torque(frame, known), torque, rtol=1e-9, atol=1e-6)


def test_a_force_that_is_given_is_divided_by_the_share_alone():
    frame = smoothed(force_x_N=np.array([1.0, 2.0, 3.0]), torque_z_N_m=np.array([4.0, 5.0, 6.0]))
    half = body(force_share=0.5)
    np.testing.assert_array_equal(compute_longitudinal_force(frame, half), [2.0, 4.0, 6.0])
    np.testing.assert_array_equal(compute_yaw_torque(frame, half), [8.0, 10.0, 12.0])


@pytest.mark.parametrize(
    "known", [{"wheel_radius_m": 0.4}, {"track_width_m": 1.5}, {}], ids=["track", "radius", "both"]
)
def test_without_the_geometry_there_is_no_yaw_torque(known):
    frame = smoothed(torque_left_N_m=np.ones(3), torque_right_N_m=np.ones(3))
    assert compute_yaw_torque(frame, body(**known)) is None


def test_without_both_sides_there_is_no_yaw_torque():
    frame = smoothed(force_x_N=np.ones(3))
    assert compute_yaw_torque(frame, body(wheel_radius_m=0.4, track_width_m=1.5)) is None


@given(st.floats(-0.5, 0.5))
def test_kinematic_acceleration_gets_the_share_of_gravity_along_the_slope(machine, pitch):
    kinematic = machine({"acceleration": "kinematic"}, acc_x_m_s2={"topic": "/can", "field": "acc"})
    frame = smoothed(acc_x_m_s2=np.full(3, 0.5), pitch_rad=np.full(3, pitch))
    np.testing.assert_allclose(
        compute_regressor_acceleration(frame, kinematic), 0.5 + G * np.sin(pitch), atol=1e-12
    )
    flat = smoothed(acc_x_m_s2=np.full(3, 0.5))
    np.testing.assert_array_equal(compute_regressor_acceleration(flat, kinematic), 0.5)


def test_specific_force_has_gravity_already(machine):
    frame = smoothed(specific_force_x_m_s2=np.full(3, 0.85), pitch_rad=np.full(3, 0.087))
    np.testing.assert_array_equal(compute_regressor_acceleration(frame, machine()), 0.85)


def test_the_excitation_of_a_drive_weighs_it(drive, excitation_of):
    """Full circle: a noise-free drive up a slope gives mass and friction back by lstsq."""
    made = drive(noise=0.0, pitch_rad=0.05)
    moving = excitation_of(made).drop_nulls("phase").filter(phase="accelerating")
    A = moving.select("regressor_acc_x_m_s2", "speed_x_m_s").to_numpy()
    theta = np.linalg.lstsq(A, moving["force_x_N"].to_numpy())[0]
    np.testing.assert_allclose(theta, [made.mass_kg, made.friction_N_s_m], rtol=1e-9)


def test_excitation_keeps_the_time_and_length_and_carries_no_gap_column(machine):
    frame = smoothed(
        20, force_x_N=np.ones(20), specific_force_x_m_s2=np.ones(20), direction_x_1=np.ones(20)
    )
    made = compute_excitation(frame, machine())
    assert made["t_ns"].equals(frame["t_ns"])
    assert "gap" not in made.columns
    assert {"force_x_N", "regressor_acc_x_m_s2", "speed_rate_x_m_s2", "phase"} <= set(made.columns)
    assert "torque_z_N_m" not in made.columns
