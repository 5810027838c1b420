"""A truck that starts ten times on level ground, as a table of force, speed and acceleration."""

import tomllib
from pathlib import Path

import numpy as np
import polars as pl

from analysis.model.machine import Machine
from analysis.model.run_record import Run
from replay import open_log, run
from tests.replay.sledge import MACHINE

MASS_KG = 10_000.0
RATE_HZ = 50.0
STARTS = 10


def starts(
    *, seen_1: float = 0.0, grease_N: float = 0.0, viscous_N_s_m: float = 300.0
) -> pl.DataFrame:
    """Starts to 6 to 9 m/s, and brakes.

    Args:
        seen_1: share of the brakes that the force sees.
        grease_N: friction at a standstill that is gone at 2 m/s, beside 2 kN that stay.
        viscous_N_s_m: viscous friction.
    """
    dice, dt = np.random.default_rng(2), 0.01
    rows: list[tuple[float, float, float]] = []
    v = push_N = brake_N = 0.0
    for _ in range(STARTS):
        top_m_s, throttle = dice.uniform(6.0, 9.0), dice.uniform(0.5, 1.0)
        for step in range(2_400):
            begun = 300 <= step < 1_500
            asked_N = min(max(MASS_KG * (top_m_s - v), 0.0), throttle * 18_000.0) * begun
            push_N += (asked_N - push_N) * dt / 0.2
            brake_N += (MASS_KG * (step >= 1_500) - brake_N) * dt / 0.1
            held_N = brake_N + 2_000.0 + grease_N * np.exp(-v / 0.6)
            a = (push_N - held_N * (v > 0.0) - viscous_N_s_m * v) / MASS_KG
            rows.append((push_N - seen_1 * brake_N * (v > 0.0), v, a if v > 0.0 else 0.0))
            v = max(v + a * dt, 0.0)
    force, speed, acc = np.array(rows)[::2].T
    read = {"force_N": (force, 150.0), "speed_m_s": (speed, 0.004), "acc_m_s2": (acc, 0.03)}
    noisy = {name: x + dice.normal(0.0, std, x.size) for name, (x, std) in read.items()}
    return pl.DataFrame({"time_s": np.arange(speed.size) / RATE_HZ, **noisy})


def replayed(folder: Path, table: pl.DataFrame, **gate: bool) -> Run:
    """Replay a table of the truck."""
    path = folder / "truck.csv"
    table.write_csv(path)
    text = tomllib.loads(MACHINE)
    body = {**text["machine"], "empty_mass_kg": MASS_KG}
    settings = {**text["settings"], "gate": gate}
    machine = Machine.model_validate({**text, "machine": body, "settings": settings})
    return run(open_log(path), machine)
