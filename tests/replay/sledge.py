"""A small machine for the tests of the command line: its log, its machine file, what was said."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import polars as pl

from tests.one_line import assert_one_line


@dataclass(frozen=True)
class Said:
    """What a command left: its exit status, what it wrote and the error that ended it."""

    status: int
    out: str
    err: str
    error: Exception | None = None


Payscope = Callable[..., Said]


def join_to_one_line(said: Said, *parts: str) -> None:
    """Exit 2, nothing on stdout, one line on stderr that names what it should.

    The command folds its message into one line: so the error must be one before.
    """
    assert said.status == 2, said
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert "Traceback" not in said.err
    if said.error is not None:
        assert_one_line(said.error)
    for part in parts:
        assert part in said.err, said.err


MACHINE = """
[machine]
name = "sledge"
empty_mass_kg = 100.0
timezone = "Europe/Paris"

[log]
time = "time_s"

[channels.force_x_N]
field = "force_N"

[channels.speed_x_m_s]
field = "speed_m_s"

[channels.acc_x_m_s2]
field = "acc_m_s2"

[settings.forces]
acceleration = "kinematic"
"""


def sledge(
    seconds: float = 40.0, mass_kg: float = 120.0, rate_hz: float = 100.0, seed: int = 7
) -> pl.DataFrame:
    """A sledge pushed from rest to a steady speed every ten seconds, and braked."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * rate_hz)) / rate_hz
    cycle = t % 10.0
    friction = 60.0
    acc = np.select(
        [cycle < 4.0, cycle < 6.0, cycle < 8.0, cycle < 9.0], [0.0, 1.0, 0.0, -2.0], 0.0
    )
    speed = np.select(
        [cycle < 4.0, cycle < 6.0, cycle < 8.0, cycle < 9.0],
        [0.0, cycle - 4.0, 2.0, 2.0 - 2.0 * (cycle - 8.0)],
        0.0,
    )
    force = mass_kg * acc + friction * speed
    return pl.DataFrame(
        {
            "time_s": t,
            "force_N": force + rng.normal(0, 1.0, t.size),
            "speed_m_s": speed + rng.normal(0, 0.002, t.size),
            "acc_m_s2": acc + rng.normal(0, 0.01, t.size),
        }
    )
