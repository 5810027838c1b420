"""A bus that never stands: one load a file, told where the files end."""

from contextlib import ExitStack
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from replay import open_log, run
from replay.logs import TimeAxis
from tests.analysis.kinematic_machine import kinematic_machine
from tests.twins import mark_slow_after

MACHINE = kinematic_machine("bus", 13_000.0, 0.4)


def bus(mass_kg: float, seed: int) -> pl.DataFrame:
    """A quarter of an hour on a flat road at 1 Hz, from 5 to 18 m/s and back."""
    dice = np.random.default_rng(seed)
    wish = np.repeat(dice.uniform(5.0, 18.0, 50), 180)
    speed, acceleration, v = 10.0, 0.0, np.empty(wish.size)
    for row, wanted in enumerate(wish.tolist()):
        target = min(max((wanted - speed) / 1.5, -1.3), 1.0)
        acceleration += 0.1 * (target - acceleration)
        speed += 0.1 * acceleration
        v[row] = speed
    force = mass_kg * np.gradient(v, 0.1) + 50.0 * v + 900.0 + 3.0 * v**2
    t, v, force = np.arange(900.0), v[::10], force[::10]
    return pl.DataFrame(
        {
            "t": t,
            "force": force + dice.normal(0.0, 100.0, t.size),
            "speed": v + dice.normal(0.0, 0.03, t.size),
        }
    )


def loads(folder: Path, masses_kg: list[float]) -> list[dict[str, float]]:
    with ExitStack() as stack:
        logs = []
        for number, mass_kg in enumerate(masses_kg):
            path = folder / f"{number}.parquet"
            bus(mass_kg, number).write_parquet(path)
            logs.append(stack.enter_context(open_log(path, time=TimeAxis("t"))))
        return run(logs, MACHINE).frames["loads"].to_dicts()


@pytest.mark.heavy
def test_one_load_in_one_file_is_one_load(tmp_path: Path) -> None:
    (only,) = loads(tmp_path, [14_000.0])
    assert abs(only["mass_kg"] - 14_000.0) < 2.0 * only["u_kg"]


@pytest.mark.heavy
@pytest.mark.parametrize(
    "masses_kg",
    mark_slow_after(
        1,
        [
            [14_000.0, 16_000.0, 13_500.0, 15_000.0, 13_000.0, 15_500.0, 14_500.0],
            [13_000.0, 13_500.0, 14_000.0, 14_500.0, 15_000.0, 15_500.0, 16_000.0],
        ],
    ),
)
def test_seven_loads_in_seven_files_are_seven_in_order_and_shuffled(
    tmp_path: Path, masses_kg: list[float]
) -> None:
    found = loads(tmp_path, masses_kg)
    assert len(found) == 7
    for load, mass_kg in zip(found, masses_kg, strict=True):
        assert abs(load["mass_kg"] - mass_kg) < 2.0 * load["u_kg"]


@pytest.mark.heavy
def test_the_same_load_in_three_files_is_one_load(tmp_path: Path) -> None:
    assert len(loads(tmp_path, [14_000.0] * 3)) == 1
