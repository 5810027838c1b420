"""A campaign of sledges with known loads, small enough to be calibrated in a test."""

from pathlib import Path

import numpy as np
import polars as pl

from tests.replay.sledge import MACHINE, sledge

LOADS = (0, 1, 2, 3)
#: A load is so many of these.
MASS_KG = 20.0
CAMPAIGN = """
[campaign]
title = "Sledge, May"
intended_use = "weighing sledges in tests"
author = "A. Author"
signer = "T. Signer"

[machine]
file = "sledge.toml"
id = "sledge-7"

[machine.parts]
runners = "R-1"
"""
MASS = """
[[masses]]
id = "block-{number}"
value_kg = 20.0
u_kg = 0.02
certificate = "K-{number}"
expires = 2030-01-31
source = "scale-3"
shared_u_kg = 0.01
"""
RUN = """
[[runs]]
id = "{id}"
log = "{log}"
loads = {loads}
day = 2026-05-0{day}
operator = "O. Operator"
"""


def campaign_folder(
    folder: Path, *, extra: str = "", loads: tuple[int, ...] = LOADS, begin_unix_s: float = 0.0
) -> Path:
    """Write logs, machine file and campaign file; the campaign file.

    Logs begin a day after each other from `begin_unix_s`; at 0 none has an absolute time.
    """
    folder.mkdir(parents=True, exist_ok=True)
    machine = MACHINE.replace(
        "empty_mass_kg = 100.0", "empty_mass_kg = 100.0\nempty_mass_u_kg = 0.05"
    )
    (folder / "sledge.toml").write_text(machine)
    text = CAMPAIGN + "".join(MASS.format(number=k) for k in range(1, max(LOADS) + 1))
    for number, count in enumerate(loads):
        log = f"load-{count}.csv"
        if not (folder / log).exists():
            rng = np.random.default_rng(count)
            table = sledge(mass_kg=100.0 + MASS_KG * count)
            noise = pl.Series(rng.normal(0.0, 3.0, table.height))
            later_s = begin_unix_s + 86400.0 * number if begin_unix_s else 0.0
            table = table.with_columns(
                force_N=pl.col("force_N") + noise, time_s=pl.col("time_s") + later_s
            )
            table.write_csv(folder / log)
        on_board = [f"block-{k}" for k in range(1, count + 1)]
        text += RUN.format(
            id=f"run-{count}", log=log, loads=str(on_board).replace("'", '"'), day=1 + number
        )
    path = folder / "campaign.toml"
    path.write_text(text + extra)
    return path
