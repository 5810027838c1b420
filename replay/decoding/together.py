"""Single values that every message has, which one loop gathers for all columns at once."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from replay.decoding.gather import LOADS
from replay.decoding.located import InBlock, Inline, InlineArray, InlineRecord, Nested
from replay.readers.fields import Field, Step

Ints = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Together:
    """Fields at fixed distances from marks of the messages themselves."""

    steps: tuple[tuple[Step, ...], ...]
    kinds: tuple[str, ...]
    #: (fields,) each: the mark, the distance, and how it is loaded (see `gather.LOADS`)
    marks: Ints
    offsets: Ints
    loads: Ints


def gathered_together(root: Nested, fields: Iterable[Field]) -> Together:
    """Those fields that can be."""
    found = {field.steps: _fixed_place(root, field.steps) for field in fields}
    placed = {steps: place for steps, place in found.items() if place is not None}
    columns = [(mark, value.offset, LOADS[value.kind]) for mark, value in placed.values()]
    marks, offsets, loads = np.array(columns, np.int64).reshape(-1, 3).T.copy()
    kinds = tuple(value.kind for _, value in placed.values())
    return Together(tuple(placed), kinds, marks, offsets, loads)


def _fixed_place(root: Nested, steps: tuple[Step, ...]) -> tuple[int, Inline] | None:
    """The mark that a field is at a fixed distance from, and what lies there."""
    here = root
    mark, offset = -1, 0
    for step in steps:
        assert isinstance(here, Nested | InlineRecord)
        below = here.fields[step.name]
        if isinstance(below, InBlock):
            mark, below = below.mark, below.value
        if isinstance(below, InlineArray) and isinstance(step.element, int):
            offset += below.offset + step.element * below.stride
            below = below.element
        elif step.element is not None:
            return None
        if isinstance(below, Inline):
            return mark, Inline(offset + below.offset, below.kind)
        if not isinstance(below, Nested | InlineRecord):
            return None
        here = below
    return None
