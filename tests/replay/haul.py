"""Hauls with a load and back without, as a table, and their replay."""

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from analysis.model.machine import Machine
from replay import open_log, run
from tests.replay.sledge import MACHINE

EMPTY_KG, LOADS_KG = 4_000.0, (650.0, 900.0, 750.0, 850.0)
ROLLING_1, COULOMB_N, VISCOUS_N_S_M = 0.015, 300.0, 60.0
GRADE_RAD, GRAVITY_M_S2, RATE_HZ = 0.06, 9.81, 50.0


def haul(
    dice: np.random.Generator, grade_rad: float = GRADE_RAD, cold_1: float = 0.0
) -> pl.DataFrame:
    """Trips up with a load and down without, of 14 s each between stands of 3 s.

    The rolling resistance of a cold machine is larger by `cold_1` of its own, and falls within 30 s
    by a factor of e.
    """
    dt, rows = 0.005, list[tuple[float, float, float]]()
    for load_kg in LOADS_KG:
        for is_up in (True, False):
            mass_kg = EMPTY_KG + load_kg * is_up
            slope_rad = grade_rad if is_up else -grade_rad
            throttle, v, push_N, brake_N = dice.uniform(0.6, 0.95), 0.0, 0.0, 0.0
            for step in range(int(20.0 / dt)):
                drives = 3.0 <= step * dt < 14.0
                rolling_1 = ROLLING_1 * (1.0 + cold_1 * np.exp(-len(rows) * dt / 30.0))
                resists_N = rolling_1 * mass_kg * GRAVITY_M_S2 + COULOMB_N + VISCOUS_N_S_M * v
                pulls_N = -mass_kg * GRAVITY_M_S2 * np.sin(slope_rad)
                asked_N = resists_N - pulls_N + 2.0 * mass_kg * (3.5 - v)
                push_N += (np.clip(asked_N, 0.0, 9_000.0 * throttle) * drives - push_N) * dt / 0.1
                hold_N = mass_kg if not drives and v > 0.0 else max(0.0, -asked_N) * (v > 3.5)
                brake_N += (hold_N - brake_N) * dt / 0.05
                moves = v > 0.0 or drives
                a = (push_N + pulls_N - resists_N - brake_N) / mass_kg if moves else 0.0
                v, before = max(v + a * dt, 0.0), v
                rows.append((push_N if moves else 0.0, before, slope_rad))
    force, speed, pitch = np.array(rows)[:: round(1.0 / RATE_HZ / dt)].T
    noise = {"force_N": 40.0, "speed_m_s": 0.004, "pitch_rad": 0.0005}
    read = dict(zip(noise, (force, speed, pitch), strict=True))
    return pl.DataFrame(
        {"time_s": np.arange(force.size) / RATE_HZ}
        | {name: x + dice.normal(0.0, noise[name], x.size) for name, x in read.items()}
    )


def replay_haul(hauled: pl.DataFrame, folder: Path, **more: dict[str, Any]) -> dict[str, Any]:
    """Frames of a haul, by a machine file with force, speed and what is given."""
    path = folder / "haul.csv"
    hauled.write_csv(path)
    text = tomllib.loads(MACHINE)
    channels = {name: keys for name, keys in text["channels"].items() if name != "acc_x_m_s2"}
    channels |= {"acc_x_m_s2": {"derive": "d/dt speed_x_m_s"}, **more}
    body = {**text["machine"], "empty_mass_kg": EMPTY_KG, "empty_mass_u_kg": 8.0}
    machine = Machine.model_validate({**text, "machine": body, "channels": channels})
    return dict(run(open_log(path), machine).frames)
