"""Readings of simulated campaigns, as a campaign file would give them."""

import numpy as np
import polars as pl


def references(loads=6, empty_kg=3614.0):
    return pl.DataFrame(
        {
            "load_id": [f"load {k}" for k in range(loads)],
            "reference_kg": [empty_kg + 50.0 * k for k in range(loads)],
        }
    )


def readings(
    seed=1,
    *,
    loads=6,
    days=5,
    runs=1,
    each=4,
    line=(100.0, 1.02),
    deviations=(20.0, 8.0, 10.0),
    common_u_kg=0.0,
):
    """A row a reading; `deviations` of readings, runs and days in kg."""
    dice = np.random.default_rng(seed)
    rep, between_runs, between_days = deviations
    rows = []
    for day in range(days):
        of_day = dice.normal(0.0, between_days)
        for run in range(runs):
            for load in range(loads):
                of_run = of_day + dice.normal(0.0, between_runs)
                true = line[0] + line[1] * (3614.0 + 50.0 * load) + of_run
                rows += [
                    {
                        "run_id": f"{day}/{load}/{run}",
                        "load_id": f"load {load}",
                        "day": f"day {day}",
                        "log": f"{day}.bag",
                        "reading": reading,
                        "start_s": 10.0 * reading,
                        "end_s": 10.0 * reading + 5.0,
                        "mass_kg": true + dice.normal(0.0, rep),
                        "std_kg": rep or 1.0,
                        "common_u_kg": common_u_kg,
                        "used": True,
                        "reason": "",
                    }
                    for reading in range(each)
                ]
    return pl.DataFrame(rows)
