"""The campaign file of the demo: what was on board of each simulated log."""

import datetime as dt
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from analysis.simulation import Scenario
from replay.simulation.log_truth import true_trials

_HEAD = """\
# The demo's calibration: simulated logs. The certificates are examples and stand for none:
# a simulated mass is exactly known. docs/evidence.md explains every key.

[campaign]
title = "Demo: simulated Cat 262C"
intended_use = "showing what a calibration is"
author = "payscope demo"
author_function = "simulation"
authoriser = "payscope demo"
authoriser_function = "example"
place = "simulated"
place_kind = "other"
deviations = "none"
signer = "payscope demo"

[machine]
file = "{machine}"
id = "simulated"
make = "Caterpillar"
model = "262C"
condition = "simulated"
empty_mass_kg = {empty_kg!r}
empty_mass_u_kg = 0.5
empty_certificate = "example: weighbridge 1"

[conditions]
surface = "simulated, dry concrete"
slope_deg = 0.0
tyres = "simulated, rigid"
fuel = "simulated, constant"
temperature_degC = 20.0

[method]
estimator = "joint_mass"
"""
_MASS = """
[[masses]]
id = "{id}"
value_kg = {value_kg!r}
u_kg = 0.02
certificate = "example: {id}"
"""
_RUN = """
[[runs]]
log = "{log}"
loads = [{loads}]
day = {day}
"""


def demo_campaign(scenario: Scenario, logs: Sequence[Path], machine: str) -> str:
    """The campaign file of simulated logs in one folder, each with a mass more than the last.

    Args:
        scenario: that was simulated, loads ascending from 0.
        logs: a log a load.
        machine: the machine file beside them.
    """
    loads_kg = scenario.campaign.loads_kg
    names = [f"mass-{number}" for number in range(1, len(loads_kg))]
    steps = zip(names, pairwise(loads_kg), strict=True)
    text = _HEAD.format(machine=machine, empty_kg=scenario.machine.mass_kg)
    text += "".join(_MASS.format(id=name, value_kg=high - low) for name, (low, high) in steps)
    for number, log in enumerate(logs):
        start_ns = true_trials([log])["start_ns"][0]
        day = dt.datetime.fromtimestamp(start_ns // 10**9, dt.UTC).date()
        on_board = ", ".join(f'"{name}"' for name in names[:number])
        text += _RUN.format(log=log.name, loads=on_board, day=day)
    return text
