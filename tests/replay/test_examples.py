"""The machine files in `examples` are machine files: every key, unit and expression of them."""

from pathlib import Path

import pytest

from replay import load_machine

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
MACHINES = sorted(
    path for path in EXAMPLES.glob("*.toml") if "\n[channels." in path.read_text(encoding="utf-8")
)
EMPTY_KG = {
    "wheel_loader": 13600.0,
    "load_haul_dump": 38500.0,
    "articulated_truck": 23100.0,
    "driving_excavator": 21500.0,
}


@pytest.mark.parametrize("path", MACHINES, ids=lambda path: path.stem)
def test_an_example_is_a_machine_file(path: Path) -> None:
    machine = load_machine(path)
    assert machine.machine.empty_mass_kg == EMPTY_KG.get(path.stem, machine.machine.empty_mass_kg)
    assert "speed_x_m_s" in machine.channels


def test_there_is_an_example_of_each_kind_of_machine() -> None:
    assert set(EMPTY_KG) <= {path.stem for path in MACHINES}
