"""A squat that the pitch shows, told from hills that are started on at the same places."""

import numpy as np
import pytest
from scipy.signal import lfilter

from analysis.weighing.motion_samples import Floats, MotionSamples
from analysis.weighing.pitch_squat import estimate_squat_fraction_and_u

RATE_HZ = 100.0
START_S = 4.0
G_M_S2 = 9.81
PITCH_NOISE_RAD = 0.003
#: Springs of a loader: natural frequency, and damping ratio.
SPRINGS_HZ, DAMPING = 2.2, 0.45


def sprung(aim: Floats) -> Floats:
    """What a body on springs follows of `aim`."""
    turn, step_s = 2.0 * np.pi * SPRINGS_HZ, 1.0 / RATE_HZ
    place = speed = 0.0
    out = np.empty_like(aim)
    for k, goal in enumerate(aim):
        speed += (turn**2 * (goal - place) - 2.0 * DAMPING * turn * speed) * step_s
        place += speed * step_s
        out[k] = place
    return out


def lagged(x: Floats, lag_s: float) -> Floats:
    """What a drive of the first order makes of a throttle."""
    kept = float(np.exp(-1.0 / (RATE_HZ * lag_s)))
    return np.asarray(lfilter([1.0 - kept], [1.0, -kept], x))


def starts(
    squat_1: float, hills_m_s2: float, seed: int, count: int = 60
) -> tuple[Floats, MotionSamples]:
    """The pitch's gravity, and the motion, of starts in turn at two places of a hilly track."""
    dice = np.random.default_rng(seed)
    t_s = np.arange(round(START_S * RATE_HZ)) / RATE_HZ
    parts: list[tuple[Floats, Floats, Floats]] = []
    for number in range(count):
        risen = np.minimum(t_s / dice.uniform(0.2, 0.6), 1.0)
        lag_s, friction_1_s = dice.uniform(0.08, 0.25), dice.uniform(0.2, 0.4)
        throttle = risen**2 * (3.0 - 2.0 * risen)
        driven = lagged(throttle, lag_s) * np.exp(-friction_1_s * t_s)
        a = dice.uniform(0.7, 1.5) * driven
        v = np.cumsum(a) / RATE_HZ
        way_m = np.cumsum(v) / RATE_HZ + 17.0 * (number % 2)
        grade = hills_m_s2 * np.sin(2.0 * np.pi * way_m / 25.0 + 0.7)
        parts.append((a, v, grade + sprung(squat_1 * a)))
    a, v, gravity = (np.concatenate(each) for each in zip(*parts, strict=True))
    seen = gravity + dice.normal(0.0, G_M_S2 * PITCH_NOISE_RAD, a.size)
    measured = a + gravity + dice.normal(0.0, 0.01, a.size)
    force = 4000.0 * (a + gravity - squat_1 * a) + 900.0 * v + dice.normal(0.0, 60.0, a.size)
    number = np.repeat(np.arange(count), t_s.size)
    motion = MotionSamples(
        measured, v, force, number, np.ones(a.size), number, RATE_HZ, measured, measured - seen,
        None, np.linspace(-0.5, 0.5, a.size), np.cumsum(v) / RATE_HZ,
        np.zeros(a.size), 0.0, True, 1.0, 4000.0 * G_M_S2,
    )  # fmt: skip
    return seen, motion


@pytest.mark.parametrize("hills_m_s2", [0.0, 0.15])
@pytest.mark.parametrize("squat_1", [0.02, 0.045])
def test_a_squat_is_found_with_and_without_hills(squat_1: float, hills_m_s2: float) -> None:
    found = [estimate_squat_fraction_and_u(*starts(squat_1, hills_m_s2, seed)) for seed in range(6)]
    shares = np.array([each[0] for each in found if each is not None])
    us = np.array([each[1] for each in found if each is not None])
    assert shares.size == 6
    assert (us >= 0.5 * shares).all()
    assert float(shares.mean()) == pytest.approx(squat_1, abs=0.003)


def test_hills_and_noise_of_the_pitch_are_no_squat() -> None:
    assert not any(
        estimate_squat_fraction_and_u(*starts(0.0, hills, seed))
        for hills in (0.0, 0.15)
        for seed in range(6)
    )


def test_few_starts_tell_none() -> None:
    gravity, motion = starts(0.04, 0.0, 1, count=5)
    assert estimate_squat_fraction_and_u(gravity, motion) is None


def test_few_starts_tell_it_where_the_wheels_show_the_same() -> None:
    gravity, motion = starts(0.04, 0.0, 1, count=5)
    found = estimate_squat_fraction_and_u(gravity, motion, (0.04, 0.005))
    assert found is not None
    assert found[0] == pytest.approx(0.04, abs=0.004)
    assert not estimate_squat_fraction_and_u(gravity, motion, (0.1, 0.005))


def test_wheels_alone_tell_none_where_the_pitch_does_not_follow_the_force() -> None:
    found = [
        estimate_squat_fraction_and_u(*starts(0.0, 0.0, seed, count=4), (0.03, 0.004))
        for seed in range(12)
    ]
    assert sum(each is not None for each in found) <= 1
