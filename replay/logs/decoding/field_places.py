"""Places of fields in messages, by which columns are gathered after a compiled walk.

A *node* is a list whose elements are walked one by one; node 0 is the batch, whose elements are the
messages. A *mark* is a number that the walk stores for every element of a node: the position of a
span, of a string or of a list. A field at a fixed offset from a mark needs none of its own.
"""

from dataclasses import dataclass
from typing import TypeAlias


@dataclass(frozen=True, slots=True)
class InlineField:
    """A number or stamp at `offset` bytes in its span."""

    offset: int
    kind: str


@dataclass(frozen=True, slots=True)
class InlineRecord:
    """A message entirely inside a span."""

    fields: "dict[str, InlineValue]"


@dataclass(frozen=True, slots=True)
class InlineArray:
    """An array in a span; `element` repeats every `stride` bytes."""

    offset: int
    length: int
    stride: int
    element: "InlineValue"


@dataclass(frozen=True, slots=True)
class SpanField:
    """A value in the span whose position is stored as `mark`."""

    mark: int
    value: "InlineValue"


@dataclass(frozen=True, slots=True)
class TextField:
    """A string: `mark` is its position, `mark + 1` its length in bytes."""

    mark: int


@dataclass(frozen=True, slots=True)
class StridedList:
    """A list of fixed-size elements; its position is stored as `mark`, its length as `mark + 1`."""

    mark: int
    stride: int
    element: "InlineValue"


@dataclass(frozen=True, slots=True)
class WalkedList:
    """A list whose elements are those of `node`; `mark` is their number."""

    mark: int
    node: int
    element: "FieldPlace"


@dataclass(frozen=True, slots=True)
class NestedMessage:
    """A message whose fields have marks of their own."""

    fields: "dict[str, FieldPlace]"


InlineValue: TypeAlias = InlineField | InlineRecord | InlineArray
FieldPlace: TypeAlias = SpanField | TextField | StridedList | WalkedList | NestedMessage
