"""How often intervals of calibrated masses hold, over campaigns at run level.

    python -P benchmarks/calibration.py [--campaigns 20000] [--seed 13] [--write]

Draws what runs say instead of logs, and not as the fit assumes: repeatability differs from run to
run, runs scatter with heavier tails than the normal, and every deviation that is stated (of a
reading, of a reference, of a day) is wrong by 10 %. `--write` puts the tables into
docs/calibrating.md.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import typer
from scipy.stats import t as student_t

from analysis.calibration.fit import tested_line
from analysis.calibration.inversion import Inversion
from analysis.calibration.model import Points
from analysis.calibration.variance_components import Within
from benchmarks.page import markdown, put

CONFIDENCE: Final = 0.95
#: Deviations are stated with so much of error,
STATED_U: Final = 0.1
#: repeatability differs so much from run to run (of its logarithm),
UNEVEN: Final = 0.2
#: and the scatter of runs has the tails of Student's t with so many degrees of freedom.
TAILS: Final = 8.0


@dataclass(frozen=True)
class Plan:
    """A campaign and its machine; deviations in kg of m̂, references in kg."""

    days: int
    runs: int = 1
    readings: tuple[int, int] = (3, 9)
    repeatability_kg: float = 20.0
    run_kg: float = 8.0
    day_kg: float = 10.0
    references: str = "equal"
    day_known: bool = False
    same_day: bool = False
    loads: int = 6
    gain_1: float = 1.0


def covariance(plan: Plan) -> np.ndarray:
    """(loads, loads) of the references, as stated."""
    if plan.references == "equal":
        return np.eye(plan.loads) * 2.0**2
    if plan.references == "unequal":
        return np.diag(np.linspace(0.5, 8.0, plan.loads) ** 2)
    # drums weighed on one scale, one after the other loaded
    drums = np.arange(plan.loads)
    return 3.0**2 + np.minimum.outer(drums, drums) * 1.0**2 + np.outer(drums, drums) * 1.0**2


@dataclass(frozen=True)
class Drawn:
    """Points of a campaign, and a later run: its mass, what it says, of how many readings, ± u."""

    points: Points
    day_known_kg: float | None
    mass_kg: float
    y_kg: float
    readings: int
    u_random_kg: float
    line: tuple[float, float]


def drawn(dice: np.random.Generator, plan: Plan) -> Drawn:
    """Draw a machine, a campaign and a later run."""
    stated = covariance(plan)
    wrong = np.exp(dice.normal(0.0, STATED_U, plan.loads))
    true = dice.multivariate_normal(np.zeros(plan.loads), stated, method="cholesky") * wrong
    reference_kg = 3614.0 + np.linspace(0.0, 250.0, plan.loads)
    c1 = plan.gain_1 * dice.normal(1.0, 0.05)
    c0 = dice.normal(0.0, 100.0)
    loads, days, _ = (x.ravel() for x in np.indices((plan.loads, plan.days, plan.runs)))
    count = loads.size
    readings = dice.integers(plan.readings[0], plan.readings[1] + 1, count + 1)
    own_kg = plan.repeatability_kg * np.exp(dice.normal(0.0, UNEVEN, count + 1))
    scatter = dice.standard_t(TAILS, count + 1) * plan.run_kg / np.sqrt(TAILS / (TAILS - 2.0))
    day_kg = dice.normal(0.0, plan.day_kg, plan.days + 1)
    if plan.same_day:
        day_kg[-1] = day_kg[0]
    mass_kg = dice.uniform(reference_kg[0], reference_kg[-1])
    x = np.append((reference_kg + true)[loads], mass_kg)
    mean_kg = c0 + c1 * x + np.append(day_kg[days], day_kg[-1]) + scatter
    mean_kg = mean_kg + dice.normal(0.0, own_kg / np.sqrt(readings))
    squares = float((own_kg[:-1] ** 2 * dice.chisquare(readings[:-1] - 1)).sum())
    points = Points(
        y_kg=mean_kg[:-1],
        readings=readings[:-1],
        load=loads,
        day=days,
        reference_kg=reference_kg,
        covariance_kg2=stated,
        within=Within(squares, int((readings[:-1] - 1).sum())),
    )
    said_kg = own_kg[-1] / np.sqrt(readings[-1]) * np.exp(dice.normal(0.0, STATED_U))
    known_kg = plan.day_kg * float(np.exp(dice.normal(0.0, STATED_U))) if plan.day_known else None
    return Drawn(
        points, known_kg, mass_kg, mean_kg[-1], int(readings[-1]), float(said_kg), (c0, c1)
    )


def paper_holds(one: Drawn) -> bool:
    """Whether the prediction interval of (19), fitted on load means, holds the later mass."""
    points = one.points
    loads = np.unique(points.load)
    x = np.array([points.y_kg[points.load == load].mean() for load in loads])
    y = points.reference_kg[loads]
    x0, y0 = x.mean(), y.mean()
    slope = ((x - x0) @ (y - y0)) / ((x - x0) @ (x - x0))
    left = y - y0 - slope * (x - x0)
    s = np.sqrt(left @ left / (loads.size - 2))
    spread = np.sqrt(1.0 + 1.0 / loads.size + (one.y_kg - x0) ** 2 / ((x - x0) @ (x - x0)))
    half = student_t.ppf(0.5 + CONFIDENCE / 2.0, loads.size - 2) * s * spread
    return bool(abs(y0 + slope * (one.y_kg - x0) - one.mass_kg) <= half)


def outcome(one: Drawn) -> np.ndarray:
    """Whether each interval holds (with its own u, without, alpha, beta, (19)), and a half width."""
    line, _ = tested_line(one.points, one.day_known_kg)
    inversion = Inversion.of(line)
    found = inversion.inverted(
        np.full(2, one.y_kg), np.full(2, float(one.readings)),
        np.array([one.u_random_kg, np.nan]), CONFIDENCE,
    )  # fmt: skip
    held = (found.low_kg <= one.mass_kg) & (one.mass_kg <= found.high_kg)
    low, high = inversion.slope_interval(CONFIDENCE)
    c0, c1 = one.line
    at_zero = inversion.exact(0.0, CONFIDENCE)
    beta = at_zero.low_kg[0] <= -c0 / c1 <= at_zero.high_kg[0]
    half = (found.high_kg[1] - found.low_kg[1]) / 2.0
    return np.array([*held, low <= c1 <= high, beta, paper_holds(one), half, line.effects[1].variance_kg2==0])


def outcomes(plan: Plan, campaigns: int, seed: int) -> np.ndarray:
    """(campaigns, outcomes) of one plan."""
    dice = np.random.default_rng(seed)
    return np.array([outcome(drawn(dice, plan)) for _ in range(campaigns)])
