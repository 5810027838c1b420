"""TOML files into models, with errors of one line that name the key and the nearest known one."""

import reprlib
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError

from estimators.errors import PayscopeError, nearest

_IN_TOML = {
    "tuple_type": "input should be a list",
    "model_type": "input should be a table",
    "dict_type": "input should be a table",
}
_Model = TypeVar("_Model", bound=BaseModel)


def read_model(path: Path, model: type[_Model], error: type[PayscopeError]) -> _Model:
    """Read a TOML file as `model`.

    Raises:
        PayscopeError: as `error`: the file cannot be read, is no TOML, has an unknown key (with
            the nearest known one) or a value that does not fit.
    """
    return validate(path, read_toml(path, error), model, error)


def read_toml(path: Path, error: type[PayscopeError]) -> dict[str, Any]:
    """The content of a TOML file; `error` in one line where there is none."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as fault:
        raise error(f"{path}: cannot be read ({fault.strerror})") from None
    except UnicodeDecodeError:
        raise error(f"{path}: is no TOML: not UTF-8") from None
    except ValueError as fault:  # a TOMLDecodeError, or a number of thousands of digits
        raise error(f"{path}: is no TOML: {fault}") from None


def read_value(text: str) -> Any:
    """A value as TOML writes it; a bare word is text."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text.strip()


def validate(
    path: Path, values: Mapping[str, Any], model: type[_Model], error: type[PayscopeError]
) -> _Model:
    """The content of the file at `path` as `model`; `error` in one line where it does not fit."""
    try:
        return model.model_validate(values)
    except ValidationError as fault:
        raise error(f"{path}: {explain(fault, model)}") from None


def explain(fault: ValidationError, model: type[BaseModel]) -> str:
    """Say in one line what is wrong, where, and what was probably meant."""
    details = fault.errors(include_url=False)
    first = details[0]
    location, kind = first["loc"], first["type"]
    key = ".".join(str(part) for part in location)
    if kind == "extra_forbidden":
        text = f"unknown key '{key}'; {nearest(str(location[-1]), _keys(model, location[:-1]))}"
    elif kind == "value_error":
        message = str(first.get("ctx", {}).get("error", first["msg"]))
        text = f"{key}: {message}" if key else message
    elif kind == "missing":
        text = f"{key}: is missing"
    else:
        # what pydantic calls by Python's names
        message = _IN_TOML.get(kind, first["msg"])
        text = f"{key}: {message[:1].lower()}{message[1:]}, not {reprlib.repr(first['input'])}"
    others = len(details) - 1
    # a quoted key may hold line breaks
    return " ".join(f"{text} (and {others} more)".split() if others else text.split())


def _keys(model: type[BaseModel], location: Sequence[int | str]) -> list[str]:
    """The keys that the table at `location` may have."""
    here: Any = model
    for part in location:
        if isinstance(here, type) and issubclass(here, BaseModel):
            here = here.model_fields[str(part)].annotation
        else:  # a table of tables: dict[str, Model]
            here = get_args(here)[-1]
    return list(here.model_fields)
