"""The machine files in `examples` are machine files: every key, unit and expression of them."""

import re
from pathlib import Path

import pytest

from analysis.stages.signals.derive import parse_derivation_in_si
from replay import load_machine

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
MACHINES = sorted(
    path for path in EXAMPLES.glob("*.toml") if "\n[channels." in path.read_text(encoding="utf-8")
)
PAGE = EXAMPLES.parent / "docs" / "from-your-own-table.md"
ON_THE_PAGE = re.findall(r"```toml\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
EMPTY_KG = {
    "wheel_loader": 13600.0,
    "load_haul_dump": 38500.0,
    "articulated_truck": 23100.0,
    "driving_excavator": 21500.0,
}


@pytest.mark.parametrize("path", MACHINES, ids=lambda path: path.stem)
def test_an_example_is_a_machine_file(path: Path) -> None:
    machine = load_machine(path)
    for name, channel in machine.channels.items():
        assert channel.expression is None or parse_derivation_in_si(name, machine)
    assert machine.machine.empty_mass_kg == EMPTY_KG.get(path.stem, machine.machine.empty_mass_kg)
    assert "speed_x_m_s" in machine.channels


def test_there_is_an_example_of_each_kind_of_machine() -> None:
    assert set(EMPTY_KG) <= {path.stem for path in MACHINES}


@pytest.mark.parametrize("text", ON_THE_PAGE, ids=range(len(ON_THE_PAGE)))
def test_a_machine_of_the_page_is_a_machine_file_and_its_units_fit(
    tmp_path: Path, text: str
) -> None:
    path = tmp_path / "machine.toml"
    path.write_text(text, encoding="utf-8")
    machine = load_machine(path)
    for name, channel in machine.channels.items():
        assert channel.expression is None or parse_derivation_in_si(name, machine)


def test_the_page_has_twelve_machines() -> None:
    whole = re.findall(r"\.\./examples/(\w+)\.toml", PAGE.read_text(encoding="utf-8"))
    assert len(ON_THE_PAGE) + len(whole) == 12
    assert set(whole) == set(EMPTY_KG)
