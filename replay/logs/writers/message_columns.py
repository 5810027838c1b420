"""Columns with the values of many messages to serialise.

A column is one value for all messages (a number, a text, a list or tuple of values, a mapping by
field), a NumPy array with a row per message, or, if lengths differ, a `RaggedColumn`. A field
without a column is empty: 0, no text, no elements.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Ints

Column: TypeAlias = (
    "NDArray[Any] | RaggedColumn | Mapping[str, Column] | Sequence[Column] | str | float | None"
)


@dataclass(frozen=True, eq=False)
class RaggedColumn:
    """Column of lists or texts of different lengths.

    Attributes:
        lengths: (n,) number of elements of each list, or of bytes in UTF-8 of each text.
        content: column of all elements, list after list; for texts, uint8 (bytes,).
    """

    lengths: Ints
    content: Column

    @classmethod
    def from_texts(cls, values: Sequence[str]) -> "RaggedColumn":
        """Make a column of texts, one per message."""
        encoded = [value.encode() for value in values]
        lengths = np.fromiter(map(len, encoded), np.int64, len(encoded))
        return cls(lengths, np.frombuffer(b"".join(encoded), np.uint8))

    @property
    def first_indices(self) -> Ints:
        """Index (n,) in the content at which each list begins."""
        return np.cumsum(self.lengths) - self.lengths


def assign_list_layout_number_to_messages(column: Column) -> Ints | None:
    """Number each message's layout (n,): equal for equal lengths; None if all are equal."""
    if isinstance(column, RaggedColumn):
        return _number_nested_list_layouts_of_messages(column)
    if isinstance(column, Mapping):
        return assign_combined_list_layout_numbers(
            [assign_list_layout_number_to_messages(each) for each in column.values()]
        )
    if isinstance(column, list | tuple):
        return assign_combined_list_layout_numbers(
            [assign_list_layout_number_to_messages(each) for each in column]
        )
    return None


def assign_combined_list_layout_numbers(
    shape_numbers_of_columns: Sequence[Ints | None],
) -> Ints | None:
    """Number each message by its combination of list layouts, (n,); None if all are equal."""
    known = [each for each in shape_numbers_of_columns if each is not None]
    if len(known) < 2:
        return known[0] if known else None
    return np.unique(np.column_stack(known), axis=0, return_inverse=True)[1].reshape(-1)


def _number_nested_list_layouts_of_messages(column: RaggedColumn) -> Ints:
    """Number each message's layout (n,): equal if all nested lists have equal lengths."""
    inside, lengths = assign_list_layout_number_to_messages(column.content), column.lengths
    if inside is None:
        return lengths
    numbers = np.zeros(lengths.size, np.int64)
    known = 0
    for length in np.unique(lengths):
        rows = np.flatnonzero(lengths == length)
        elements = inside[column.first_indices[rows][:, None] + np.arange(length)]
        kinds, inverse = np.unique(elements, axis=0, return_inverse=True)
        numbers[rows] = known + inverse.reshape(-1)
        known += max(len(kinds), 1)
    return numbers
