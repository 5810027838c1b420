"""A speed that is late, in a log without an accelerometer, is named with its delay."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from replay.logs import open_log
from replay.machines.machine_file import load_machine
from replay.pipeline import run
from tests.twins import mark_slow_after

RATE_HZ, MASS_KG = 50.0, 3200.0
MACHINE = """
[machine]
name = "shuttle"
digs = false
[channels.force_x_N]
field = "force_N"
[channels.speed_x_m_s]
field = "speed_m_s"
[channels.acc_x_m_s2]
derive = "d/dt speed_x_m_s"
[settings.forces]
acceleration = "kinematic"
[settings.gate]
exclude_braking = false
"""


def write_shuttle_log(path: Path, speed_delay_s: float) -> None:
    """Starts and stops both ways against rolling resistance, as no simulator of ours draws them."""
    rng = np.random.default_rng(4)
    starts: list[np.ndarray] = []
    while sum(each.size for each in starts) < 240 * RATE_HZ:
        speed_m_s = rng.choice([-1.0, 1.0]) * rng.uniform(0.4, 1.2) * 2.0
        up, hold, down, stand = (rng.uniform(1.5, 4.0, 4) * RATE_HZ).astype(int)
        starts += [
            np.linspace(0.0, speed_m_s, up),
            np.full(hold, speed_m_s),
            np.linspace(speed_m_s, 0.0, down),
            np.zeros(stand),
        ]
    v = np.convolve(np.concatenate(starts), np.ones(15) / 15, "same")
    t = np.arange(v.size) / RATE_HZ
    force_N = MASS_KG * np.gradient(v, t) + MASS_KG * 9.81 * 0.015 * np.tanh(v / 0.03) + 60.0 * v
    late = np.interp(t - speed_delay_s, t, v)
    pl.DataFrame(
        {
            "time_s": t,
            "force_N": force_N + rng.normal(0.0, 60.0, t.size),
            "speed_m_s": late + rng.normal(0.0, 0.01, t.size),
        }
    ).write_csv(path)


@pytest.mark.heavy
@pytest.mark.parametrize("delay_s", mark_slow_after(1, [0.3, 0.1, 0.8]))
def test_a_late_speed_is_named_with_its_delay(tmp_path: Path, delay_s: float) -> None:
    path, machine_path = tmp_path / "log.csv", tmp_path / "shuttle.toml"
    write_shuttle_log(path, delay_s)
    machine_path.write_text(MACHINE)
    with open_log(path) as log:
        findings = run([log], load_machine(machine_path)).frames["findings"]
    # rolling resistance is the other thing that this log shows
    assert {"delay"} <= set(findings["cause"]) <= {"delay", "coulomb"}
    found = findings.row(by_predicate=pl.col("cause") == "delay", named=True)
    assert found["setting"] == "channels.speed_x_m_s.delay_s"
    assert float(found["value"]) == pytest.approx(delay_s, abs=0.01)
    assert "or the force is early: two channels cannot show which" in found["evidence"]
