"""Fields of messages: parse a dotted name, and check it against the message definition."""

import re
from dataclasses import dataclass
from typing import Final

import polars as pl

from estimators.errors import suggest_choice
from replay.logs.messages.message_types import (
    COLUMN_DTYPES,
    ELEMENT_DTYPES,
    ListOf,
    RecordType,
    Scalar,
    iter_leaf_names,
)

#: What every frame has beside the fields.
OWN_COLUMNS: Final = ("log_time_ns", "header_stamp_ns")
#: `effort[]`: every element of a list.
ALL: Final = ""
_STEP = re.compile(r"(?P<name>[A-Za-z_]\w*)(?:\[(?P<element>[^\]]*)\])?(?:\.(?=.)|$)")


class FieldError(Exception):
    """A field cannot be read; one line with the reason and the choices."""


@dataclass(frozen=True, slots=True)
class PathStep:
    """Step from a message to one of its fields, or to list elements in it.

    `element` is None for the field itself, an index, a name at the same place in the message's list
    `name`, or `ALL`.
    """

    name: str
    element: int | str | None


@dataclass(frozen=True, slots=True)
class Field:
    """A requested field and its path."""

    name: str
    kind: str
    steps: tuple[PathStep, ...]

    @property
    def column_dtype(self) -> pl.DataType:
        """Type of its column, with a list for each `[]` in the path."""
        spreads = sum(step.element == ALL for step in self.steps)
        dtype = (ELEMENT_DTYPES if spreads else COLUMN_DTYPES)[self.kind]
        for _ in range(spreads):
            dtype = pl.List(dtype)
        return dtype


def resolve_message_field(name: str, record: RecordType) -> Field:
    """Find a field of a message type.

    Args:
        name: `angular_velocity.z`, `covariance[0]`, `effort[left]`, or a whole list, `effort[]`.
        record: message type.

    Raises:
        FieldError: the field does not exist, or is not a single value.
    """
    if name in OWN_COLUMNS:
        raise FieldError(
            f"'{name}' is a reserved column of every topic; a message field with this name cannot "
            "be read"
        )
    steps = _parse_field_path(name)
    here = Scalar("") if not steps else record
    walked = ""
    for step in steps:
        kind = here.type_of_field(step.name) if isinstance(here, RecordType) else None
        if kind is None:
            raise FieldError(f"no field {name!r}; {suggest_choice(name, iter_leaf_names(record))}")
        walked = f"{walked}.{step.name}".lstrip(".")
        if isinstance(kind, ListOf):
            assert isinstance(here, RecordType)
            _check_element(walked, step, kind, here)
            kind = kind.element
        elif step.element is not None:
            raise FieldError(f"'{walked}' is not a list; ask for it without [{step.element}]")
        walked += "" if step.element is None else f"[{step.element}]"
        here = kind
    if isinstance(here, RecordType):
        inside = ", ".join(f"{walked}.{leaf}" for leaf in iter_leaf_names(here))
        raise FieldError(f"'{name}' is a {here.name}; give one of {inside}")
    return Field(name, here.kind, steps)


def _parse_field_path(name: str) -> tuple[PathStep, ...]:
    steps: list[PathStep] = []
    at = 0
    while at < len(name) or not steps:
        match = _STEP.match(name, at)
        if match is None:
            raise FieldError(
                f"{name!r} is not a field name; write angular_velocity.z, covariance[0] or "
                "effort[left]"
            )
        steps.append(PathStep(match["name"], _parse_element_or_none(match["element"])))
        at = match.end()
    return tuple(steps)


def _parse_element_or_none(text: str | None) -> int | str | None:
    if text is None or not (text.isascii() and text.isdigit()):
        return text
    # lists count in 32 bits; Python refuses to read numbers of thousands of digits
    return int(text) if len(text) < 19 else 2**63 - 1


def _check_element(path_so_far: str, step: PathStep, kind: ListOf, parent: RecordType) -> None:
    by_name = f" or by name, {path_so_far}[NAME]" if parent.has_names else ""
    if step.element is None:
        raise FieldError(
            f"'{path_so_far}' is a list; pick an element by index, {path_so_far}[0]{by_name}"
        )
    if step.element == ALL:
        return
    if isinstance(step.element, str):
        if not parent.has_names:
            raise FieldError(
                f"'{path_so_far}[{step.element}]' selects by name, but {parent.name} has no list "
                f"'name'; select by index, {path_so_far}[0]"
            )
    elif kind.length is not None and step.element >= kind.length:
        raise FieldError(
            f"'{path_so_far}[{step.element}]' is out of range; it has {path_so_far}[0] to "
            f"{path_so_far}[{kind.length - 1}]"
        )
