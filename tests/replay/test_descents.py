"""Motion downhill: brakes that the force does not see hold the speed, or a drive holds it back."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from tests.replay.haul import GRAVITY_M_S2, LOADS_KG, haul, replay_haul
from tests.twins import mark_slow_after


@pytest.mark.heavy
@pytest.mark.parametrize("seed", mark_slow_after(1, [1, 2, 3]))
def test_brakes_that_hold_a_descent_are_no_part_of_a_payload(seed: int, tmp_path: Path) -> None:
    """They were fitted as friction, slip and losses: tonnes came out twice as large."""
    hauled = haul(np.random.default_rng(seed))
    found = replay_haul(hauled, tmp_path, pitch_rad={"field": "pitch_rad"})
    payloads = found["loads"].filter(pl.col("payload_kg").is_not_null() & ~pl.col("empty"))
    assert payloads.height == len(LOADS_KG)
    off_kg = payloads["payload_kg"].to_numpy() - LOADS_KG
    assert (np.abs(off_kg) < 0.1 * np.array(LOADS_KG)).all(), payloads
    assert (np.abs(off_kg) < 2.0 * payloads["payload_u_kg"].to_numpy()).all(), payloads


@pytest.mark.heavy
@pytest.mark.parametrize("seed", mark_slow_after(1, [1, 2, 3]))
def test_descents_that_no_pitch_shows_are_named_first(seed: int, tmp_path: Path) -> None:
    """The log was refused for too little excitation, its grade taken for Coulomb friction."""
    findings = replay_haul(haul(np.random.default_rng(seed)), tmp_path)["findings"]
    assert findings["cause"][0] == "slope", findings


@pytest.mark.heavy
def test_level_ground_has_no_descents(tmp_path: Path) -> None:
    findings = replay_haul(haul(np.random.default_rng(1), grade_rad=0.0), tmp_path)["findings"]
    assert "slope" not in findings["cause"], findings


@pytest.mark.heavy
def test_a_drive_that_holds_an_axis_back_is_a_slope_and_no_flipped_sign(tmp_path: Path) -> None:
    """A slide that is let down 30 degrees, stroke by stroke: its drive pushes up all the while."""
    dice, mass_kg, rate_hz = np.random.default_rng(2), 140.0, 100.0
    stroke = np.repeat([0.0, 0.8, 0.0, -0.8], (100, 80, 350, 80))
    acceleration = np.concatenate([-scale * stroke for scale in dice.uniform(0.6, 1.3, 12)])
    speed = np.cumsum(acceleration) / rate_hz
    gravity_N = mass_kg * GRAVITY_M_S2 * np.sin(np.deg2rad(30.0))
    force = mass_kg * acceleration + gravity_N + 60.0 * np.sign(speed.round(9)) + 80.0 * speed
    axis = pl.DataFrame(
        {
            "time_s": np.arange(speed.size) / rate_hz,
            "force_N": force + dice.normal(0.0, 4.0, speed.size),
            "speed_m_s": speed + dice.normal(0.0, 0.001, speed.size),
        }
    )
    findings = replay_haul(axis, tmp_path)["findings"]
    assert "sign_flipped" not in findings["cause"], findings
    assert "slope" in findings["cause"], findings
