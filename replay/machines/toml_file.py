"""Validate TOML files as models, with errors of one line that suggest the nearest known key."""

import json
import re
import reprlib
import tomllib
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Final, NamedTuple, TypeVar, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError

from analysis.model.physical_units import split_unit_from_name
from estimators.errors import PayscopeError, format_count, suggest_choice
from replay.machines.old_names import (
    OLD_NAMES,
    OldKeyError,
    OldNameWarning,
    describe_renamed_keys_in_line,
    rename_old_keys_in_content,
)

_IN_TOML = {
    "tuple_type": "input should be a list",
    "model_type": "input should be a table",
    "dict_type": "input should be a table",
    "model_attributes_type": "input should be a table",
}
#: A number with a decimal comma as the value of a key.
_DECIMAL_COMMA: Final = re.compile(r"^[^\[#\"=]*= *(-?\d+),(\d+) *(?:#.*)?$", re.M)
#: Kinds of payscope's TOML files, each with the tables that only it has.
_KINDS: Final = {
    "a machine file": ("channels",),
    "a campaign file of `payscope calibrate`": ("masses", "runs"),
    "a fleet file of `payscope fleet`": ("fleet", "machines"),
    "a scenario file of `payscope simulate`": ("sensors", "shift"),
    "a campaign file or a scenario file": ("campaign",),
}
#: Largest signed integer of 64 bits, as compiled code requires; Python's TOML parser has no bound.
LARGEST_INTEGER: Final = 2**63 - 1
_Model = TypeVar("_Model", bound=BaseModel)


def read_toml_file(path: Path, error_type: type[PayscopeError]) -> dict[str, Any]:
    """Read a TOML file, with former keys renamed to their present names.

    Warns:
        OldNameWarning: a key has its former name.

    Raises:
        PayscopeError: of type `error_type`, in one line: there is no such file, it is not TOML, or
            it has a key under both its former and its present name.
    """
    text = ""
    try:
        # with the byte order mark that some editors write
        text = path.read_text(encoding="utf-8-sig")
        content = tomllib.loads(text)
    except OSError as fault:
        raise error_type(f"{path}: cannot be read ({fault.strerror})") from None
    except UnicodeDecodeError:
        raise error_type(f"{path}: is not UTF-8; save it as UTF-8") from None
    except ValueError as fault:  # a TOMLDecodeError, or an integer of thousands of digits
        comma = _DECIMAL_COMMA.search(text)
        remedy = f"; write {comma[1]}.{comma[2]}, with a decimal point" if comma else ""
        raise error_type(f"{path}: is not TOML: {fault}{remedy}") from None
    try:
        renamed = rename_old_keys_in_content(content)
    except OldKeyError as fault:
        raise error_type(f"{path}: {fault}") from None
    if renamed:
        remedy = f"`payscope migrate {path}` rewrites the file"
        warnings.warn(
            f"{path}: {describe_renamed_keys_in_line(renamed)}; {remedy}",
            OldNameWarning,
            stacklevel=3,
        )
    return content


def refuse_other_kind_of_file(
    path: Path, content: Mapping[str, Any], expected_kind: str, error_type: type[PayscopeError]
) -> None:
    """Raise an error for another kind of file, such as a campaign file given as a machine file.

    Raises:
        PayscopeError: of type `error_type`; it states the kind of the file; if a machine file is
            expected, also the one that the file names.
    """
    found = next((k for k, tables in _KINDS.items() if any(each in content for each in tables)), "")
    if not found or expected_kind in found:
        return
    body = content.get("machine")
    named = (
        body.get("file") if expected_kind == "machine file" and isinstance(body, Mapping) else None
    )
    remedy = f"; the machine file that it names is {named}" if isinstance(named, str) else ""
    raise error_type(f"{path}: is {found}, not a {expected_kind}{remedy}")


def parse_toml_value(text: str) -> Any:
    """Parse a TOML value; a bare word is text."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except ValueError:  # a TOMLDecodeError, or an integer of thousands of digits
        return text.strip()


def format_toml(value: object) -> str:
    """Format a value as TOML; numbers, texts and lists of them are formatted as in JSON."""
    if isinstance(value, Mapping):
        inside = ", ".join(f"{key} = {format_toml(each)}" for key, each in value.items())
        return f"{{ {inside} }}"
    return json.dumps(value, ensure_ascii=False)


def set_dotted_key_in_content(
    content: dict[str, Any], override: str, error_type: type[PayscopeError]
) -> None:
    """Set `key=value` in `content`: a dotted key, and a TOML value or a bare word.

    Raises:
        PayscopeError: of type `error_type`: the override has another form, or a parent of the key
            is a value instead of a section.
    """
    key, equals, text = override.partition("=")
    if not equals or not key.strip():
        raise error_type(
            f"--set {override}: write it as key=value, such as settings.align.rate_hz=50"
        )
    value = parse_toml_value(text)
    key = key.strip()
    if key in OLD_NAMES:
        warnings.warn(
            f"--set {override}: {describe_renamed_keys_in_line({key: OLD_NAMES[key]})}",
            OldNameWarning,
            stacklevel=3,
        )
    *sections, name = OLD_NAMES.get(key, key).split(".")
    place = content
    for section in sections:
        place = place.setdefault(section, {})
        if not isinstance(place, dict):
            raise error_type(f"--set {override}: '{section}' is a value there, not a section")
    place[name] = value


def validate_toml_content(
    path: Path, values: Mapping[str, Any], model: type[_Model], error_type: type[PayscopeError]
) -> _Model:
    """Validate the content of the file at `path` as `model`.

    Raises:
        PayscopeError: of type `error_type`, in one line: a key is unknown (with the nearest known
            one), or a value is invalid.
    """
    for key, number in _iter_integers_by_dotted_key(values):
        if not -LARGEST_INTEGER <= number <= LARGEST_INTEGER:
            raise error_type(
                f"{path}: {key}: input should be an integer of at most 64 bits, the most that TOML "
                f"allows, not one of {len(f'{abs(number)}')} digits"
            )
    try:
        return model.model_validate(values)
    except ValidationError as fault:
        raise error_type(f"{path}: {explain_validation_fault(fault, model)}") from None


def _iter_integers_by_dotted_key(content: Any, key: str = "") -> Iterator[tuple[str, int]]:
    if isinstance(content, Mapping):
        for name, value in content.items():
            yield from _iter_integers_by_dotted_key(value, f"{key}.{name}" if key else name)
    elif isinstance(content, list | tuple):
        for value in content:
            yield from _iter_integers_by_dotted_key(value, key)
    elif isinstance(content, int):
        yield key, content


def explain_validation_fault(validation_fault: ValidationError, model: type[BaseModel]) -> str:
    """State in one line which value is wrong, where it is, and the probable intention."""
    details = validation_fault.errors(include_url=False)
    # a misspelt required key is also reported as missing
    first = next((each for each in details if each["type"] == "extra_forbidden"), details[0])
    location, kind, why = first["loc"], first["type"], first.get("ctx", {})
    steps, table = find_keys_and_model_of_location(
        model, location[:-1] if kind == "extra_forbidden" else location
    )
    key = ".".join(steps)
    if kind == "extra_forbidden":
        key, last = ".".join([*steps, str(location[-1])]), str(location[-1])
        text = f"unknown key '{key}'; {suggest_choice(last, table.model_fields if table else ())}"
    elif kind == "union_tag_invalid":
        known = str(why["expected_tags"]).replace("'", "").split(", ")
        choice = suggest_choice(why["tag"], known)
        text = f"{key}: unknown {why['discriminator']} '{why['tag']}'; {choice}"
    elif kind == "union_tag_not_found":
        text = f"{key}: {why['discriminator']} is missing"
    elif kind == "value_error":
        message = str(why.get("error", first["msg"]))
        text = f"{key}: {message}" if key else message
    elif kind == "missing":
        text = f"{key}: is missing"
    else:
        # messages in which pydantic uses Python's names
        message = _IN_TOML.get(kind, first["msg"])
        text = f"{key}: {message[:1].lower()}{message[1:]}, not {reprlib.repr(first['input'])}"
        if kind == "tuple_type" and isinstance(first["input"], str):
            text += f": write {format_toml([first['input']])}"
        if kind.startswith("less_than") and steps:
            text += _describe_unit_of_key(steps[-1])
    others = len(details) - 1
    # a quoted key may contain line breaks
    return " ".join(
        f"{text} (and {format_count(others, 'more fault')})".split() if others else text.split()
    )


def _describe_unit_of_key(key: str) -> str:
    """Say in which unit a key is, which a value that is too large may not be; empty if unknown."""
    if key.endswith("_u"):
        return "; it is relative: 0.01 is 1 %"
    unit = split_unit_from_name(key)[1]
    return f"; it is in {unit}" if unit else ""


class LocatedKeys(NamedTuple):
    """Keys of a location in a validation error, and the model of their table; None if unknown."""

    keys: list[str]
    model: type[BaseModel] | None


def find_keys_and_model_of_location(
    model: type[BaseModel], location: Sequence[int | str]
) -> LocatedKeys:
    """Find the keys of an error's location, without pydantic's union tags, and the model there."""
    here: Any = model
    keys: list[str] = []
    for part in location:
        table = find_tagged_pydantic_model_in_annotation(here, part)
        if table is not None and part not in table.model_fields:
            here = table  # `part` is the tag that selected this table
            continue
        keys.append(str(part))
        arguments = get_args(here)
        if table is not None:
            here = table.model_fields[str(part)].annotation
        else:  # a list, tuple or table of tables
            here = (
                (arguments[-1] if get_origin(here) is dict else arguments[0]) if arguments else None
            )
    return LocatedKeys(keys, find_tagged_pydantic_model_in_annotation(here))


def find_tagged_pydantic_model_in_annotation(
    annotation: Any, tag: int | str | None = None
) -> type[BaseModel] | None:
    """Find the model in a type annotation; in a union, that with discriminator `tag`; else None."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    if get_origin(annotation) is Annotated:
        return find_tagged_pydantic_model_in_annotation(get_args(annotation)[0], tag)
    if get_origin(annotation) not in (Union, UnionType):
        return None
    tables = [
        table
        for table in map(find_tagged_pydantic_model_in_annotation, get_args(annotation))
        if table
    ]
    if len(tables) == 1:
        return tables[0]
    tagged = [t for t in tables if any(f.default == tag for f in t.model_fields.values())]
    return tagged[0] if tagged else None
