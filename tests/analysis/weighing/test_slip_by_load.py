"""Slip of a machine under several loads, which press its wheels or tracks on the ground."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from replay import open_log, run
from replay.logs import TimeAxis
from tests.analysis.kinematic_machine import machine_of_force_and_speed
from tests.twins import mark_heavy_after, mark_slow_after

EMPTY_KG = 18_000.0
LOAD_KG = 5_000.0
STARTS = 6
RATE_HZ = 50.0
STEP_S = 2e-3
G_M_S2 = 9.81
VISCOUS_N_S_M = 1000.0
ROLLING_1 = 0.045
FORCE_LAG_S = 0.15


def drive(seed: int, stiffness_share: float) -> tuple[pl.DataFrame, float]:
    """Time, force and speed of the tracks, to and fro, and when it stands before it is loaded.

    Args:
        seed: of throttles and noise.
        stiffness_share: share of the slip stiffness that is in proportion to the weight.
    """
    dice = np.random.default_rng(seed)
    rows: list[tuple[float, float, float]] = []
    t = force_N = empty_to_s = 0.0
    for number in range(2 * STARTS):
        mass_kg = EMPTY_KG + (LOAD_KG if number >= STARTS else 0.0)
        empty_to_s = t if number == STARTS else empty_to_s
        throttle_m_s2, top_m_s = dice.uniform(0.5, 1.0), dice.uniform(0.8, 1.5)
        stiffness_N = 2.8 * EMPTY_KG * G_M_S2 * (mass_kg / EMPTY_KG) ** stiffness_share
        rolling_N = ROLLING_1 * mass_kg * G_M_S2 + 2000.0
        speed = 0.0
        for phase, longest_s in enumerate((8.0, dice.uniform(1.0, 4.0), 8.0, 4.0)):
            since = 0.0
            while since < longest_s:
                asked_N = (
                    throttle_m_s2 * mass_kg * min(since / 0.5, 1.0) + rolling_N,
                    2.0 * mass_kg * (top_m_s - speed) + rolling_N + VISCOUS_N_S_M * top_m_s,
                    -0.5 * mass_kg * min(since / 0.4, 1.0),
                    0.0,
                )[phase]
                force_N += (asked_N - force_N) * STEP_S / FORCE_LAG_S
                moves = phase < 3 and (speed > 0.0 or force_N > rolling_N)
                a = (force_N - rolling_N - VISCOUS_N_S_M * speed) / mass_kg if moves else 0.0
                speed = max(speed + a * STEP_S, 0.0) if moves else 0.0
                way = 1.0 if number % 2 == 0 else -1.0
                rows.append((t, way * force_N, way * speed * (1.0 + force_N / stiffness_N)))
                t, since = t + STEP_S, since + STEP_S
                if (phase == 0 and speed >= top_m_s) or (phase == 2 and speed == 0.0):
                    break
    read = np.array(rows)[:: round(1.0 / RATE_HZ / STEP_S)]
    read[:, 1] += dice.normal(0.0, 300.0, len(read))
    read[:, 2] += dice.normal(0.0, 0.0015, len(read))
    return pl.DataFrame(read, schema=["t", "force", "speed"], orient="row"), empty_to_s


@pytest.mark.heavy
@pytest.mark.parametrize("seed", mark_slow_after(1, range(4)))
@pytest.mark.parametrize("stiffness_share", mark_heavy_after(1, [0.0, 1.0]))
def test_a_payload_holds_whether_the_load_presses_the_tracks_or_not(
    tmp_path: Path, seed: int, stiffness_share: float
) -> None:
    path = tmp_path / "crawler.csv"
    log, empty_to_s = drive(seed, stiffness_share)
    log.write_csv(path)
    body = {"name": "crawler", "empty_mass_kg": EMPTY_KG, "digs": False}
    machine = machine_of_force_and_speed(
        body, {"loads": {"empty_from_s": 0.0, "empty_to_s": empty_to_s}}
    )
    frames = run(open_log(path, time=TimeAxis("t", "s")), machine).frames
    (load,) = frames["loads"].filter(~frames["loads"]["empty"]).to_dicts()
    # with one stiffness for both loads +3.4, +2.0, +3.0 and +4.8 u at a share of 1
    assert abs(load["payload_kg"] - LOAD_KG) < 2.5 * load["payload_u_kg"]
    assert load["payload_u_kg"] < 0.02 * LOAD_KG
