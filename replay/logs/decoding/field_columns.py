"""Make columns from marks: follow a field's path to the positions of its values, and gather them.

Along the path, a field is located by elements of a node or, inside a part of fixed size, by
positions in the data. -1 stands for an element that a message lacks; its value is null.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Ints
from replay.logs.decoding.arrow_arrays import (
    ELEMENT_TYPES,
    Array,
    make_element_array,
    make_list_array,
    make_string_array,
    make_value_array,
)
from replay.logs.decoding.direct_fields import DirectFields
from replay.logs.decoding.field_places import (
    FieldPlace,
    InlineArray,
    InlineField,
    InlineRecord,
    InlineValue,
    NestedMessage,
    SpanField,
    StridedList,
    TextField,
    WalkedList,
)
from replay.logs.decoding.gather_values import (
    DTYPES,
    concatenate_byte_ranges,
    convert_bytes_to_numbers,
    find_name_index_in_each_list,
    gather_64_bit_patterns,
    gather_string_views,
)
from replay.logs.decoding.one_pass import GatheredRows
from replay.logs.decoding.wire import WIDTHS
from replay.logs.messages.message_fields import ALL, Field

_NO_TEXT: Final = np.empty(0, np.uint8)


@dataclass(frozen=True, slots=True, eq=False)
class _Elements:
    """Location by elements of a node: their indices, or None for all elements."""

    located: FieldPlace
    chosen: Ints | None


@dataclass(frozen=True, slots=True, eq=False)
class _Positions:
    """Location by `offset` bytes after given positions."""

    value: InlineValue
    at: Ints
    offset: int = 0


_Place: TypeAlias = _Elements | _Positions


@dataclass(frozen=True, slots=True, eq=False)
class ColumnBuilder:
    """Builder of columns from a walked batch."""

    data: NDArray[np.uint8]
    swap: bool
    root: NestedMessage
    #: by mark: position or length noted for each element of its node
    mark_values: tuple[Ints, ...]
    #: number of complete messages
    rows: int
    direct: DirectFields
    gathered_rows: GatheredRows
    _found: dict[tuple[int, str], Ints] = field(default_factory=dict[tuple[int, str], Ints])

    def iter_gathered_fields(self) -> Iterator[Array]:
        """Yield the fields gathered during the walk, in the order of `DirectFields.field_paths`."""
        direct, gathered_rows = self.direct, self.gathered_rows
        rows, room = self.rows, gathered_rows.values.shape[1]
        for (_, kind), bits in zip(direct.values, gathered_rows.values, strict=True):
            yield make_value_array(bits[:rows], kind)
        above = 0
        sizes = direct.gather_plan.array_bytes.tolist()
        for (_, kind, length), size in zip(direct.arrays, sizes, strict=True):
            stored = gathered_rows.arrays[above : above + rows * size]
            elements = make_element_array(
                convert_bytes_to_numbers(stored, kind, swap=self.swap), kind
            )
            yield make_list_array(np.full(rows, length), elements)
            above += room * size
        for k, mark in enumerate(direct.gather_plan.text_marks.tolist()):
            if gathered_rows.long_bytes[k]:
                yield make_string_array(
                    *gather_string_views(
                        self.data, self.mark_values[mark], self.mark_values[mark + 1]
                    )
                )
            else:
                yield make_string_array(gathered_rows.views[k, :rows], _NO_TEXT)

    def make_column(self, field: Field) -> Array:
        """Make the column of a field, with a value for every complete message."""
        place: _Place = _Elements(self.root, None)
        spreads: list[Ints] = []
        for step in field.steps:
            above, place = place, self._locate_member(place, step.name)
            if step.element is None:
                continue
            if step.element == ALL:
                counts = self._count_list_elements(place)
                spreads.append(counts)
                if step is field.steps[-1] and _is_list_of_contiguous_numbers(place):
                    return _wrap_in_lists(self._gather_contiguous_elements(place, counts), spreads)
                place = self._locate_all_elements(place, counts)
            elif isinstance(step.element, int):
                place = self._locate_one_element(place, step.element)
            else:
                place = self._locate_one_element(
                    place, self._find_element_index_in_each_message(above, step.element)
                )
        found = self._gather_values_at_location(place)
        if spreads and field.kind in ELEMENT_TYPES:
            found = found.cast(ELEMENT_TYPES[field.kind], safe=False)
        return _wrap_in_lists(found, spreads)

    def _locate_member(self, parent_location: _Place, name: str) -> _Place:
        """Locate a member of the message at a location."""
        if isinstance(parent_location, _Positions):
            assert isinstance(parent_location.value, InlineRecord)
            return replace(parent_location, value=parent_location.value.fields[name])
        assert isinstance(parent_location.located, NestedMessage)
        located = parent_location.located.fields[name]
        if isinstance(located, SpanField):
            return _Positions(
                located.value,
                self._read_positions_or_lengths_of_elements(located.mark, parent_location.chosen),
            )
        return _Elements(located, parent_location.chosen)

    def _read_positions_or_lengths_of_elements(
        self, mark_number: int, element_indices: Ints | None, value_if_absent: int = -1
    ) -> Ints:
        """Read a mark of selected elements; `value_if_absent` for each index of -1."""
        if element_indices is None:
            return self.mark_values[mark_number]
        # the appended value is the one that index -1 selects
        return np.append(self.mark_values[mark_number], value_if_absent)[element_indices]

    def _count_list_elements(self, list_location: _Place) -> Ints:
        """Count the elements of each list; -1 for a missing list."""
        if isinstance(list_location, _Positions):
            assert isinstance(list_location.value, InlineArray)
            return np.where(list_location.at < 0, -1, list_location.value.length)
        assert isinstance(list_location.located, WalkedList | StridedList)
        mark = list_location.located.mark + isinstance(list_location.located, StridedList)
        return self._read_positions_or_lengths_of_elements(mark, list_location.chosen)

    def _locate_one_element(self, list_location: _Place, element_index: int | Ints) -> _Place:
        """Locate one element of each list, at a common or individual index."""
        if isinstance(list_location, _Positions) and isinstance(element_index, int):
            assert isinstance(list_location.value, InlineArray)
            array = list_location.value
            return _Positions(
                array.element,
                list_location.at,
                list_location.offset + array.offset + element_index * array.stride,
            )
        there = (element_index >= np.int64(0)) & (
            element_index < self._count_list_elements(list_location)
        )
        return self._locate_existing_element(list_location, np.where(there, element_index, -1))

    def _locate_existing_element(self, list_location: _Place, element_index: Ints) -> _Place:
        """Locate one element of each list, which must exist unless its index is -1."""
        if isinstance(list_location, _Positions):
            assert isinstance(list_location.value, InlineArray)
            array = list_location.value
            at = list_location.at + array.offset + element_index * array.stride
            return _Positions(
                array.element, np.where(element_index < 0, -1, at), list_location.offset
            )
        if isinstance(list_location.located, StridedList):
            starts = self._read_positions_or_lengths_of_elements(
                list_location.located.mark, list_location.chosen
            )
            at = np.where(
                element_index < 0, -1, starts + element_index * list_location.located.stride
            )
            return _Positions(list_location.located.element, at)
        assert isinstance(list_location.located, WalkedList)
        counts = self.mark_values[list_location.located.mark]
        begins = np.cumsum(counts) - counts
        if list_location.chosen is not None:
            begins = np.append(begins, -1)[list_location.chosen]
        return _Elements(
            list_location.located.element, np.where(element_index < 0, -1, begins + element_index)
        )

    def _locate_all_elements(self, list_location: _Place, counts: Ints) -> _Place:
        """Locate every element of each list."""
        match list_location:
            case _Elements(located=WalkedList(element=element), chosen=None):
                return _Elements(element, None)
            case _:
                pass
        there = np.maximum(counts, 0)
        owner = np.repeat(np.arange(there.size), there)
        number = np.arange(owner.size) - np.repeat(np.cumsum(there) - there, there)
        if isinstance(list_location, _Positions):
            list_location = replace(list_location, at=list_location.at[owner])
        else:
            chosen = owner if list_location.chosen is None else list_location.chosen[owner]
            list_location = replace(list_location, chosen=chosen)
        return self._locate_existing_element(list_location, number)

    def _find_element_index_in_each_message(
        self, message_location: _Place, element_name: str
    ) -> Ints:
        """Find the index of a name in the list `name` of each message; -1 if absent."""
        assert isinstance(message_location, _Elements)
        assert isinstance(message_location.located, NestedMessage)
        names = message_location.located.fields["name"]
        assert isinstance(names, WalkedList)
        assert isinstance(names.element, TextField)
        if (names.mark, element_name) not in self._found:
            text = names.element.mark
            self._found[names.mark, element_name] = find_name_index_in_each_list(
                self.data,
                self.mark_values[text],
                self.mark_values[text + 1],
                self.mark_values[names.mark],
                element_name,
            )
        found = self._found[names.mark, element_name]
        return (
            found
            if message_location.chosen is None
            else np.append(found, -1)[message_location.chosen]
        )

    def _gather_contiguous_elements(self, list_location: _Place, counts: Ints) -> Array:
        """Gather the elements of lists of numbers, which are contiguous in the data."""
        counts = np.maximum(counts, 0)
        if isinstance(list_location, _Positions):
            array = list_location.value
            assert isinstance(array, InlineArray)
            starts = list_location.at + (list_location.offset + array.offset)
        else:
            array = list_location.located
            assert isinstance(array, StridedList)
            starts = self._read_positions_or_lengths_of_elements(array.mark, list_location.chosen)
        assert isinstance(array.element, InlineField)
        kind = array.element.kind
        stored = concatenate_byte_ranges(self.data, starts, counts * DTYPES[kind].itemsize)
        return make_element_array(convert_bytes_to_numbers(stored, kind, swap=self.swap), kind)

    def _gather_values_at_location(self, value_location: _Place) -> Array:
        """Gather the values at a location as an Arrow array."""
        if isinstance(value_location, _Elements):
            assert isinstance(value_location.located, TextField)
            starts = self._read_positions_or_lengths_of_elements(
                value_location.located.mark, value_location.chosen
            )
            sizes = self._read_positions_or_lengths_of_elements(
                value_location.located.mark + 1, value_location.chosen, value_if_absent=0
            )
            return make_string_array(
                *gather_string_views(self.data, starts, sizes), is_absent=starts < 0
            )
        value = value_location.value
        assert isinstance(value, InlineField)
        offset = value_location.offset + value.offset
        bits = gather_64_bit_patterns(
            self.data, value_location.at, offset, value.kind, swap=self.swap
        )
        return make_value_array(bits, value.kind, is_absent=value_location.at < 0)


def _is_list_of_contiguous_numbers(list_location: _Place) -> bool:
    array = list_location.value if isinstance(list_location, _Positions) else list_location.located
    return (
        isinstance(array, InlineArray | StridedList)
        and isinstance(array.element, InlineField)
        and array.element.kind in WIDTHS
    )


def _wrap_in_lists(values: Array, list_counts: list[Ints]) -> Array:
    """Nest values in lists with the given numbers of elements, from the inside out."""
    for counts in reversed(list_counts):
        values = make_list_array(counts, values)
    return values
