"""Machine files: TOML in, a validated `Machine` out, every fault in one line."""

import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from analysis.machine import Machine
from analysis.schema import CHANNEL_COLUMNS
from analysis.units import to_si
from estimators.errors import MachineError, PayscopeError, nearest

M = TypeVar("M", bound=BaseModel)

_COLUMNS = {column.name: column for column in CHANNEL_COLUMNS}


def load_machine(path: str | Path, overrides: Iterable[str] = ()) -> Machine:
    """Read a machine file.

    Args:
        path: a TOML file.
        overrides: `key=value` with dotted keys, values as TOML writes them (a bare word is text).

    Raises:
        MachineError: one line with the file, the fault, the choices and the remedy.
    """
    path = Path(path)
    content = read_toml(path, MachineError)
    for override in overrides:
        _override(content, override)
    machine = validated(Machine, content, path, MachineError)
    for name, channel in machine.channels.items():
        if channel.unit is None:
            continue
        try:
            to_si(channel.unit, _COLUMNS[name].unit)
        except MachineError as error:
            raise MachineError(f"{path}: channels.{name}: {error}") from error
    return machine


def read_toml(path: Path, kind: type[PayscopeError]) -> dict[str, Any]:
    """The content of a TOML file; `kind` is raised when it cannot be read."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise kind(f"{path}: no such file") from error
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not a text file"
        raise kind(f"{path}: cannot be read: {reason}") from error
    except tomllib.TOMLDecodeError as error:
        raise kind(f"{path}: not valid TOML: {error}") from error


def validated(
    model: type[M], content: Mapping[str, Any], path: Path, kind: type[PayscopeError]
) -> M:
    """`content` as a `model`, or `kind` with the first fault in one line."""
    try:
        return model.model_validate(content)
    except ValidationError as error:
        fault = error.errors()[0]
        where = ".".join(str(part) for part in fault["loc"])
        if fault["type"] == "extra_forbidden":
            known = _fields_at(model, fault["loc"][:-1])
            raise kind(
                f"{path}: unknown key '{where}'; {nearest(str(fault['loc'][-1]), known)}"
            ) from error
        if fault["type"] == "missing":
            raise kind(f"{path}: '{where}' is missing") from error
        message = fault["msg"].removeprefix("Value error, ")
        given = fault["input"]
        shown = f" (given: {given!r})" if isinstance(given, str | int | float) else ""
        column = message.partition(":")[0].removeprefix("channels.")
        if message.endswith("no such column"):
            message += f"; {nearest(column, _COLUMNS)}"
        raise kind(f"{path}: {where + ': ' if where else ''}{message}{shown}") from error


def _fields_at(model: type[BaseModel], loc: tuple[int | str, ...]) -> list[str]:
    """The keys that are known at a place inside nested models."""
    here: Any = model
    for part in loc:
        if isinstance(here, type) and issubclass(here, BaseModel) and part in here.model_fields:
            here = here.model_fields[str(part)].annotation
            # dict[str, Channel]: the next part is the dictionary's key
            here = getattr(here, "__args__", (None, here))[1] if _is_dict(here) else here
    return list(here.model_fields) if hasattr(here, "model_fields") else []


def _is_dict(annotation: Any) -> bool:
    return getattr(annotation, "__origin__", None) is dict


def _override(content: dict[str, Any], override: str) -> None:
    key, equals, text = override.partition("=")
    if not equals or not key.strip():
        raise MachineError(f"--set {override}: write it as key=value, as settings.rate_hz=50")
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        value = text.strip()
    *sections, name = key.strip().split(".")
    place = content
    for section in sections:
        place = place.setdefault(section, {})
        if not isinstance(place, dict):
            raise MachineError(f"--set {override}: '{section}' is a value, not a section")
    place[name] = value
