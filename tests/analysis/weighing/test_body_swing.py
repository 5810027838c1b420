"""A body that swings on its springs, and an accelerometer above or below its axis."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import StateSpace, lfilter, lsim

from analysis.weighing.body_swing import (
    BodySwing,
    estimate_body_swing,
    fit_body_spring_rates,
    subtract_swing_from_accelerometer,
)
from analysis.weighing.motion_samples import Floats, MotionSamples
from tests.twins import mark_heavy_after

RATE_HZ = 100.0
START_S = 4.0
#: Springs of a loader: natural frequency, and damping ratio; none that the search begins with.
SPRINGS_HZ, DAMPING = 1.75, 0.33
#: What the body pitches by, in rad for each m/s², and what gravity is of that.
SQUAT_S2_M = 0.004
SQUAT_1 = SQUAT_S2_M * 9.81
MASS_KG = 4000.0
#: Gravity's own part of the swing, in s².
BY_GRAVITY_S2 = SQUAT_1 / (2.0 * np.pi * SPRINGS_HZ) ** 2


def swung(a: Floats) -> tuple[Floats, Floats]:
    """The pitch of a body on springs over its squat, and the second derivative."""
    t_s, turn = np.arange(a.size) / RATE_HZ, 2.0 * np.pi * SPRINGS_HZ
    drag = 2.0 * DAMPING * turn
    springs = StateSpace(
        [[0.0, 1.0], [-(turn**2), -drag]], [[0.0], [turn**2]], np.eye(2), [[0.0]] * 2
    )
    states = lsim(springs, a, t_s)[1]
    y, dy = states[:, 0], states[:, 1]
    return y, turn**2 * (a - y) - drag * dy


def starts(
    height_m: float, seed: int, *, count: int = 40, noise: float = 1.0, grades: float = 0.1
) -> MotionSamples:
    """Starts on a slope that differs from one to the next, of a machine whose wheels slip."""
    dice = np.random.default_rng(seed)
    t_s = np.arange(round(START_S * RATE_HZ)) / RATE_HZ
    parts = []
    for _ in range(count):
        throttle = np.clip((t_s - 0.3) / dice.uniform(0.2, 0.6), 0.0, 1.0)
        kept = float(np.exp(-1.0 / (RATE_HZ * dice.uniform(0.08, 0.25))))
        driven = lfilter([1.0 - kept], [1.0, -kept], throttle)
        parts.append(dice.uniform(0.7, 1.5) * driven * np.exp(-dice.uniform(0.2, 0.4) * t_s))
    a = np.concatenate(parts)
    pitch, swing = swung(a)
    number = np.repeat(np.arange(count), t_s.size)
    v = np.concatenate([np.cumsum(each) for each in parts]) / RATE_HZ
    grade = dice.normal(0.0, grades, count)[number]
    measured = a + SQUAT_1 * pitch + grade + height_m * SQUAT_S2_M * swing
    force = MASS_KG * (a + grade) + 900.0 * v
    noises = [dice.normal(0.0, std * noise, a.size) for std in (0.01, 0.004, 60.0)]
    measured, v, force = (x + n for x, n in zip((measured, v, force), noises, strict=True))
    return MotionSamples(
        measured, v, force, number, np.ones(a.size), number, RATE_HZ, measured, None,
        None, np.linspace(-0.5, 0.5, a.size), np.cumsum(v) / RATE_HZ,
        np.zeros(a.size), 0.0, True, 1.0, MASS_KG * 9.81,
    )  # fmt: skip


def swing_of(measured: Floats, motion: MotionSamples) -> BodySwing | None:
    """The swing with the springs that the same motion tells."""
    springs = fit_body_spring_rates(measured, motion)
    return None if springs is None else estimate_body_swing(measured, motion, springs)


@pytest.mark.heavy
@pytest.mark.parametrize("height_m", mark_heavy_after(1, [0.5, 0.25, -0.4]))
def test_wheels_tell_the_lever_arm_and_the_springs(height_m: float) -> None:
    for seed in range(3):
        motion = starts(height_m, seed)
        assert motion.specific_force is not None
        found = swing_of(motion.specific_force, motion)
        assert found is not None
        assert abs(found.lever_s2 - height_m * SQUAT_S2_M + BY_GRAVITY_S2) < 2.0 * found.u_s2
        assert found.frequency_hz == pytest.approx(SPRINGS_HZ, rel=0.12)
        assert found.damping_1 == pytest.approx(DAMPING, abs=0.12)


def test_where_the_pitch_takes_gravity_off_only_the_height_is_left() -> None:
    motion = starts(0.5, 2)
    pitch, _ = swung(motion.acceleration)
    found = swing_of(motion.acceleration - SQUAT_1 * pitch, motion)
    assert found is not None
    assert abs(found.lever_s2 - 0.5 * SQUAT_S2_M) < 2.0 * found.u_s2
    assert found.copy_with_swing_of_squat(SQUAT_1).lever_s2 == pytest.approx(
        found.lever_s2 - BY_GRAVITY_S2, abs=0.2 * BY_GRAVITY_S2
    )


@pytest.mark.heavy
def test_an_accelerometer_where_nothing_swings_has_none() -> None:
    """At the height of a pendulum as quick as the springs, gravity and swing cancel."""
    for seed in range(6):
        motion = starts(BY_GRAVITY_S2 / SQUAT_S2_M, seed)
        assert motion.specific_force is not None
        found = swing_of(motion.specific_force, motion)
        assert found is None or abs(found.lever_s2) < 0.0004


def test_a_slow_grid_and_few_starts_tell_none() -> None:
    few = starts(0.5, 1, count=4)
    slow = replace(starts(0.5, 1), rate_hz=10.0)
    for motion in (few, slow):
        assert motion.specific_force is not None
        assert swing_of(motion.specific_force, motion) is None


def test_taken_off_the_accelerometer_reads_what_the_axis_does() -> None:
    on_axis, above = (starts(height_m, 1, noise=0.0, grades=0.0) for height_m in (0.0, 0.5))
    swing = BodySwing(0.5 * SQUAT_S2_M, 0.0, SPRINGS_HZ, DAMPING)
    assert above.specific_force is not None
    assert on_axis.specific_force is not None
    before = above.specific_force - on_axis.specific_force
    # the springs of the swing are driven by the squat's own gravity as well
    after = subtract_swing_from_accelerometer(above, swing).specific_force - on_axis.specific_force
    assert np.sqrt(np.mean(after**2)) < 0.1 * np.sqrt(np.mean(before**2))
