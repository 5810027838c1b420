"""Fields of messages: parse a dotted name, and resolve it in the message type."""

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
    iter_leaf_paths_of_message_type,
)

#: Columns of every frame besides the fields.
OWN_COLUMNS: Final = ("log_time_ns", "header_stamp_ns")
#: `effort[]`: every element of a list.
ALL: Final = ""
_STEP = re.compile(r"(?P<name>[A-Za-z_]\w*)(?:\[(?P<element>[^\]]*)\])?(?:\.(?=.)|$)")


class FieldError(Exception):
    """Raised if a field cannot be read; one line with the reason and the choices."""


@dataclass(frozen=True, slots=True)
class PathStep:
    """Step from a message to one of its fields, or to list elements in it.

    `element` is None for the field itself; or an index, a name whose index is that in the message's
    list `name`, or `ALL`.
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
        """Data type of its column, with a list for each `[]` in the path."""
        spreads = sum(step.element == ALL for step in self.steps)
        dtype = (ELEMENT_DTYPES if spreads else COLUMN_DTYPES)[self.kind]
        for _ in range(spreads):
            dtype = pl.List(dtype)
        return dtype


def resolve_message_field(field_path: str, record: RecordType) -> Field:
    """Find a field of a message type.

    Args:
        field_path: `angular_velocity.z`, `covariance[0]`, `effort[left]`, or a whole list,
            `effort[]`.
        record: message type.

    Raises:
        FieldError: the field does not exist, or is not a single value.
    """
    if field_path in OWN_COLUMNS:
        raise FieldError(
            f"'{field_path}' is a reserved column of every topic; a message field with this name "
            "cannot be read"
        )
    steps = _parse_field_path(field_path)
    here = Scalar("") if not steps else record
    walked = ""
    for step in steps:
        kind = here.type_of_field(step.name) if isinstance(here, RecordType) else None
        if kind is None:
            raise FieldError(
                f"no field {field_path!r}; "
                f"{suggest_choice(field_path, iter_leaf_paths_of_message_type(record))}"
            )
        walked = f"{walked}.{step.name}".lstrip(".")
        if isinstance(kind, ListOf):
            assert isinstance(here, RecordType)
            _refuse_invalid_list_element(walked, step, kind, here)
            kind = kind.element
        elif step.element is not None:
            raise FieldError(f"'{walked}' is not a list; ask for it without [{step.element}]")
        walked += "" if step.element is None else f"[{step.element}]"
        here = kind
    if isinstance(here, RecordType):
        inside = ", ".join(f"{walked}.{leaf}" for leaf in iter_leaf_paths_of_message_type(here))
        raise FieldError(f"'{field_path}' is a {here.name}; give one of {inside}")
    return Field(field_path, here.kind, steps)


def _parse_field_path(field_path: str) -> tuple[PathStep, ...]:
    steps: list[PathStep] = []
    at = 0
    while at < len(field_path) or not steps:
        match = _STEP.match(field_path, at)
        if match is None:
            raise FieldError(
                f"{field_path!r} is not a field name; write angular_velocity.z, covariance[0] or "
                "effort[left]"
            )
        steps.append(PathStep(match["name"], _parse_element_index_or_name(match["element"])))
        at = match.end()
    return tuple(steps)


def _parse_element_index_or_name(text: str | None) -> int | str | None:
    if text is None or not (text.isascii() and text.isdigit()):
        return text
    # lengths of lists fit into 32 bits; Python refuses to parse numbers of thousands of digits
    return int(text) if len(text) < 19 else 2**63 - 1


def _refuse_invalid_list_element(
    path_so_far: str, step: PathStep, list_type: ListOf, parent: RecordType
) -> None:
    by_name = f" or by name, {path_so_far}[NAME]" if parent.has_field_of_element_names else ""
    if step.element is None:
        raise FieldError(
            f"'{path_so_far}' is a list; select an element by index, {path_so_far}[0]{by_name}"
        )
    if step.element == ALL:
        return
    if isinstance(step.element, str):
        if not parent.has_field_of_element_names:
            raise FieldError(
                f"'{path_so_far}[{step.element}]' selects by name, but {parent.name} has no list "
                f"'name'; select by index, {path_so_far}[0]"
            )
    elif list_type.length is not None and step.element >= list_type.length:
        raise FieldError(
            f"'{path_so_far}[{step.element}]' is out of range; it has {path_so_far}[0] to "
            f"{path_so_far}[{list_type.length - 1}]"
        )
