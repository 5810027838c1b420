"""Direct fields, at a fixed offset from a mark in every message, are gathered during the walk."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np

from estimators.arrays import Ints
from replay.logs.decoding.field_places import (
    InlineArray,
    InlineField,
    InlineRecord,
    NestedMessage,
    SpanField,
    TextField,
)
from replay.logs.decoding.gather_values import DTYPES, LOADS
from replay.logs.messages.message_fields import ALL, Field, PathStep

#: Path of a field in its type, which identifies it.
Steps: TypeAlias = tuple[PathStep, ...]


class GatherPlan(NamedTuple):
    """Plan of the values that a compiled pass gathers in addition to the marks.

    `value_*`: single values, by the mark of their span, their offset from it, and their type
    (`gather_values.LOADS`). `array_*`: arrays of numbers, with their size in bytes. `text_marks`:
    strings.
    """

    value_marks: Ints
    value_offsets: Ints
    value_loads: Ints
    array_marks: Ints
    array_offsets: Ints
    array_bytes: Ints
    text_marks: Ints


@dataclass(frozen=True, slots=True, eq=False)
class DirectFields:
    """Fields of a type that are gathered during the walk."""

    gather_plan: GatherPlan
    #: single values with kind, arrays with kind and length, and strings, in the gather plan's order
    values: tuple[tuple[Steps, str], ...]
    arrays: tuple[tuple[Steps, str, int], ...]
    texts: tuple[Steps, ...]

    @property
    def field_paths(self) -> tuple[Steps, ...]:
        """Paths of all fields, in order."""
        return (*(v[0] for v in self.values), *(a[0] for a in self.arrays), *self.texts)


@dataclass(frozen=True, slots=True)
class _FixedField:
    """A field at a fixed offset from a mark of the message."""

    mark: int
    offset: int
    value: InlineField | InlineArray | TextField


def select_fields_at_fixed_offsets(
    message_layout: NestedMessage, fields: Iterable[Field]
) -> DirectFields:
    """Select the fields that are at a fixed offset from a mark in every message."""
    places = {field.steps: _find_fixed_field(message_layout, field.steps) for field in fields}
    values: list[tuple[Steps, str]] = []
    arrays: list[tuple[Steps, str, int]] = []
    texts: list[Steps] = []
    numbers: tuple[list[tuple[int, ...]], ...] = ([], [], [])
    for steps, place in places.items():
        match place:
            case _FixedField(mark, offset, InlineField(_, kind)):
                values.append((steps, kind))
                numbers[0].append((mark, offset, LOADS[kind]))
            case _FixedField(mark, offset, InlineArray(_, length, _, InlineField(_, kind))):
                arrays.append((steps, kind, length))
                numbers[1].append((mark, offset, length * DTYPES[kind].itemsize))
            case _FixedField(mark, _, TextField()):
                texts.append(steps)
                numbers[2].append((mark,))
            case _:
                pass
    columns = [
        np.array(rows, np.int64).reshape(-1, width).T.copy()
        for rows, width in zip(numbers, (3, 3, 1), strict=True)
    ]
    gather_plan = GatherPlan(*columns[0], *columns[1], *columns[2])
    return DirectFields(gather_plan, tuple(values), tuple(arrays), tuple(texts))


def _find_fixed_field(message_layout: NestedMessage, steps: Steps) -> _FixedField | None:
    """Mark and offset of a field, if they are the same in every message; else None."""
    here: NestedMessage | InlineRecord = message_layout
    mark, offset = -1, 0
    for step in steps:
        below = here.fields[step.name]
        if isinstance(below, TextField):
            return _FixedField(below.mark, 0, below) if step.element is None else None
        if isinstance(below, SpanField):
            mark, below = below.mark, below.value
        if isinstance(below, InlineArray) and step.element is not None:
            offset += below.offset
            if step.element == ALL:
                return (
                    _FixedField(mark, offset, below)
                    if _is_complete_numeric_array_requested(below, step, steps)
                    else None
                )
            if not isinstance(step.element, int):
                return None
            offset += step.element * below.stride
            below = below.element
        elif step.element is not None:
            return None
        if isinstance(below, InlineField):
            return _FixedField(mark, offset + below.offset, below)
        if not isinstance(below, NestedMessage | InlineRecord):
            return None
        here = below
    return None


def _is_complete_numeric_array_requested(array: InlineArray, step: PathStep, steps: Steps) -> bool:
    """Whether all elements of an array of plain numbers are requested."""
    element = array.element
    return step is steps[-1] and isinstance(element, InlineField) and element.kind in DTYPES
