"""A machine that never stands: it creeps under a chute, and dumps while it creeps."""

import tomllib
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from analysis.model.machine import Machine
from replay import open_log, run
from tests.replay.sledge import MACHINE
from tests.twins import mark_slow_after

EMPTY_KG, ROLLING_1, COULOMB_N, VISCOUS_N_S_M = 4_000.0, 0.015, 300.0, 60.0
LOADS_KG = (650.0, 900.0, 750.0, 850.0, 700.0)
CREEP_M_S, DRIVE_S, CREEP_S, RATE_HZ = 0.8, 14.0, 8.0, 50.0


def haul(loads_kg: tuple[float, ...], dice: np.random.Generator) -> pl.DataFrame:
    """Drive without and with each load in turn, and creep in between, where the load changes."""
    dt, rows = 0.005, list[tuple[float, float]]()
    v = push_N = brake_N = mass_kg = 0.0
    masses_kg = EMPTY_KG + np.array([(0.0, load) for load in loads_kg]).ravel()
    for number, next_kg in enumerate(masses_kg):
        throttle, top_m_s = dice.uniform(0.6, 0.95), dice.uniform(3.0, 4.0)
        for step in range(round((CREEP_S + DRIVE_S) / dt)):
            creep_1 = min(step * dt / (CREEP_S - 2.0), 1.0)
            before_kg = masses_kg[number - 1] if number else next_kg
            mass_kg = before_kg + (next_kg - before_kg) * creep_1
            stands = number == 0 and step * dt < 3.0
            wanted_m_s = CREEP_M_S if step * dt < CREEP_S else top_m_s
            resists_N = ROLLING_1 * mass_kg * 9.81 + COULOMB_N + VISCOUS_N_S_M * v
            asked_N = (resists_N + 1.5 * mass_kg * (wanted_m_s - v)) * (not stands)
            push_N += (np.clip(asked_N, 0.0, 9_000.0 * throttle) - push_N) * dt / 0.1
            brake_N += (np.clip(-asked_N, 0.0, mass_kg) - brake_N) * dt / 0.05
            a = 0.0 if stands else (push_N - resists_N - brake_N) / mass_kg
            rows.append((push_N, v))
            v = max(v + a * dt, 0.0)
    force, speed = np.array(rows)[:: round(1.0 / RATE_HZ / dt)].T
    read = {"force_N": (force, 40.0), "speed_m_s": (speed, 0.004)}
    return pl.DataFrame(
        {"time_s": np.arange(force.size) / RATE_HZ}
        | {name: x + dice.normal(0.0, std, x.size) for name, (x, std) in read.items()}
    )


def weigh(table: pl.DataFrame, folder: Path) -> pl.DataFrame:
    path = folder / "haul.csv"
    table.write_csv(path)
    text = tomllib.loads(MACHINE)
    channels = text["channels"] | {"acc_x_m_s2": {"derive": "d/dt speed_x_m_s"}}
    body = {**text["machine"], "empty_mass_kg": EMPTY_KG, "empty_mass_u_kg": 8.0}
    machine = Machine.model_validate({**text, "machine": body, "channels": channels})
    return run(open_log(path), machine).frames["loads"]


@pytest.mark.heavy
@pytest.mark.parametrize("seed", mark_slow_after(1, [1, 2, 3]))
def test_each_load_is_told_where_the_machine_creeps(seed: int, tmp_path: Path) -> None:
    """They were one mass, of 16 manoeuvres, with an interval that held none of them."""
    loads = weigh(haul(LOADS_KG, np.random.default_rng(seed)), tmp_path)
    payloads = loads.filter(~pl.col("empty") & pl.col("payload_kg").is_not_null())
    assert payloads.height == len(LOADS_KG), loads
    off_kg = payloads["payload_kg"].to_numpy() - LOADS_KG
    assert (np.abs(off_kg) < 2.0 * payloads["payload_u_kg"].to_numpy()).all(), payloads
    assert (np.abs(off_kg) < 0.1 * np.array(LOADS_KG)).all(), payloads


@pytest.mark.heavy
def test_a_machine_that_creeps_as_often_without_a_load_has_one_mass(tmp_path: Path) -> None:
    loads = weigh(haul((0.0,) * 5, np.random.default_rng(4)), tmp_path)
    assert loads.height == 1
    (load,) = loads.to_dicts()
    assert abs(load["mass_kg"] - EMPTY_KG) < 2.0 * load["u_kg"]
