"""Read machine files in TOML and validate them as `Machine`, with errors of one line."""

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from analysis.model.machine import LogSection, Machine
from analysis.model.physical_units import find_gain_and_offset_to_si
from analysis.model.settings import Settings
from analysis.stages.signals.derive import find_unit_in_name, parse_derivation_in_si
from estimators.errors import MachineError
from replay.logs import TableHints, TimeAxis
from replay.machines.toml_file import (
    read_toml_file,
    refuse_other_kind_of_file,
    set_dotted_key_in_content,
    validate_toml_content,
)

_SHIPPED = Path(__file__).parent


def load_machine(path: str | Path, overrides: Iterable[str] = ()) -> Machine:
    """Read a machine file.

    Args:
        path: a TOML file, or the name of one that payscope ships (`cat262c.toml`).
        overrides: `key=value` with dotted keys, values as TOML writes them (a bare word is text).

    Warns:
        OldNameWarning: a key has its former name; `payscope migrate` rewrites the file.

    Raises:
        MachineError: one line with the file, the fault, the choices and the remedy.
    """
    path = find_machine_file_or_shipped_one(Path(path))
    if not path.exists():
        shipped = ", ".join(sorted(each.name for each in _SHIPPED.glob("*.toml")))
        raise MachineError(
            f"{path}: no such machine file; shipped with payscope: {shipped}; "
            f"`payscope init LOG -o {path}` drafts one"
        )
    content = read_toml_file(path, MachineError)
    refuse_other_kind_of_file(path, content, "machine file", MachineError)
    for override in overrides:
        refuse_setting_without_prefix(override)
        set_dotted_key_in_content(content, override, MachineError)
    machine = validate_toml_content(path, content, Machine, MachineError)
    for name, channel in machine.channels.items():
        try:
            if channel.expression is not None:
                parse_derivation_in_si(name, machine)
            elif channel.unit is not None:
                find_gain_and_offset_to_si(channel.unit, find_unit_in_name(name))
        except MachineError as error:
            said = str(error)
            where = "" if said.startswith("channels.") else f"channels.{name}: "
            raise MachineError(f"{path}: {where}{said}") from error
    return machine


def refuse_setting_without_prefix(override: str) -> None:
    """Raise an error for a setting without its prefix `settings.`, and name the full key."""
    key = override.partition("=")[0].strip()
    first, _, rest = key.partition(".")
    if first in Machine.model_fields:
        return
    parts = Settings.list_stage_models()
    meant = [f"{stage}.{first}" for stage, part in parts.items() if first in part.model_fields]
    if first in parts and rest:
        meant = [key]
    if meant:
        raise MachineError(f"--set {override}: no such key; did you mean 'settings.{meant[0]}'?")


def find_time_axis_of_machine(machine: Machine) -> TimeAxis | None:
    """Time axis of tables as given by the machine file; None if it gives none."""
    return find_time_axis_of_section(machine.log)


def find_time_axis_of_section(log_section: LogSection) -> TimeAxis | None:
    """Time column, its unit and the table dialect of `[log]`; None if it gives none of them."""
    given = log_section.model_dump()
    time, unit = given.pop("time", None), given.pop("time_unit", None)
    if time is None and unit is None and not given:
        return None
    return TimeAxis(time, unit, TableHints(**given))


def find_machine_file_or_shipped_one(path: Path) -> Path:
    """Find a machine file, or the shipped one of that name if there is no such file."""
    shipped = _SHIPPED / path.name
    return shipped if not path.exists() and path == Path(path.name) and shipped.exists() else path


class FileState(NamedTuple):
    """Modification time, size and inode, by which a changed or replaced file is recognised."""

    modified_ns: int
    size_bytes: int
    inode: int


def read_file_state(path: Path) -> FileState | None:
    """Read modification time, size and inode of a file; None if it is absent."""
    try:
        about = path.stat()
    except OSError:
        return None
    return FileState(about.st_mtime_ns, about.st_size, about.st_ino)
