"""The default that each setting had in each released version, for evidence from before it.

`released_defaults.json` has them by version: `python -m recordings.calibration.released_defaults`
prints those of this version. What is kept of a released version stays as it is.
"""

import json
import sys
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from importlib.metadata import version
from importlib.resources import files
from typing import Any, Final, get_args

from pydantic import BaseModel
from pydantic_core import PydanticUndefined, to_jsonable_python

from analysis.calibration.campaign.campaign_plan import CalibrationCampaign
from analysis.model.machine import Machine

_FILE: Final = "released_defaults.json"
#: Stands for the key of a table or the number of a row.
_ANY: Final = "*"
#: What begins the names of each part of evidence.
PARTS: Final[Mapping[str, type[BaseModel]]] = {"machine": Machine, "campaign": CalibrationCampaign}


def model_defaults(model: type[BaseModel], at: str) -> Iterator[tuple[str, Any]]:
    """Yield each setting of a model that has a default, dotted, with that as plain JSON.

    Args:
        model: the model.
        at: what the names begin with.
    """
    for name, field in model.model_fields.items():
        place = f"{at}.{name}"
        inner, several = model_of_field(field.annotation)
        if inner is not None:
            yield from model_defaults(inner, f"{place}.{_ANY}" if several else place)
        if inner is None or several:
            default = field.get_default(call_default_factory=True, validated_data={})
            if default is not PydanticUndefined:
                yield place, to_jsonable_python(default)


def model_of_field(annotation: Any) -> tuple[type[BaseModel] | None, bool]:
    """The model that a field holds, and whether it holds several."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation, False
    for each in get_args(annotation):
        inner, _ = model_of_field(each)
        if inner is not None:
            return inner, getattr(annotation, "__origin__", None) in (tuple, dict, list)
    return None, False


def present_defaults() -> dict[str, Any]:
    """The defaults of this version, by their dotted names."""
    return {name: value for at, part in PARTS.items() for name, value in model_defaults(part, at)}


@cache
def released_defaults() -> Mapping[str, Mapping[str, Any]]:
    """The defaults of each released version, the oldest first."""
    text = files("recordings.calibration").joinpath(_FILE).read_text(encoding="utf-8")
    return json.loads(text)


def first_released_default(name: str, kept: Mapping[str, Mapping[str, Any]]) -> tuple[bool, Any]:
    """The default that a setting had when it came; evidence from before it is to take that.

    Args:
        name: dotted, as in evidence: `machine.channels.speed_x_m_s.delay_s`.
        kept: `released_defaults`.

    Returns:
        Whether it is known, and the default.
    """
    for defaults in kept.values():
        for each, value in defaults.items():
            if _matches_pattern(each, name):
                return True, value
    return False, None


def _matches_pattern(pattern: str, name: str) -> bool:
    if _ANY not in pattern:
        return pattern == name
    parts, names = pattern.split("."), name.split(".")
    return len(parts) == len(names) and all(
        part in (_ANY, own) for part, own in zip(parts, names, strict=True)
    )


def find_absent_settings(kept: BaseModel, at: str = "") -> dict[str, Any]:
    """What came after evidence was made: dotted names, and the value that each has here.

    Args:
        kept: a part of the evidence.
        at: what its names begin with.
    """
    there = kept.model_dump(mode="json", exclude_unset=True)
    return dict(_find_absent(kept.model_dump(mode="json"), there, at))


def _find_absent(whole: Any, there: Any, at: str) -> Iterator[tuple[str, Any]]:
    if isinstance(whole, list) and isinstance(there, list):
        for number, (value, own) in enumerate(zip(whole, there, strict=True)):
            yield from _find_absent(value, own, f"{at}{number}.")
    if not isinstance(whole, dict) or not isinstance(there, dict):
        return
    for name, value in whole.items():
        if name not in there:
            yield f"{at}{name}", value
        else:
            yield from _find_absent(value, there[name], f"{at}{name}.")


def changed_defaults(
    absent: Mapping[str, Any], kept: Mapping[str, Mapping[str, Any]]
) -> dict[str, Any]:
    """Settings missing in evidence whose default has changed since they were released.

    Args:
        absent: as `absent_settings` gives them.
        kept: `released_defaults`.

    Returns:
        By dotted name, what evidence from before them is to be read with.
    """
    found: dict[str, Any] = {}
    for name, default in absent.items():
        first = _first_released_default(name, default, kept)
        if first != default:
            found[name] = first
    return found


def _first_released_default(name: str, default: Any, kept: Mapping[str, Mapping[str, Any]]) -> Any:
    """The first default of a setting, or of a whole part of them."""
    known, first = first_released_default(name, kept)
    if known:
        return first
    if isinstance(default, dict):
        return {
            key: _first_released_default(f"{name}.{key}", value, kept)
            for key, value in default.items()
        }
    return default


def insert_dotted_values(values: Mapping[str, Any], changed: Mapping[str, Any]) -> dict[str, Any]:
    """Plain values with some of them put in, by dotted names."""
    whole: dict[str, Any] = json.loads(json.dumps(values))
    for name, value in changed.items():
        inside, last = locate_value(whole, name)
        inside[last] = value
    return whole


def remove_dotted_values(values: dict[str, Any], names: Iterable[str]) -> dict[str, Any]:
    """The values without some of them, which are there, by dotted names."""
    for name in names:
        inside, last = locate_value(values, name)
        del inside[last]
    return values


def locate_value(values: Any, name: str) -> tuple[Any, str]:
    """What a dotted name is in, and its last part."""
    *path, last = name.split(".")
    for part in path:
        values = values[int(part)] if isinstance(values, list) else values[part]
    return values, last


if __name__ == "__main__":
    shown = {**released_defaults(), version("payscope"): present_defaults()}
    sys.stdout.write(json.dumps(shown, indent=1, ensure_ascii=False) + "\n")
