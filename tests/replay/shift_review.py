"""A short simulated shift for the tests of its review: logs, a machine file, the truth."""

import json
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from analysis.simulation import Scenario
from replay.simulation.simulate_logs import (
    make_paths_of_simulated_logs,
    make_shift_truth_path,
    simulate_scenario_to_logs,
)
from tests.made_once import make_value_once

SCENARIO = Scenario.model_validate(
    {
        "shift": {
            "duration_h": 0.15,
            "logs": 2,
            "restart_s": 2.0,
            "damaged_logs": 1,
            "damage_share": 0.01,
            "topics": ["boom", "gnss"],
            "idle_share": 0.0,
        },
        "sensors": {"seed": 7},
    }
)
CHANNELS = """
[channels.boom_rad]
topic = "/boom/angles"
field = "position[boom]"

[channels.pitch_rad]
topic = "/imu/data"
derive = "pitch(orientation)"

[channels.latitude_deg]
topic = "/gnss/fix"
field = "latitude"

[channels.longitude_deg]
topic = "/gnss/fix"
field = "longitude"
"""
#: What a stranger may name a machine.
HOSTILE = "<script>alert(1)</script>"
_SHIPPED = Path(__file__).resolve().parents[2] / "replay/machines/cat262c.toml"


def _simulate_files() -> dict[str, bytes]:
    """The logs and the truth by their names."""
    with TemporaryDirectory(prefix="shift-") as place:
        simulate_scenario_to_logs(SCENARIO, Path(place, "shift.mcap"))
        return {path.name: path.read_bytes() for path in Path(place).iterdir()}


def shift_folder(folder: Path) -> tuple[list[Path], Path, dict[str, Any]]:
    """The logs, the machine file and what is true."""
    for name, data in make_value_once("the shift that is reviewed", _simulate_files).items():
        (folder / name).write_bytes(data)
    machine = folder / "yard.toml"
    shipped = _SHIPPED.read_text(encoding="utf-8")
    machine.write_text(
        shipped.replace('name = "Cat 262C"', f'name = "{HOSTILE}"') + CHANNELS, encoding="utf-8"
    )
    truth = json.loads(make_shift_truth_path(folder / "shift.mcap").read_text(encoding="utf-8"))
    return make_paths_of_simulated_logs(SCENARIO, folder / "shift.mcap"), machine, truth


def verdict(identity: str, more: str) -> str:
    """A reviewer's verdict on a cycle."""
    return f'[[cycle]]\nid = "{identity}"\nauthor = "R. Meier"\ntime = 2026-01-02T03:04:05Z\n{more}'
