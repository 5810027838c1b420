"""A car that nobody here made, logged at its own rate: is it weighed, and is its ± honest?

Rates, cut-offs, derived and measured acceleration, a speed in steps and a force in steps; the car
never stands. Its own small generator, not the simulator: a point mass under air and rolling
resistance, integrated at 1 kHz. Every cell is replayed with its true noise stated and without.

    python -P benchmarks/own_rate.py cells.json --seeds 5 --minutes 20
    python -P benchmarks/own_rate.py drawn.json --drawn 400

What a file holds already is not run again; `--table` prints it.
"""

import argparse
import itertools
import json
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.machine import Machine
from replay import open_log, run

Floats = NDArray[np.float64]

#: Of the car, in kg, N, N·s/m and N·s²/m²: a small car on a flat road.
MASS_KG: Final = 1850.0
ROLLING_N: Final = 180.0
VISCOUS_N_S_M: Final = 8.0
AIR_N_S2_M2: Final = 0.4
#: White noise of a reading: as the issue's car has it; of an accelerometer: a cheap one.
FORCE_N: Final = 20.0
SPEED_M_S: Final = 0.01
ACC_M_S2: Final = 0.05
#: Steps of a coarse speed (a car's bus: 0.1 km/h) and of a coarse force.
SPEED_STEP_M_S: Final = 0.1 / 3.6
FORCE_STEP_N: Final = 50.0
RATES_HZ: Final = (1.0, 5.0, 10.0, 20.0, 50.0, 100.0)
CUTOFFS_HZ: Final = (1.0, 2.0, 3.0, 5.0, 20.0)
#: A filter above this share of the rate is none.
VOID: Final = 0.45
#: Steps of the integration a second, and how long the driver's foot takes, in s.
_FINE_HZ: Final = 1000
_FOOT_S: Final = 0.8


@dataclass(frozen=True, slots=True)
class Cell:
    """One kind of log."""

    rate_hz: float
    cutoff_hz: float
    derived: bool
    speed_steps: bool = False
    force_steps: bool = False

    def __str__(self) -> str:
        """As a key of the file of results."""
        kind = "derived" if self.derived else "measured"
        steps = "speed" * self.speed_steps + "force" * self.force_steps
        return f"{self.rate_hz:g} Hz, {self.cutoff_hz:g} Hz, {kind}{', steps of ' * bool(steps)}{steps}"

    @property
    def minutes(self) -> float:
        """How long the car is driven: a slow log is a long one."""
        return 20.0 if self.rate_hz < 5.0 else 6.0 if self.rate_hz < 50.0 else 3.0


def cells() -> list[Cell]:
    """Every cell that is not void; with a measured acceleration nothing is filtered."""
    plain = [
        Cell(rate, cutoff, derived=True)
        for rate, cutoff in itertools.product(RATES_HZ, CUTOFFS_HZ)
        if cutoff <= VOID * rate
    ]
    # a rate that no cut-off suits is replayed without a filter
    plain += [Cell(1.0, 20.0, derived=True)]
    plain += [Cell(rate, 20.0, derived=False) for rate in RATES_HZ]
    steps = [
        Cell(each.rate_hz, each.cutoff_hz, each.derived, *which)
        for each in plain
        if each.cutoff_hz in (2.0, 20.0)
        for which in ((True, False), (False, True))
    ]
    return [*plain, *steps]


def driven(
    rng: np.random.Generator, seconds: float, nuisance: dict[str, float]
) -> tuple[Floats, ...]:
    """Time, speed, acceleration and wheel force at 1 kHz of a car that never stands.

    The driver asks for a force that holds a speed between 6 and 25 m/s for 4 to 12 s each, with up
    to 0.8 of the friction of a tyre never used: a foot of `_FOOT_S`.
    """
    n = round(seconds * _FINE_HZ)
    asked = np.empty(n)
    at = 0
    while at < n:
        length = round(rng.uniform(4.0, 12.0) * _FINE_HZ)
        asked[at : at + length] = rng.uniform(6.0, 25.0)
        at += length
    dt = 1.0 / _FINE_HZ
    quadratic = AIR_N_S2_M2 + nuisance.get("quadratic", 0.0)
    constant = ROLLING_N + nuisance.get("const", 0.0)
    speeds, rates, forces = (np.empty(n) for _ in range(3))
    v, force = 12.0, 500.0
    for i in range(n):
        wish = float(np.clip(900.0 * (asked[i] - v), -2500.0, 3500.0))
        force += (wish - force) * dt / _FOOT_S
        a = (force - constant - VISCOUS_N_S_M * v - quadratic * v * v) / MASS_KG
        speeds[i], rates[i], forces[i] = v, a, force
        v += a * dt
    return np.arange(n) * dt, speeds, rates, forces


def logged(cell: Cell, seed: int, nuisance: dict[str, float] | None = None) -> pl.DataFrame:
    """The table that its recorder leaves."""
    drawn = nuisance or {}
    rng = np.random.default_rng([seed, round(10 * cell.rate_hz)])
    t, v, a, force = driven(rng, 60.0 * cell.minutes, drawn)
    late = round(drawn.get("lag", 0.0) * _FINE_HZ)
    every = slice(200, t.size - 200, round(_FINE_HZ / cell.rate_hz))
    n = t[every].size
    # what the wheels' force sensor says: late, with a gain that drifts over the log
    says = np.roll(force, late)[every] * (1.0 + drawn.get("drift", 0.0) * np.linspace(-1, 1, n))
    force_read = says + rng.normal(0.0, FORCE_N, n)
    speed_read = v[every] + rng.normal(0.0, SPEED_M_S, n)
    if cell.speed_steps:
        speed_read = np.round(speed_read / SPEED_STEP_M_S) * SPEED_STEP_M_S
    if cell.force_steps:
        force_read = np.round(force_read / FORCE_STEP_N) * FORCE_STEP_N
    columns = {"t": t[every], "force": force_read, "speed": speed_read}
    if not cell.derived:
        columns["acc"] = a[every] + rng.normal(0.0, ACC_M_S2, n)
    return pl.DataFrame(columns)


def _true_noise(cell: Cell) -> dict[str, float]:
    """The noise of a sample on the grid: white noise through what is done to it, in SI units.

    White noise of a speed goes through the low-pass and the central difference of its own rate; the
    steps of a reading are white noise of step²/12.
    """
    from scipy.signal import butter, sosfreqz

    at = (np.arange(4096) + 0.5) / 8192.0
    low = np.ones(at.size)
    if cell.derived and cell.cutoff_hz <= VOID * cell.rate_hz:
        sos = butter(4, cell.cutoff_hz, fs=cell.rate_hz, output="sos")
        low = np.abs(sosfreqz(sos, 2.0 * np.pi * at)[1]) ** 4
    speed = float(np.hypot(SPEED_M_S, cell.speed_steps * SPEED_STEP_M_S / np.sqrt(12.0)))
    force = float(np.hypot(FORCE_N, cell.force_steps * FORCE_STEP_N / np.sqrt(12.0)))
    slope = (np.sin(2.0 * np.pi * at) * cell.rate_hz) ** 2
    return {
        "force_N": force * float(np.sqrt(low.mean())),
        "speed_m_s": speed * float(np.sqrt(low.mean())),
        "acc_m_s2": speed * float(np.sqrt((low * slope).mean())) if cell.derived else ACC_M_S2,
    }


def machine_of(cell: Cell, *, stated: bool) -> Machine:
    """The car's machine file."""
    channels: dict[str, Any] = {
        "force_x_N": {"field": "force"},
        "speed_x_m_s": {"field": "speed"},
    }
    settings: dict[str, Any] = {
        "filter": {"cutoff_hz": cell.cutoff_hz},
        "gate": {"exclude_braking": False},
    }
    if cell.derived:
        channels["acc_x_m_s2"] = {"derive": "d/dt speed_x_m_s"}
        settings["forces"] = {"acceleration": "kinematic"}
    else:
        channels["specific_force_x_m_s2"] = {"field": "acc"}
    if stated:
        settings["noise"] = _true_noise(cell)
    return Machine.model_validate(
        {
            "machine": {"name": "car", "empty_mass_kg": MASS_KG},
            "log": {"time": "t"},
            "channels": channels,
            "settings": settings,
        }
    )
