"""A mass on a belt whose motion is measured at the motor is weighed wider, and it is said why."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from scipy.signal import StateSpace, lsim

from analysis.model.machine import Machine
from analysis.model.run_record import Run
from replay import open_log, run
from replay.logs import TimeAxis
from tests.twins import mark_slow_after

MASS_KG = 40.0
RATE_HZ = 1000.0
SWING_HZ = 22.0
DAMPING = 0.04
FRICTION_N_S_M = 25.0
STROKE_M = 1.2


def strokes(seed: int, count: int = 10) -> np.ndarray:
    """Place of the motor, (n,): to and fro at constant accelerations, with a servo's smoothness."""
    dice = np.random.default_rng(seed)
    parts: list[np.ndarray] = []
    for number in range(count):
        half_s = np.sqrt(STROKE_M / dice.uniform(1.0, 3.0))
        t = np.arange(round((2.0 * half_s + dice.uniform(0.6, 1.0)) * RATE_HZ)) / RATE_HZ
        a = np.where(t < half_s, 1.0, np.where(t < 2.0 * half_s, -1.0, 0.0))
        place = np.cumsum(np.cumsum(a)) / RATE_HZ**2
        place *= STROKE_M / place[-1]
        parts.append(place if number % 2 == 0 else STROKE_M - place)
    width = round(0.02 * RATE_HZ)
    whole = np.pad(np.concatenate(parts), (width, width), mode="edge")
    return np.convolve(whole, np.hanning(width) / np.hanning(width).sum(), "same")[width:-width]


def logged(path: Path, seed: int, *, at_the_motor: bool) -> Path:
    """Write the table of a rack: force in the belt, and the place of the motor or of the mass."""
    dice = np.random.default_rng(seed)
    motor = strokes(seed)
    t = np.arange(motor.size) / RATE_HZ
    stiffness = MASS_KG * (2.0 * np.pi * SWING_HZ) ** 2
    damper = 2.0 * DAMPING * MASS_KG * 2.0 * np.pi * SWING_HZ
    # of the mass relative to the motor, which moves with an acceleration of its own
    acceleration = np.gradient(np.gradient(motor, t), t)
    speed = np.gradient(motor, t)
    A = [[0.0, 1.0], [-stiffness / MASS_KG, -(damper + FRICTION_N_S_M) / MASS_KG]]
    B = [[0.0, 0.0], [-1.0, -FRICTION_N_S_M / MASS_KG]]
    swing = StateSpace(A, B, np.eye(2), np.zeros((2, 2)))
    _, state, _ = lsim(swing, np.column_stack([acceleration, speed]), t)
    force = -stiffness * state[:, 0] - damper * state[:, 1] + dice.normal(0.0, 0.5, t.size)
    place = motor if at_the_motor else motor + state[:, 0]
    place = np.round(place / 5e-6) * 5e-6
    pl.DataFrame({"t": t, "force": force, "place": place}).write_csv(path)
    return path


def weighed(path: Path) -> Run:
    """Replay it as `payscope init` drafts such a machine."""
    machine = Machine.model_validate(
        {
            "machine": {"name": "rack", "digs": False, "force_gain_u": 0.002},
            "log": {"time": "t"},
            "channels": {
                "force_x_N": {"field": "force"},
                "position_x_m": {"field": "place"},
                "speed_x_m_s": {"derive": "d/dt position_x_m"},
                "acc_x_m_s2": {"derive": "d/dt speed_x_m_s"},
            },
            "settings": {
                "forces": {"acceleration": "kinematic"},
                "gate": {"exclude_braking": False},
            },
        }
    )
    return run(open_log(path, time=TimeAxis("t", "s")), machine)


# where the strokes disagree by more than the belt moves the mass (seed 3), it is not named
@pytest.mark.heavy
@pytest.mark.parametrize("seed", mark_slow_after(2, (0, 1, 2, 4, 5)))
def test_a_belt_between_motor_and_mass_widens_and_is_named(tmp_path: Path, seed: int) -> None:
    found = weighed(logged(tmp_path / "rack.csv", seed, at_the_motor=True))

    mass_kg, u_kg = found.frames["loads"].select("mass_kg", "u_kg").row(0)
    assert "elasticity" in found.frames["budget"]["cause"]
    assert abs(mass_kg - MASS_KG) < 2.0 * u_kg
    (said,) = found.frames["findings"].filter(cause="resonance").to_dicts()
    assert "flexes" in said["evidence"]


@pytest.mark.heavy
@pytest.mark.parametrize("seed", mark_slow_after(1, range(6)))
def test_the_motion_of_the_mass_itself_shows_no_belt(tmp_path: Path, seed: int) -> None:
    found = weighed(logged(tmp_path / "rack.csv", seed, at_the_motor=False))

    mass_kg, u_kg = found.frames["loads"].select("mass_kg", "u_kg").row(0)
    assert "elasticity" not in found.frames["budget"]["cause"]
    assert abs(mass_kg - MASS_KG) < 2.0 * u_kg < 0.05 * MASS_KG
