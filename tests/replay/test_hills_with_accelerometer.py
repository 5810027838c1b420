"""A bus on hills: force and accelerometer see gravity, and the speed of its wheels does not."""

import tomllib
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from analysis.model.machine import Machine
from replay import open_log, run
from tests.replay.sledge import MACHINE

EMPTY_KG, LOAD_KG, STEP_S, GRAVITY_M_S2 = 12_000.0, 1_800.0, 0.02, 9.81
CHANNELS = {
    "force_x_N": {"field": "force_N"},
    "speed_x_m_s": {"field": "speed_m_s"},
    "specific_force_x_m_s2": {"field": "specific_force_m_s2"},
}


def drive_bus(dice: np.random.Generator, loads_kg: list[float]) -> pl.DataFrame:
    """Drive from stop to stop on grades of up to 2 %, with regenerative brakes in the force."""
    rows, place_m = list[tuple[float, float, float]](), 0.0
    for load_kg in loads_kg:
        mass_kg = EMPTY_KG + load_kg
        rises_s, holds_s, falls_s = dice.uniform((8.0, 10.0, 8.0), (12.0, 25.0, 12.0))
        stands_s, top_m_s = dice.uniform((8.0, 9.0), (12.0, 13.0))
        t_s = np.arange(0.0, stands_s + rises_s + holds_s + falls_s, STEP_S)
        ends_s = np.cumsum([stands_s, rises_s, holds_s, falls_s])
        speed = np.interp(t_s, ends_s, [0.0, top_m_s, top_m_s, 0.0])
        speed = np.convolve(np.pad(speed, 50, mode="edge"), np.ones(101) / 101.0, "valid")
        acceleration = np.gradient(speed, STEP_S)
        places_m = place_m + np.cumsum(speed) * STEP_S
        specific = acceleration + GRAVITY_M_S2 * 0.02 * np.sin(places_m / 60.0)
        rolls_N = (0.009 * mass_kg * GRAVITY_M_S2 + 25.0 * speed) * (speed > 0.01)
        rows += zip(mass_kg * specific + rolls_N, speed, specific, strict=True)
        place_m = float(places_m[-1])
    force_N, speed, specific = np.array(rows).T
    return pl.DataFrame(
        {
            "time_s": np.arange(force_N.size) * STEP_S,
            "force_N": force_N + dice.normal(0.0, 80.0, force_N.size),
            "speed_m_s": speed + dice.normal(0.0, 0.006, speed.size) * (speed > 0.0),
            "specific_force_m_s2": specific + dice.normal(0.0, 0.03, speed.size),
        }
    )


@pytest.mark.heavy
@pytest.mark.parametrize("seed", [1, 2])
def test_wheels_that_hills_set_against_the_accelerometer_withhold_nothing(
    seed: int, tmp_path: Path
) -> None:
    """It was withheld for a disagreement of the two, though the force agrees with one of them."""
    loads_kg = [0.0] * 8 + [LOAD_KG] * 8
    drive_bus(np.random.default_rng(seed), loads_kg).write_csv(tmp_path / "bus.csv")
    text = tomllib.loads(MACHINE)
    text["machine"] |= {"empty_mass_kg": EMPTY_KG, "empty_mass_u_kg": 40.0, "digs": False}
    text["channels"] = CHANNELS
    text["settings"] = {
        "forces": {"acceleration": "specific_force"},
        "gate": {"exclude_braking": False},
    }
    frames = run(open_log(tmp_path / "bus.csv"), Machine.model_validate(text)).frames
    (check,) = frames["verdict"].filter(check="wheel_imu_residual").to_dicts()
    assert check["value"] > check["maximum"]
    loads = frames["loads"].sort("mass_kg")
    assert not loads["withheld"].any(), frames["verdict"]
    off_kg = loads["mass_kg"].to_numpy() - [EMPTY_KG, EMPTY_KG + LOAD_KG]
    assert (np.abs(off_kg) < 2.0 * loads["u_kg"].to_numpy()).all(), loads
