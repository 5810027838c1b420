"""The IMU's mounting as gravity and starts tell it."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from analysis.model.machine_body import ImuMounting
from analysis.model.schema import build_frame
from analysis.stages.signals.mounting import compute_rotation_to_machine_axes
from analysis.stages.signals.mounting_guess import estimate_gravity_tilt_deg, estimate_imu_mounting
from tests.analysis import phased

G = 9.80665
AXES = ("specific_force_x_m_s2", "specific_force_y_m_s2", "specific_force_z_m_s2")
#: Whole steps of 5°, any of which may be upright, upside down or a permutation of axes.
fives = st.integers(-35, 36).map(lambda steps: 5.0 * steps)


def said(imu, noise=0.05, seed=1, slope_deg=0.0, still=True):
    """What an IMU that sits so and the wheels say of nine starts."""
    t_ns, acc = phased.sampled("imu", 100.0, noise=0.0)
    speed = phased.sampled("speed", 50.0, phase_s=0.004, seed=seed)
    slope = np.deg2rad(slope_deg)
    moved = np.stack([acc + G * np.sin(slope), 0 * acc, 0 * acc + G * np.cos(slope)], axis=1)
    seen = moved @ compute_rotation_to_machine_axes(imu)
    seen = seen + noise * np.random.default_rng(seed).normal(size=seen.shape)
    if not still:
        v = np.interp(t_ns - t_ns[0], speed[0] - t_ns[0], speed[1])
        moving = np.abs(v) > 0.2
        t_ns, seen = t_ns[moving], seen[moving]
        speed = speed[0][np.abs(speed[1]) > 0.2], speed[1][np.abs(speed[1]) > 0.2]
    return t_ns, seen, speed


def angle_deg(A, B):
    """Between two attitudes."""
    return np.degrees(np.arccos(np.clip((np.trace(A.T @ B) - 1) / 2, -1, 1)))


def sits(guess):
    return ImuMounting(
        roll_deg=guess.roll_deg, pitch_deg=guess.pitch_deg, yaw_deg=guess.yaw_deg or 0.0
    )


@pytest.mark.heavy
@given(fives, fives, fives)
@example(90.0, 0.0, 0.0)  # gravity on +y
@example(0.0, 90.0, 0.0)
@example(0.0, -90.0, 135.0)
@example(180.0, 0.0, 0.0)
@example(90.0, 85.0, 40.0)
def test_any_mounting_is_found_from_nine_starts(roll, pitch, yaw):
    imu = ImuMounting(roll_deg=roll, pitch_deg=pitch, yaw_deg=yaw)
    guess = estimate_imu_mounting(*said(imu))
    assert guess is not None
    assert guess.stood
    assert guess.yaw_deg is not None
    assert guess.yaw_std_deg < 1.0
    assert (
        angle_deg(
            compute_rotation_to_machine_axes(sits(guess)), compute_rotation_to_machine_axes(imu)
        )
        < 1.0
    )
    tilt = np.degrees(np.arccos(np.clip(compute_rotation_to_machine_axes(imu)[2, 2], -1, 1)))
    assert guess.tilt_deg == pytest.approx(tilt, abs=0.5)
    if abs(tilt - 10.0) > 1.0:
        assert guess.is_tilt_beyond_ground_slope == (tilt > 10.0)


@pytest.mark.parametrize("slope_deg", [-2.0, 2.0])
def test_a_place_that_slopes_a_little_changes_no_angle(slope_deg):
    for imu in (ImuMounting(), ImuMounting(roll_deg=90.0, yaw_deg=-90.0)):
        guess = estimate_imu_mounting(*said(imu, slope_deg=slope_deg))
        assert guess is not None
        assert (
            angle_deg(
                compute_rotation_to_machine_axes(sits(guess)), compute_rotation_to_machine_axes(imu)
            )
            < 1.0
        )


def test_a_level_imu_is_level():
    guess = estimate_imu_mounting(*said(ImuMounting()))
    assert guess is not None
    assert guess.has_no_rotation
    assert not guess.is_tilt_beyond_ground_slope


def test_without_a_standstill_the_mean_of_the_drive_tells_roll_and_pitch():
    t_ns, seen, speed = said(ImuMounting(roll_deg=90.0), still=False)
    guess = estimate_imu_mounting(t_ns, seen, speed)
    assert guess is not None
    assert not guess.stood
    assert (guess.roll_deg, guess.pitch_deg) == (90.0, 0.0)


def test_without_wheels_there_is_no_yaw():
    t_ns, seen, _ = said(ImuMounting(roll_deg=90.0, yaw_deg=90.0))
    guess = estimate_imu_mounting(t_ns, seen, None)
    assert guess is not None
    assert guess.yaw_deg is None
    assert np.isnan(guess.yaw_std_deg)


def test_an_imu_that_does_not_show_the_motion_tells_no_yaw():
    t_ns, seen, speed = said(ImuMounting(), noise=0.0)
    noise = np.random.default_rng(1).normal(size=seen.shape)
    guess = estimate_imu_mounting(t_ns, np.array([0, 0, G]) + noise, speed)
    assert guess is not None
    assert guess.yaw_deg is None


@pytest.mark.parametrize("share", [0.0, 0.102, 0.9, 1.1])
def test_what_is_no_gravity_gives_no_guess(share):
    t_ns, seen, speed = said(ImuMounting())
    assert estimate_imu_mounting(t_ns, seen * share, speed) is None


def test_a_machine_that_never_moves_tells_roll_and_pitch():
    t_ns, seen, speed = said(ImuMounting(roll_deg=90.0))
    still = np.tile([0.0, G, 0.0], (t_ns.size, 1))
    guess = estimate_imu_mounting(t_ns, still, (speed[0], 0 * speed[1]))
    assert guess is not None
    assert guess.stood
    assert (guess.roll_deg, guess.pitch_deg, guess.yaw_deg) == (90.0, 0.0, None)
    assert seen.shape == still.shape


def aligned(force, speed, gap=False):
    n = len(speed)
    columns = dict(zip(AXES, np.asarray(force, float).T, strict=False))
    return build_frame(
        "aligned",
        {
            "t_ns": np.arange(n) * 10_000_000,
            "speed_x_m_s": np.asarray(speed, float),
            **columns,
            "gap": np.full(n, gap),
        },
    )


@given(st.floats(0, 180), st.floats(-180, 180))
def test_the_tilt_of_gravity_is_measured_where_the_machine_stands(machine, tilt_deg, heading_deg):
    tilt, heading = np.deg2rad([tilt_deg, heading_deg])
    across = np.sin(tilt) * np.array([np.cos(heading), np.sin(heading)])
    stands = np.tile(G * np.array([*across, np.cos(tilt)]), (100, 1))
    moves = np.tile([5.0, 5.0, 5.0], (100, 1))
    frame = aligned(np.concatenate([stands, moves]), np.repeat([0.0, 1.0], 100))
    assert estimate_gravity_tilt_deg(frame, machine()) == pytest.approx(tilt_deg, abs=1e-5)


def test_of_an_accelerometers_x_alone_the_tilt_is_the_least(machine):
    frame = aligned(np.full((100, 1), G * np.sin(np.deg2rad(3.0))), np.zeros(100))
    assert estimate_gravity_tilt_deg(frame, machine()) == pytest.approx(3.0, abs=1e-3)


@pytest.mark.parametrize(
    "frame",
    [
        aligned(np.zeros((100, 0)), np.zeros(100)),
        aligned(np.ones((100, 2)), np.zeros(100)),
        aligned(np.ones((100, 3)), np.ones(100)),
        aligned(np.ones((100, 3)), np.tile([0.0, 1.0], 50)),
        aligned(np.full((100, 3), np.nan), np.zeros(100)),
    ],
    ids=["no accelerometer", "two axes", "moving", "never for long", "missing"],
)
def test_where_there_is_nothing_to_measure_the_tilt_is_nan(machine, frame):
    assert np.isnan(estimate_gravity_tilt_deg(frame, machine()))
