"""Machines that neither dig nor dump, as tables: a point mass under forces that grow and fall.

Their drivers, roads, springs and gravity are drawn; none of it is of the simulator.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import polars as pl

from analysis.model.machine import Machine
from tests.analysis.kinematic_machine import kinematic_machine

Floats = np.ndarray


class Driven(NamedTuple):
    """Time, place, speed and acceleration, (samples,) each, in SI units."""

    t: Floats
    x: Floats
    v: Floats
    a: Floats


#: In N.
Resistance = Callable[[Driven], Floats]


@dataclass(frozen=True)
class Drawn:
    """A machine and its log: time, force and speed at its own rate."""

    mass_kg: float
    rate_hz: float
    table: pl.DataFrame

    @property
    def machine(self) -> Machine:
        """What its machine file says: nothing but where the channels are."""
        cutoff_hz = min(20.0, 0.4 * self.rate_hz)
        return kinematic_machine("without a bucket", self.mass_kg, cutoff_hz)


def car(seed: int) -> Drawn:
    """On hills, with gears whose wheels and motor turn along, logged at 10 Hz."""
    dice = np.random.default_rng([seed, 1])
    mass = dice.uniform(1300.0, 1900.0)
    speed = _driven(dice, 600.0, 10.0, (8.0, 28.0), (5.0, 20.0), stops=0.6, foot_s=0.25, most=2.2)
    up_to = np.array([6.0, 11.0, 17.0, 24.0]) * dice.uniform(0.8, 1.2)
    road = _hills(dice, 0.02 * mass, 300.0)

    def resists(on: Driven) -> Floats:
        turns = np.array([0.25, 0.12, 0.06, 0.04, 0.03])[np.searchsorted(up_to, on.v)]
        return 8.0 * on.v + 180.0 + 0.4 * on.v**2 + road(on) + mass * turns * np.maximum(on.a, 0.0)

    return _logged(dice, 10.0, speed, mass, resists, (20.0, 0.02))


def electric_car(seed: int) -> Drawn:
    """Whose motor brakes it, on hills, at 50 Hz."""
    dice = np.random.default_rng([seed, 2])
    mass = dice.uniform(1600.0, 2200.0)
    speed = _driven(dice, 300.0, 50.0, (6.0, 25.0), (4.0, 12.0), stops=0.4, foot_s=0.25, most=3.0)
    road = _hills(dice, 0.03 * mass, 200.0)

    def resists(on: Driven) -> Floats:
        return 10.0 * on.v + 200.0 + 0.45 * on.v**2 + road(on)

    return _logged(dice, 50.0, speed, mass, resists, (60.0, 0.01))


def bus(seed: int) -> Drawn:
    """It never stands, and is logged at 1 Hz."""
    dice = np.random.default_rng([seed, 3])
    mass = dice.uniform(11e3, 16e3)
    fine = _driven(dice, 1500.0, 10.0, (5.0, 18.0), (8.0, 30.0), stops=0.0, foot_s=1.0, most=1.0)
    road = _hills(dice, 0.02 * mass, 500.0)

    def resists(on: Driven) -> Floats:
        return 50.0 * on.v + 900.0 + 3.0 * on.v**2 + road(on)

    return _logged(dice, 1.0, fine[::10], mass, resists, (200.0, 0.03))


def cart(seed: int) -> Drawn:
    """Pushed by hand, step by step."""
    dice = np.random.default_rng([seed, 4])
    mass = dice.uniform(80.0, 200.0)
    speed = _driven(dice, 180.0, 50.0, (0.4, 1.3), (2.0, 6.0), stops=0.3, foot_s=0.4, most=0.8)
    steps_N = dice.uniform(0.02, 0.06) * mass
    floor = _hills(dice, 0.01 * mass, 8.0)

    def resists(on: Driven) -> Floats:
        return 5.0 * on.v + 15.0 + floor(on) + steps_N * np.sin(2 * np.pi * 1.8 * on.t)

    return _logged(dice, 50.0, speed, mass, resists, (2.0, 0.005))


def rack(seed: int) -> Drawn:
    """Strokes to and fro against a spring, with a rest after each."""
    dice = np.random.default_rng([seed, 5])
    mass, viscous = dice.uniform(60.0, 150.0), dice.uniform(50.0, 250.0)
    speed = _strokes(dice, 120.0, (0.15, 0.5), (1.0, 4.0), (0.5, 2.0))
    spring_N_m = dice.uniform(50.0, 300.0)

    def resists(on: Driven) -> Floats:
        return viscous * on.v + 20.0 * np.sign(on.v) + spring_N_m * (on.x - on.x.mean())

    return _logged(dice, 100.0, speed, mass, resists, (5.0, 0.001))


def arm(seed: int) -> Drawn:
    """Strokes to and fro whose share of the weight changes on the way."""
    dice = np.random.default_rng([seed, 6])
    mass, viscous = dice.uniform(5.0, 20.0), dice.uniform(2.0, 20.0)
    speed = _strokes(dice, 120.0, (0.3, 1.2), (1.2, 3.0), (0.2, 1.5))
    share = dice.uniform(0.1, 0.4)

    def resists(on: Driven) -> Floats:
        return viscous * on.v + 3.0 * np.sign(on.v) + mass * 9.81 * share * np.sin(1.5 * on.x)

    return _logged(dice, 100.0, speed, mass, resists, (0.5, 0.002))


WITHOUT_BUCKET: dict[str, Callable[[int], Drawn]] = {
    "a car with gears": car,
    "a car with regenerative brakes": electric_car,
    "a bus that never stands": bus,
    "a cart": cart,
    "a rack": rack,
    "an arm": arm,
}


def _logged(
    dice: np.random.Generator,
    rate_hz: float,
    v: Floats,
    mass_kg: float,
    resists: Resistance,
    noise: tuple[float, float],
) -> Drawn:
    t = np.arange(v.size) / rate_hz
    a, x = np.gradient(v, 1.0 / rate_hz), np.cumsum(v) / rate_hz
    force = mass_kg * a + np.where(v == 0.0, 0.0, resists(Driven(t, x, v, a)))
    force, speed = (
        true + dice.normal(0.0, std, v.size) for true, std in zip((force, v), noise, strict=True)
    )
    return Drawn(mass_kg, rate_hz, pl.DataFrame({"t": t, "force": force, "speed": speed}))


def _hills(dice: np.random.Generator, mass_kg: float, length_m: float) -> Resistance:
    """Four waves of slopes; the mass is what of it a slope of 1 in 1 would pull with."""
    waves = 2 * np.pi / length_m * dice.uniform(0.5, 2.0, 4)
    phases = dice.uniform(0.0, 2 * np.pi, 4)

    def resists(on: Driven) -> Floats:
        return 9.81 * mass_kg * np.sin(np.outer(on.x, waves) + phases).mean(axis=1)

    return resists


def _driven(
    dice: np.random.Generator,
    seconds: float,
    rate_hz: float,
    speeds: tuple[float, float],
    holds_s: tuple[float, float],
    *,
    stops: float,
    foot_s: float,
    most: float,
) -> Floats:
    """A speed that follows the driver's wish for a while each, of which a share is to stop."""
    size = round(seconds * rate_hz)
    wish, at = np.empty(size), 0
    while at < size:
        length = round(dice.uniform(*holds_s) * rate_hz)
        wish[at : at + length] = 0.0 if dice.random() < stops else dice.uniform(*speeds)
        at += length
    v, speed, acceleration = np.empty(size), 0.0 if stops else float(wish[0]), 0.0
    for row, wanted in enumerate(wish.tolist()):
        target = min(max((wanted - speed) / 1.5, -1.3 * most), most)
        acceleration += (target - acceleration) / rate_hz / foot_s
        speed = max(speed + acceleration / rate_hz, 0.0)
        v[row] = speed if speed > 0.01 else 0.0
    return v


def _strokes(
    dice: np.random.Generator,
    seconds: float,
    tops: tuple[float, float],
    moves_s: tuple[float, float],
    rests_s: tuple[float, float],
) -> Floats:
    """Strokes of one way and the other at 100 Hz, rising and falling like a cosine."""
    v, at, way = np.zeros(round(seconds * 100.0)), 100, 1.0
    while at + (size := round(dice.uniform(*moves_s) * 100.0)) < v.size:
        part, ramp = np.arange(size) / size, dice.uniform(0.3, 0.5)
        rises = np.clip(np.minimum(part, 1.0 - part) / ramp, 0.0, 1.0)
        v[at : at + size] = way * dice.uniform(*tops) * (0.5 - 0.5 * np.cos(np.pi * rises))
        way, at = -way, at + size + round(dice.uniform(*rests_s) * 100.0)
    return v
