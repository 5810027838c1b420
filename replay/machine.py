"""Machine files: TOML in, a validated `Machine` out, every fault in one line."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from analysis.machine import Machine
from analysis.schema import CHANNEL_COLUMNS
from analysis.units import to_si
from estimators.errors import MachineError
from replay.readers.protocol import TimeAxis
from replay.toml_file import read_toml, read_value, validate

_SHIPPED = Path(__file__).parent / "machines"
_COLUMNS = {column.name: column for column in CHANNEL_COLUMNS}


def load_machine(path: str | Path, overrides: Iterable[str] = ()) -> Machine:
    """Read a machine file.

    Args:
        path: a TOML file, or the name of one that payscope ships (`cat262c.toml`).
        overrides: `key=value` with dotted keys, values as TOML writes them (a bare word is text).

    Raises:
        MachineError: one line with the file, the fault, the choices and the remedy.
    """
    path = machine_path(Path(path))
    content = read_toml(path, MachineError)
    for override in overrides:
        _override(content, override)
    machine = validate(path, content, Machine, MachineError)
    for name, channel in machine.channels.items():
        if channel.unit is None:
            continue
        try:
            to_si(channel.unit, _COLUMNS[name].unit)
        except MachineError as error:
            raise MachineError(f"{path}: channels.{name}: {error}") from error
    return machine


def time_axis(machine: Machine) -> TimeAxis | None:
    """Where the machine file says that tables keep their time."""
    section = machine.log
    return TimeAxis(section.time, section.time_unit) if section.time else None


def machine_path(path: Path) -> Path:
    """The file itself, or the shipped machine file of that name where there is no such file."""
    shipped = _SHIPPED / path.name
    return shipped if not path.exists() and path == Path(path.name) and shipped.exists() else path


def _override(content: dict[str, Any], override: str) -> None:
    key, equals, text = override.partition("=")
    if not equals or not key.strip():
        raise MachineError(f"--set {override}: write it as key=value, as settings.rate_hz=50")
    value = read_value(text)
    *sections, name = key.strip().split(".")
    place = content
    for section in sections:
        place = place.setdefault(section, {})
        if not isinstance(place, dict):
            raise MachineError(f"--set {override}: '{section}' is a value, not a section")
    place[name] = value
