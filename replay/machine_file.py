"""Machine files: TOML in, a validated `Machine` out, every fault in one line."""

from collections.abc import Iterable
from pathlib import Path

from analysis.machine import Machine
from analysis.schema import CHANNEL_COLUMNS
from analysis.settings import Settings
from analysis.units import to_si
from estimators.errors import MachineError
from replay.readers import TimeAxis
from replay.toml_file import read_toml, set_value, validate

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
    try:
        Settings.refuse_moved(content.get("settings"))
    except ValueError as error:
        raise MachineError(f"{path}: settings: {error}") from None
    for override in overrides:
        set_value(content, override, MachineError)
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
