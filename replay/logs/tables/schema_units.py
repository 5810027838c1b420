"""Units of columns that stand in the metadata of a file, not of its fields.

Three forms are in use: one key a column (`speed.unit`, `unit:speed`), a map under `units`, and the
attributes of a pandas frame (`DataFrame.attrs`, which pandas writes as `PANDAS_ATTRS`).
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from analysis.model.physical_units import spelt_unit

_MAPS: Final = ("units", "unit", "column_units")
_OF_A_COLUMN: Final = (
    "{}.unit",
    "{}.units",
    "{}_unit",
    "{}:unit",
    "unit:{}",
    "unit.{}",
    "units.{}",
)
#: Keys under which a library keeps JSON of its own; pandas' column list has units in `metadata`.
_ATTRIBUTES: Final = ("PANDAS_ATTRS", "attrs", "pandas")


def units_of_schema(metadata: Mapping[str, str], names: Sequence[str]) -> dict[str, str]:
    """The units that a file's metadata state, by column, as pint calls them.

    Args:
        metadata: of the file, as text.
        names: of its columns.
    """
    found: dict[str, str] = {}
    for name, text in _stated_unit(metadata, names):
        unit = spelt_unit(text)
        if unit is not None:
            found.setdefault(name, unit)
    return found


def _stated_unit(metadata: Mapping[str, str], names: Sequence[str]) -> Iterator[tuple[str, str]]:
    for name in names:
        keys = (form.format(name) for form in _OF_A_COLUMN)
        yield from ((name, metadata[key]) for key in keys if key in metadata)
    known = frozenset(names)
    for key in _MAPS:
        yield from _of_map(_json(metadata.get(key)), known)
    for key in _ATTRIBUTES:
        yield from _of_attributes(_json(metadata.get(key)), known)


def _of_attributes(attributes: Any, known: frozenset[str]) -> Iterator[tuple[str, str]]:
    """A map of units among them, a map a column, or a list of columns with `metadata`."""
    if not isinstance(attributes, dict):
        return
    for key in _MAPS:
        yield from _of_map(attributes.get(key), known)
    yield from _of_map(attributes, known)
    columns = attributes.get("columns")
    for column in columns if isinstance(columns, list) else ():
        if isinstance(column, dict) and isinstance(column.get("name"), str):
            yield from _of_map({column["name"]: column.get("metadata")}, known)


def _of_map(units: Any, known: frozenset[str]) -> Iterator[tuple[str, str]]:
    """`{"speed": "km/h"}`, or `{"speed": {"unit": "km/h"}}`."""
    for name, stated in units.items() if isinstance(units, dict) else ():
        if name not in known:
            continue
        if isinstance(stated, dict):
            stated = next((stated[key] for key in _MAPS if key in stated), None)
        if isinstance(stated, str):
            yield name, stated


def _json(text: str | None) -> Any:
    """What a text holds; None where it is no JSON, or nested beyond what Python reads."""
    try:
        return json.loads(text) if text else None
    except (ValueError, RecursionError):
        return None
