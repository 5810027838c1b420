"""A car on a flat road whose engine gives no more than it can, as a table."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
import polars as pl

from analysis.model.machine import Machine
from analysis.model.run_record import Run
from analysis.model.verdict import Check, Verdict
from replay import open_log, run

Floats = np.ndarray

MASS_KG = 1850.0
RATE_HZ = 20.0
FORCE_NOISE_N = 20.0
ACC_NOISE_M_S2 = 0.05
#: Friction in N, N·s/m and N·s²/m².
FRICTION = (180.0, 8.0, 0.4)


@dataclass(frozen=True)
class Car:
    """What its driver did and its instruments read, (samples,) each."""

    t: Floats
    force: Floats
    speed: Floats
    acc: Floats

    @classmethod
    def driven(
        cls, seconds: float = 180.0, limit_N: float = np.inf, noise_m_s: float = 0.01, seed: int = 1
    ) -> Self:
        """Speeds between 5 and 20 m/s, wished for a while each: it never stands.

        Args:
            seconds: how long.
            limit_N: of the engine, which reports no more and pulls with no more.
            noise_m_s: of the speed.
            seed: of driver and noise.
        """
        dice, noise = np.random.default_rng([seed, 1]), np.random.default_rng([seed, 2])
        size, dt = round(seconds * RATE_HZ), 1.0 / RATE_HZ
        wish, at = np.empty(size), 0
        while at < size:
            length = round(dice.uniform(6.0, 14.0) * RATE_HZ)
            wish[at : at + length] = dice.uniform(5.0, 20.0)
            at += length
        rows = np.empty((3, size))  # force, speed, acceleration
        constant, viscous, quadratic = FRICTION
        speed, asked = 10.0, 0.0
        for row, wanted in enumerate(wish.tolist()):
            asked += (min(max(1500.0 * (wanted - speed), -4000.0), 5000.0) - asked) * dt / 0.5
            pull = min(asked, limit_N)
            acc = (pull - constant - viscous * speed - quadratic * speed**2) / MASS_KG
            rows[:, row] = pull, speed, acc
            speed += acc * dt
        force = rows[0] + noise.normal(0.0, FORCE_NOISE_N, size)
        force[rows[0] == limit_N] = limit_N
        return cls(
            np.arange(size) * dt,
            force,
            rows[1] + noise.normal(0.0, noise_m_s, size),
            rows[2] + noise.normal(0.0, ACC_NOISE_M_S2, size),
        )

    def but(self, **columns: Floats) -> Self:
        """The same with other readings."""
        return replace(self, **columns)

    def at(self, begin_s: float, end_s: float) -> Floats:
        """Which samples are between two moments, (samples,)."""
        return (self.t >= begin_s) & (self.t < end_s)

    def frozen(self, *spans_s: tuple[float, float]) -> Self:
        """The same with a force that repeats itself from one moment to another."""
        force = self.force.copy()
        for span_s in spans_s:
            rows = self.at(*span_s)
            force[rows] = force[np.argmax(rows)]
        return self.but(force=force)

    def replayed(self, folder: Path, *overrides: tuple[str, Any]) -> "Judged":
        """Replay it, by its accelerometer unless a stage of the settings says otherwise."""
        path = folder / "car.csv"
        columns = {"t": self.t, "force": self.force, "speed": self.speed, "acc": self.acc}
        pl.DataFrame(columns).write_csv(path)
        machine = Machine.model_validate(
            {
                "machine": {"name": "car", "empty_mass_kg": MASS_KG, "digs": False},
                "log": {"time": "t"},
                "channels": {
                    "force_x_N": {"field": "force"},
                    "speed_x_m_s": {"field": "speed"},
                    "specific_force_x_m_s2": {"field": "acc"},
                    "acc_x_m_s2": {"derive": "d/dt speed_x_m_s"},
                },
                "settings": {"gate": {"exclude_braking": False}, **dict(overrides)},
            }
        )
        return Judged(run(open_log(path), machine))


@dataclass(frozen=True)
class Judged:
    """What a replay says of it."""

    run: Run

    @property
    def verdict(self) -> Verdict:
        """The checks."""
        return Verdict.from_frame(self.run.frames["verdict"])

    def check(self, name: str) -> Check:
        """One of them."""
        return next(check for check in self.verdict.checks if check.check == name)

    @property
    def load(self) -> dict[str, Any]:
        """The answer."""
        return self.run.frames["loads"].row(0, named=True)

    @property
    def error_u(self) -> float:
        """Its error in standard uncertainties."""
        return (self.load["mass_kg"] - MASS_KG) / self.load["u_kg"]
