"""A car that nobody here made, logged at its own rate: is it weighed, and is its ± honest?

Rates, cut-offs, derived and measured acceleration, a speed in steps and a force in steps; the car
never stands. Its own small generator, not the simulator: a point mass under air and rolling
resistance, integrated at 1 kHz. Every cell is replayed with its true noise stated and without.

    python -P benchmarks/own_rate.py cells.json --seeds 5 --minutes 20
    python -P benchmarks/own_rate.py drawn.json --drawn 400

What a file holds already is not run again; its table is printed.
"""

import argparse
import itertools
import json
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl

from analysis.model.machine import Machine
from analysis.model.settings import Settings
from estimators.arrays import Floats
from estimators.numerics.play import apply_play_hysteresis
from replay import open_log, run
from replay.logs import TimeAxis

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
#: The force that it drives with at most times, in N: its 95 % quantile.
LARGE_N: Final = 2500.0
#: Standard uncertainties to either side of a 95 % interval.
K: Final = 1.96
#: Steps of the integration a second, and how long the driver's foot takes, in s.
_FINE_HZ: Final = 200
_FOOT_S: Final = 0.8
#: So long after its begin and before its end nothing is logged, in s: what is late has come.
_MARGIN_S: Final = 1.0


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
        of = f", {steps} in steps" if steps else ""
        return f"{self.rate_hz:g} Hz, {self.cutoff_hz:g} Hz, {kind}{of}"

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


def driven(rng: np.random.Generator, seconds: float, nuisance: dict[str, float]) -> Floats:
    """Time, speed, acceleration and force at the ground of a car that never stands, (4, n).

    The driver holds a speed between 6 and 25 m/s for 4 to 12 s each, with a foot of `_FOOT_S`.
    """
    n, dt = round(seconds * _FINE_HZ), 1.0 / _FINE_HZ
    asked = np.empty(n)
    at = 0
    while at < n:
        length = round(rng.uniform(4.0, 12.0) * _FINE_HZ)
        asked[at : at + length] = rng.uniform(6.0, 25.0)
        at += length
    quadratic = AIR_N_S2_M2 + nuisance.get("quadratic", 0.0)
    constant = ROLLING_N + nuisance.get("const", 0.0)
    viscous = VISCOUS_N_S_M + nuisance.get("viscous_drift", 0.0) * np.linspace(-0.5, 0.5, n)
    found = np.empty((4, n))
    v, force = 12.0, 500.0
    for i, (wish, b) in enumerate(zip(asked.tolist(), viscous.tolist(), strict=True)):
        force += (min(max(900.0 * (wish - v), -2500.0), 3500.0) - force) * dt / _FOOT_S
        a = (force - constant - b * v - quadratic * v * v) / MASS_KG
        found[:, i] = i * dt, v, a, force
        v += a * dt
    return found


def logged(cell: Cell, seed: int, nuisance: dict[str, float] | None = None) -> pl.DataFrame:
    """The table that its recorder leaves."""
    has = (nuisance or {}).get
    rng = np.random.default_rng([seed, round(10 * cell.rate_hz)])
    t, v, a, force = driven(rng, 60.0 * cell.minutes, nuisance or {})
    at = np.arange(_MARGIN_S, t[-1] - _MARGIN_S, 1.0 / cell.rate_hz)
    wheels = v * (1.0 + has("slip", 0.0) * force)
    share = 1.0 + has("gain_drift", 0.0) * np.linspace(-0.5, 0.5, t.size)
    force = apply_play_hysteresis(force * share, has("force_play", 0.0))
    force_read = np.interp(at - has("lag", 0.0), t, force)
    force_read += rng.normal(0.0, FORCE_N, at.size)
    speed_read = np.interp(at - (0.0 if cell.derived else has("speed_delay", 0.0)), t, wheels)
    speed_read += rng.normal(0.0, SPEED_M_S, at.size)
    if cell.speed_steps:
        speed_read = np.round(speed_read / SPEED_STEP_M_S) * SPEED_STEP_M_S
    if cell.force_steps:
        force_read = np.round(force_read / FORCE_STEP_N) * FORCE_STEP_N
    columns = {"t": at, "force": force_read, "speed": speed_read}
    if not cell.derived:
        gain = 1.0 + has("acc_gain", 0.0)
        columns["acc"] = gain * np.interp(at, t, a) + rng.normal(0.0, ACC_M_S2, at.size)
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
    # at a slow log's stamps force and speed are Simpson means over the two steps of the difference
    beside = np.ones(at.size)
    if cell.derived and cell.rate_hz < 60.0:
        beside = (2.0 / 3.0 + np.cos(2.0 * np.pi * at) / 3.0) ** 2
    slope = (np.sin(2.0 * np.pi * at) * cell.rate_hz) ** 2
    return {
        "force_N": force * float(np.sqrt((low * beside).mean())),
        "speed_m_s": speed * float(np.sqrt((low * beside).mean())),
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


@dataclass(frozen=True, slots=True)
class Weight:
    """What a replay says of the car."""

    open: bool
    mass_kg: float
    u_kg: float

    @property
    def holds(self) -> bool:
        """Whether the 95 % interval holds the truth."""
        return abs(self.mass_kg - MASS_KG) <= K * self.u_kg


def weighed(table: pl.DataFrame, machine: Machine) -> Weight:
    """Replay the table."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "car.csv"
        table.write_csv(path)
        loads = run(open_log(path, time=TimeAxis("t", "s")), machine).frames["loads"].to_dicts()
    if len(loads) != 1 or loads[0]["withheld"] or loads[0]["mass_kg"] is None:
        return Weight(open=False, mass_kg=0.0, u_kg=0.0)
    return Weight(open=True, mass_kg=loads[0]["mass_kg"], u_kg=loads[0]["u_kg"])


def draw_nuisances(rng: np.random.Generator) -> dict[str, float]:
    """Every nuisance of a car from its prior, at the settings' widths.

    Its force is that of all wheels, which no transfer of load changes.
    """
    priors = Settings.model_validate({}).priors
    weight_N = MASS_KG * 9.80665
    top_m_s = 25.0
    const = np.hypot(priors.const_share * LARGE_N, priors.const_weight_share * weight_N)
    widths = {
        "const": float(const),
        "quadratic": priors.quadratic_share * LARGE_N / top_m_s**2,
        "viscous_drift": priors.viscous_drift_share * LARGE_N / top_m_s,
        "gain_drift": priors.gain_drift,
        "lag": priors.lag_s,
        "acc_gain": priors.gain,
        "speed_delay": priors.speed_delay_s,
        "slip": priors.wheel_slip / LARGE_N,
    }
    found = {name: float(rng.normal(0.0, width)) for name, width in widths.items()}
    # wheels that drive turn faster than the ground passes, and air does not push
    return found | {"slip": abs(found["slip"]), "quadratic": abs(found["quadratic"])}


def measured(path: Path, seeds: int, cars: int, minutes: float) -> dict[str, dict[str, Any]]:
    """Run what the file does not hold yet, as long as the time allows."""
    kept: dict[str, dict[str, Any]] = json.loads(path.read_text()) if path.exists() else {}
    until = time.monotonic() + 60.0 * minutes
    every = cells()
    tasks = [(str(cell), cell, seed) for seed in range(seeds) for cell in every]
    tasks += [("drawn", every[i % len(every)], i) for i in range(cars)]
    for name, cell, seed in tasks:
        key = f"{name} / {seed}"
        if key in kept:
            continue
        if time.monotonic() > until:
            break
        nuisance = draw_nuisances(np.random.default_rng([seed, 7])) if name == "drawn" else {}
        table = logged(cell, seed, nuisance)
        kept[key] = {"cell": str(cell)} | {
            how: asdict(weighed(table, machine_of(cell, stated=how == "stated")))
            for how in ("stated", "own")
        }
        path.write_text(json.dumps(kept, indent=1))
    return kept


def table_of(kept: dict[str, dict[str, Any]]) -> list[str]:
    """A line a cell, and of all."""
    lines = ["cell: logs; opens stated, own, stated alone; holds stated, own; u own / stated"]
    names = list(dict.fromkeys(key.split(" / ")[0] for key in kept))
    for name in [*names, ""]:
        mine = [
            (Weight(**each["stated"]), Weight(**each["own"]))
            for key, each in kept.items()
            if (key.split(" / ")[0] == name if name else not key.startswith("drawn"))
        ]
        if not mine:
            continue
        stated, own = ([pair[i] for pair in mine if pair[i].open] for i in (0, 1))
        lost = sum(one.open and not other.open for one, other in mine)
        ratio = [other.u_kg / one.u_kg for one, other in mine if one.open and other.open]
        lines.append(
            f"{name or 'all cells'}: {len(mine)}; {len(stated)}, {len(own)}, {lost}; "
            f"{sum(each.holds for each in stated)}/{len(stated)}, "
            f"{sum(each.holds for each in own)}/{len(own)}; "
            f"{np.median(ratio) if ratio else np.nan:.2f}; "
            f"{np.median([abs(each.mass_kg - MASS_KG) for each in own]) if own else np.nan:.1f} ± "
            f"{np.median([each.u_kg for each in own]) if own else np.nan:.1f} kg"
        )
    return lines


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path, help="answers, kept as they come")
    parser.add_argument("--seeds", type=int, default=0, help="logs of each cell")
    parser.add_argument("--drawn", type=int, default=0, help="cars with every nuisance drawn")
    parser.add_argument("--minutes", type=float, default=10.0, help="no log begins after so long")
    asked = parser.parse_args()
    found = measured(asked.file, asked.seeds, asked.drawn, asked.minutes)
    print("\n".join(table_of(found)))
