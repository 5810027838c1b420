"""Loads that recurrent places tell apart: speed control leaves little in a start to tell a mass."""

import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from analysis.model.machine import Machine
from replay import open_log, run
from tests.replay.sledge import MACHINE
from tests.twins import mark_slow_after

EMPTY_KG, ROLLING_1, VISCOUS_N_S_M, LARGEST_N = 18_000.0, 0.018, 2_100.0, 28_000.0
#: Of each drive of a cycle: whether it has the load, its direction, length in m and speed in m/s.
#: It is filled from behind, between the last drive and the first.
DRIVES = (
    *((True, -1.0, 9.0, 1.6), (True, 1.0, 21.0, 2.0)),
    *((False, -1.0, 9.0, 1.6), (False, 1.0, 9.0, 1.4), (False, -1.0, 12.0, 2.0)),
)
DT_S, RATE_HZ = 0.01, 50.0


def haul(
    loads_kg: np.ndarray,
    dice: np.random.Generator,
    grade_1: Callable[[float], float] = lambda _: 0.0,
) -> pl.DataFrame:
    """Drive each load through a cycle, with a force in proportion to the speed that is missing.

    `grade_1` is the grade at each place, in m from where the machine is filled.
    """
    rows, place_m = list[tuple[float, float]](), 0.0
    for load_kg in loads_kg:
        for is_loaded, way, length_m, speed_m_s in DRIVES:
            rows += [(0.0, 0.0)] * round(dice.uniform(2.0, 6.0) / DT_S)
            mass_kg = EMPTY_KG + load_kg * is_loaded
            asked_1, top_m_s = dice.uniform(0.55, 1.0), speed_m_s * dice.uniform(0.92, 1.06)
            force_N = v = gone_m = 0.0
            while True:
                brakes = length_m - gone_m <= v * v / 1.8 + 0.02
                rolling_N = (ROLLING_1 + way * grade_1(place_m)) * mass_kg * 9.81
                wanted_N = np.clip(0.981 * EMPTY_KG * (top_m_s - v), 0.0, asked_1 * LARGEST_N)
                force_N += ((0.0 if brakes else wanted_N + rolling_N) - force_N) * DT_S / 0.2
                resists_N = rolling_N + VISCOUS_N_S_M * v + brakes * 0.9 * mass_kg
                if brakes and v * mass_kg <= resists_N * DT_S:
                    break
                v = max(v + (force_N - resists_N) / mass_kg * DT_S, 0.0)
                gone_m, place_m = gone_m + v * DT_S, place_m + way * v * DT_S
                rows.append((way * force_N, way * v))
    force_N, speed_m_s = np.array(rows)[:: round(1.0 / RATE_HZ / DT_S)].T
    return pl.DataFrame(
        {
            "time_s": np.arange(force_N.size) / RATE_HZ,
            "force_N": force_N + dice.normal(0.0, 110.0, force_N.size),
            "speed_m_s": speed_m_s + dice.normal(0.0, 0.004, force_N.size) * (speed_m_s != 0.0),
        }
    )


def weigh(log: pl.DataFrame, folder: Path) -> Mapping[str, pl.DataFrame]:
    """Replay a log of this machine, and return its frames."""
    log.write_csv(folder / "haul.csv")
    text = tomllib.loads(MACHINE)
    channels = text["channels"] | {"acc_x_m_s2": {"derive": "d/dt speed_x_m_s"}}
    body = {**text["machine"], "empty_mass_kg": EMPTY_KG, "empty_mass_u_kg": 72.0, "digs": False}
    machine = Machine.model_validate({**text, "machine": body, "channels": channels})
    return run(open_log(folder / "haul.csv"), machine).frames


@pytest.mark.heavy
@pytest.mark.parametrize("seed", mark_slow_after(2, range(1, 9)))
def test_the_tonnes_of_a_machine_under_speed_control_hold(seed: int, tmp_path: Path) -> None:
    """They were a third of it: the last empty drive of each cycle was taken for a loaded one."""
    dice = np.random.default_rng(seed)
    loads_kg = dice.uniform(2_500.0, 4_000.0, 12)
    frames = weigh(haul(loads_kg, dice), tmp_path)
    (shift,) = frames["shift"].to_dicts()
    assert shift["cycles_counted"] == loads_kg.size, frames["loads"]
    off_kg = shift["payload_kg"] - loads_kg.sum()
    assert abs(off_kg) < 2.0 * shift["payload_u_kg"] < 0.1 * loads_kg.sum(), shift


@pytest.mark.heavy
@pytest.mark.parametrize("seed", mark_slow_after(2, range(11, 19)))
def test_a_slope_at_one_place_is_no_load(seed: int, tmp_path: Path) -> None:
    """It was up to fifteen loads of an empty machine, whose forces differ from place to place."""
    dice = np.random.default_rng(seed)
    log = haul(np.zeros(14), dice, lambda place_m: 0.006 * (-9.0 < place_m < -2.0))
    frames = weigh(log, tmp_path)
    loads = frames["loads"]
    off_u = (loads["mass_kg"] - EMPTY_KG) / loads["u_kg"]
    assert (off_u.abs() < 2.0).all(), loads
    assert frames["shift"]["cycles_counted"].item() == 0
