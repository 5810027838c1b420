"""Simulated years of machines at manoeuvre level: which drifts are flagged, how many falsely.

    python -P benchmarks/fleet_years.py [--years 400] [--write]

A day of a machine is 20 to 70 cycles. Every pass is two starts, each with noise and scatter of its
own; every day has an error of its own on zero, scale and friction (weather, operator, fuel), every
machine other sizes of all of these. Days off are drawn. The charts are those of the report, with
nothing known of the machine in advance. The seeds are not those that anything was chosen by: the
limit follows from the average run length alone.
"""

import argparse
import sys
from typing import Final

import numpy as np
import polars as pl

from analysis.fleet.machine_drifts import MachineChart, make_machine_charts
from benchmarks.fleet_logs import told
from benchmarks.page import markdown, put
from estimators.arrays import Floats

_DAYS: Final = 365
_MONTH: Final = 365.0 / 12.0
_IN_TIME: Final = 91
_SEED: Final = 81_000


def year(
    seed: int, *, zero_a_month: float = 0.0, friction: float = 1.0, together: float = 0.0
) -> pl.DataFrame:
    """Days of one machine's year, as `daily` gives them.

    Args:
        seed: of all that is drawn.
        zero_a_month: creep of the zero, in standard deviations of the daily empty-pass mean.
        friction: what it grows to by the end of the year, as a factor.
        together: correlation of a day's errors with those of the day before.
    """
    draw = np.random.default_rng(seed)
    # five to seven days a week
    works = draw.random(_DAYS) < draw.choice([5.0, 6.0, 7.0]) / 7.0
    day = np.flatnonzero(works)
    own = {name: _days(draw, day.size, together) for name in ("zero", "scale", "friction")}
    empty_kg, start_kg = draw.uniform(2800.0, 5000.0), draw.uniform(8.0, 40.0)
    day_kg = draw.uniform(3.0, 15.0)
    load_kg, load_std_kg = draw.uniform(400.0, 900.0), draw.uniform(60.0, 180.0)
    scale_1, friction_1 = draw.uniform(0.01, 0.04), draw.uniform(0.02, 0.05)
    cycles = draw.integers(20, 71, day.size)
    # what an empty pass' mean of two starts scatters by over a day, beside the day itself
    within_kg = np.array([_mean_of_starts(draw, start_kg, n) for n in cycles])
    std_kg = float(np.hypot(day_kg, start_kg / np.sqrt(2.0 * cycles.mean())))
    creep_kg = zero_a_month * std_kg * day / _MONTH
    zero_kg = empty_kg + own["zero"] * day_kg + within_kg + creep_kg
    loads = np.array([draw.normal(load_kg, load_std_kg, n).mean() for n in cycles])
    loads = loads * (1.0 + scale_1 * own["scale"])
    grown = 1.0 + (friction - 1.0) * day / _DAYS
    viscous = draw.uniform(1500.0, 4000.0) * grown * np.exp(friction_1 * own["friction"])
    first = pl.date(2025, 1, 1)
    return pl.DataFrame(
        {"at": day, "zero_kg": zero_kg, "load_kg": loads, "friction_N_s_m": viscous}
    ).select(
        pl.lit(f"{seed}").alias("machine"),
        (first + pl.duration(days="at")).alias("day"),
        "zero_kg",
        "load_kg",
        "friction_N_s_m",
        pl.lit("").alias("calibration"),
    )


def _days(draw: np.random.Generator, count: int, together: float) -> Floats:
    """(count,) standard normal, each correlated with the one before."""
    found = draw.normal(size=count)
    for n in range(1, count):
        found[n] = together * found[n - 1] + np.sqrt(1.0 - together**2) * found[n]
    return found


def _mean_of_starts(draw: np.random.Generator, start_kg: float, cycles: int) -> float:
    return float(draw.normal(0.0, start_kg, (cycles, 2)).mean(axis=1).mean())


def flagged(charts: list[MachineChart], name: str) -> int | None:
    """Days from the first of the year until a signal's chart is beyond its limit."""
    for each in charts:
        if each.signal.name == name and each.chart.flagged_index is not None:
            return (each.days[each.chart.flagged_index] - each.days[0]).days
    return None


def alarms(days: pl.DataFrame) -> int:
    """False alarms of a year without drift, where every alarm starts its chart anew."""
    found = 0
    for name in ("zero", "scale", "friction"):
        left = days
        while left.height:
            chart = next(c for c in make_machine_charts(left) if c.signal.name == name).chart
            if chart.flagged_index is None:
                break
            found += 1
            left = left.slice(chart.flagged_index + 1)
    return found


def table(years: int) -> tuple[list[list[str]], bool]:
    """A row a case: how many years, how many flagged in time, after how long."""
    rows: list[list[str]] = []
    good = True
    cases = (
        ("zero creeps by 1 σ a month", "zero", {"zero_a_month": 1.0}),
        ("zero creeps by ½ σ a month", "zero", {"zero_a_month": 0.5}),
        ("friction doubles over the year", "friction", {"friction": 2.0}),
        ("friction grows by half", "friction", {"friction": 1.5}),
    )
    for number, (what, signal, drift) in enumerate(cases):
        after = [
            flagged(make_machine_charts(year(_SEED + 10_000 * number + n, **drift)), signal)
            for n in range(years)
        ]
        known = np.array([each for each in after if each is not None], dtype=float)
        in_time = float(np.mean([each is not None and each <= _IN_TIME for each in after]))
        middle, late = (np.quantile(known, q) for q in (0.5, 0.95))
        rows.append([what, str(years), f"{in_time:.1%}", f"{middle:.0f} days", f"{late:.0f} days"])
        good &= number % 2 == 1 or in_time >= 0.95
    for together in (0.0, 0.2, 0.4):
        found = [alarms(year(_SEED + 90_000 + n, together=together)) for n in range(years)]
        a_year = float(np.mean(found))
        said = f"{a_year:.2f} alarms a year"
        what = f"no drift, days correlated by {together:g}" if together else "no drift"
        rows.append([what, str(years), said, "–", "–"])
        good &= together > 0.0 or a_year <= 1.0
    return rows, good


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--years", type=int, default=400)
    parser.add_argument("--write", action="store_true")
    asked = parser.parse_args()
    rows, good = table(asked.years)
    heads = ["machine and year", "years", "flagged within 91 days", "median", "95 % by"]
    said = markdown(heads, rows)
    told(said)
    if asked.write:
        put("fleet.md", "simulated years", said)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
