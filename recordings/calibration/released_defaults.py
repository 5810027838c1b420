"""Defaults of settings in each released version, for evidence that is older than a setting.

`released_defaults.json` has them by version: `python -m recordings.calibration.released_defaults`
prints the defaults of this version. The defaults of a released version never change.
"""

import json
import sys
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from importlib.metadata import version
from importlib.resources import files
from typing import Any, Final, NamedTuple, get_args

from pydantic import BaseModel
from pydantic_core import PydanticUndefined, to_jsonable_python

from analysis.calibration.campaign.campaign_plan import CalibrationCampaign
from analysis.model.machine import Machine

_FILE: Final = "released_defaults.json"
#: Stands for the key of a table or the number of a row.
_ANY: Final = "*"
#: Model of each part of evidence, by the first part of its dotted names.
PARTS: Final[Mapping[str, type[BaseModel]]] = {"machine": Machine, "campaign": CalibrationCampaign}


def iter_defaults_of_model(model: type[BaseModel], prefix: str) -> Iterator[tuple[str, Any]]:
    """Yield each setting of a model with its default, by dotted name.

    Args:
        model: the model.
        prefix: prefix of the names.
    """
    for name, field in model.model_fields.items():
        place = f"{prefix}.{name}"
        inner, several = find_pydantic_model_in_annotation(field.annotation)
        if inner is not None:
            yield from iter_defaults_of_model(inner, f"{place}.{_ANY}" if several else place)
        if inner is None or several:
            default = field.get_default(call_default_factory=True, validated_data={})
            if default is not PydanticUndefined:
                yield place, to_jsonable_python(default)


class AnnotatedModel(NamedTuple):
    """Model in a type annotation, and whether a field of this type holds several."""

    model: type[BaseModel] | None
    is_collection: bool


def find_pydantic_model_in_annotation(annotation: Any) -> AnnotatedModel:
    """Find the model in a field's annotation, None without one; and whether there are several."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return AnnotatedModel(annotation, False)
    for each in get_args(annotation):
        inner, _ = find_pydantic_model_in_annotation(each)
        if inner is not None:
            return AnnotatedModel(
                inner, getattr(annotation, "__origin__", None) in (tuple, dict, list)
            )
    return AnnotatedModel(None, False)


def collect_defaults_of_this_version() -> dict[str, Any]:
    """Collect the defaults of this version, by dotted name."""
    return {
        name: value
        for at, part in PARTS.items()
        for name, value in iter_defaults_of_model(part, at)
    }


@cache
def load_released_defaults() -> Mapping[str, Mapping[str, Any]]:
    """Load the defaults of each released version, the oldest first."""
    text = files("recordings.calibration").joinpath(_FILE).read_text(encoding="utf-8")
    return json.loads(text)


class ReleasedDefault(NamedTuple):
    """Default with which a setting was released, if it was."""

    is_released: bool
    value: Any


def find_earliest_default_of_setting(
    dotted_name: str, released_versions: Mapping[str, Mapping[str, Any]]
) -> ReleasedDefault:
    """Find the default with which a setting was introduced, for evidence that is older.

    Args:
        dotted_name: dotted name, as in evidence: `machine.channels.speed_x_m_s.delay_s`.
        released_versions: `released_defaults`.

    Returns:
        Whether it is known, and the default.
    """
    for defaults in released_versions.values():
        for each, value in defaults.items():
            if _does_name_match_pattern(each, dotted_name):
                return ReleasedDefault(True, value)
    return ReleasedDefault(False, None)


def _does_name_match_pattern(pattern: str, name: str) -> bool:
    if _ANY not in pattern:
        return pattern == name
    parts, names = pattern.split("."), name.split(".")
    return len(parts) == len(names) and all(
        part in (_ANY, own) for part, own in zip(parts, names, strict=True)
    )


def list_settings_absent_in_evidence(evidence_part: BaseModel, prefix: str = "") -> dict[str, Any]:
    """List the settings that a part of evidence does not state: dotted names and present values.

    Args:
        evidence_part: a part of the evidence.
        prefix: prefix of the names.
    """
    there = evidence_part.model_dump(mode="json", exclude_unset=True)
    return dict(
        iter_values_absent_in_evidence(evidence_part.model_dump(mode="json"), there, prefix)
    )


def iter_values_absent_in_evidence(
    all_values: Any, evidence_values: Any, prefix: str
) -> Iterator[tuple[str, Any]]:
    """Yield dotted names that the evidence lacks, with their values."""
    if isinstance(all_values, list) and isinstance(evidence_values, list):
        for number, (value, own) in enumerate(zip(all_values, evidence_values, strict=True)):
            yield from iter_values_absent_in_evidence(value, own, f"{prefix}{number}.")
    if not isinstance(all_values, dict) or not isinstance(evidence_values, dict):
        return
    for name, value in all_values.items():
        if name not in evidence_values:
            yield f"{prefix}{name}", value
        else:
            yield from iter_values_absent_in_evidence(
                value, evidence_values[name], f"{prefix}{name}."
            )


def list_absent_settings_changed_since(
    absent_settings: Mapping[str, Any], released_versions: Mapping[str, Mapping[str, Any]]
) -> dict[str, Any]:
    """List the settings absent in evidence whose default has changed since their introduction.

    Args:
        absent_settings: settings from `list_settings_absent_in_evidence`.
        released_versions: `released_defaults`.

    Returns:
        Value to read the evidence with, by dotted name.
    """
    found: dict[str, Any] = {}
    for name, default in absent_settings.items():
        first = _collect_first_released_defaults(name, default, released_versions)
        if first != default:
            found[name] = first
    return found


def _collect_first_released_defaults(
    setting_name: str, present_default: Any, released_versions: Mapping[str, Mapping[str, Any]]
) -> Any:
    """Collect the first default of a setting, or of each setting of a section."""
    known, first = find_earliest_default_of_setting(setting_name, released_versions)
    if known:
        return first
    if isinstance(present_default, dict):
        return {
            key: _collect_first_released_defaults(f"{setting_name}.{key}", value, released_versions)
            for key, value in present_default.items()
        }
    return present_default


def replace_dotted_values(
    values: Mapping[str, Any], new_values: Mapping[str, Any]
) -> dict[str, Any]:
    """Copy values with some replaced, by dotted name."""
    whole: dict[str, Any] = json.loads(json.dumps(values))
    for name, value in new_values.items():
        inside, last = find_parent_of_dotted_value(whole, name)
        inside[last] = value
    return whole


def remove_dotted_values(values: dict[str, Any], dotted_names: Iterable[str]) -> dict[str, Any]:
    """Remove some existing values, by dotted name, and return the same table."""
    for name in dotted_names:
        inside, last = find_parent_of_dotted_value(values, name)
        del inside[last]
    return values


class DottedPlace(NamedTuple):
    """Table or list that holds a dotted value, and its key there."""

    parent: Any
    key: str


def find_parent_of_dotted_value(values: Any, dotted_name: str) -> DottedPlace:
    """Find the table or list with a dotted name's value, and the value's key in it."""
    *path, last = dotted_name.split(".")
    for part in path:
        values = values[int(part)] if isinstance(values, list) else values[part]
    return DottedPlace(values, last)


if __name__ == "__main__":
    shown = {**load_released_defaults(), version("payscope"): collect_defaults_of_this_version()}
    sys.stdout.write(json.dumps(shown, indent=1, ensure_ascii=False) + "\n")
