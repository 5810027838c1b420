"""Columns from marks: follow a field's steps to where its values lie, then gather them.

While its steps are followed, a field is located by elements of a node or, inside a part of fixed
size, by positions in the data. -1 marks an element that a message lacks; its value is null.
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
    InlineArray,
    InlineField,
    InlineRecord,
    InlineValue,
    InSpan,
    Located,
    NestedMessage,
    StridedList,
    TextField,
    WalkedList,
)
from replay.logs.decoding.gather_values import (
    DTYPES,
    concatenate_byte_ranges,
    convert_bytes_to_numbers,
    find_name_in_lists,
    gather_string_views,
    gather_values,
)
from replay.logs.decoding.one_pass import GatheredRows
from replay.logs.decoding.wire import WIDTHS
from replay.logs.messages.message_fields import ALL, Field

_NO_TEXT: Final = np.empty(0, np.uint8)


@dataclass(frozen=True, slots=True, eq=False)
class _Elements:
    """Values at elements of a node: their indices, or None for all elements."""

    located: Located
    chosen: Ints | None


@dataclass(frozen=True, slots=True, eq=False)
class _Positions:
    """Values `offset` bytes after given positions."""

    value: InlineValue
    at: Ints
    offset: int = 0


_Place: TypeAlias = _Elements | _Positions


@dataclass(frozen=True, slots=True, eq=False)
class Columns:
    """Builds columns from a walked batch."""

    data: NDArray[np.uint8]
    swap: bool
    root: NestedMessage
    #: by mark: position or length noted for each element of its node
    mark_values: tuple[Ints, ...]
    #: whole messages
    rows: int
    direct: DirectFields
    gathered_rows: GatheredRows
    _found: dict[tuple[int, str], Ints] = field(default_factory=dict[tuple[int, str], Ints])

    def iter_gathered_fields(self) -> Iterator[Array]:
        """Fields gathered during the pass, in the order of `DirectFields.steps`."""
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
        """Values of a field, one for every complete message."""
        place: _Place = _Elements(self.root, None)
        spreads: list[Ints] = []
        for step in field.steps:
            above, place = place, self._place_of_member(place, step.name)
            if step.element is None:
                continue
            if step.element == ALL:
                counts = self._count_elements(place)
                spreads.append(counts)
                if step is field.steps[-1] and _is_contiguous(place):
                    return _wrap_in_lists(self._gather_contiguous_elements(place, counts), spreads)
                place = self._place_of_all_elements(place, counts)
            elif isinstance(step.element, int):
                place = self._place_of_one_element(place, step.element)
            else:
                place = self._place_of_one_element(
                    place, self._find_element_by_name(above, step.element)
                )
        found = self._gather_values(place)
        if spreads and field.kind in ELEMENT_TYPES:
            found = found.cast(ELEMENT_TYPES[field.kind], safe=False)
        return _wrap_in_lists(found, spreads)

    def _place_of_member(self, place: _Place, name: str) -> _Place:
        """Place of a member of the message at a place."""
        if isinstance(place, _Positions):
            assert isinstance(place.value, InlineRecord)
            return replace(place, value=place.value.fields[name])
        assert isinstance(place.located, NestedMessage)
        located = place.located.fields[name]
        if isinstance(located, InSpan):
            return _Positions(located.value, self._select_marks(located.mark, place.chosen))
        return _Elements(located, place.chosen)

    def _select_marks(self, mark: int, chosen_messages: Ints | None, absent_mark: int = -1) -> Ints:
        """Marks of selected elements; `absent_mark` for those that do not exist."""
        if chosen_messages is None:
            return self.mark_values[mark]
        # one more, which is what -1 picks
        return np.append(self.mark_values[mark], absent_mark)[chosen_messages]

    def _count_elements(self, place: _Place) -> Ints:
        """Number of elements of each list; -1 for a missing list."""
        if isinstance(place, _Positions):
            assert isinstance(place.value, InlineArray)
            return np.where(place.at < 0, -1, place.value.length)
        assert isinstance(place.located, WalkedList | StridedList)
        mark = place.located.mark + isinstance(place.located, StridedList)
        return self._select_marks(mark, place.chosen)

    def _place_of_one_element(self, place: _Place, element_index: int | Ints) -> _Place:
        """Place of one element of each list, at a common or individual index."""
        if isinstance(place, _Positions) and isinstance(element_index, int):
            assert isinstance(place.value, InlineArray)
            array = place.value
            return _Positions(
                array.element, place.at, place.offset + array.offset + element_index * array.stride
            )
        there = (element_index >= np.int64(0)) & (element_index < self._count_elements(place))
        return self._place_of_existing_element(place, np.where(there, element_index, -1))

    def _place_of_existing_element(self, place: _Place, element_index: Ints) -> _Place:
        """Place of one existing element of each list; -1 for none."""
        if isinstance(place, _Positions):
            assert isinstance(place.value, InlineArray)
            array = place.value
            at = place.at + array.offset + element_index * array.stride
            return _Positions(array.element, np.where(element_index < 0, -1, at), place.offset)
        if isinstance(place.located, StridedList):
            starts = self._select_marks(place.located.mark, place.chosen)
            at = np.where(element_index < 0, -1, starts + element_index * place.located.stride)
            return _Positions(place.located.element, at)
        assert isinstance(place.located, WalkedList)
        counts = self.mark_values[place.located.mark]
        begins = np.cumsum(counts) - counts
        if place.chosen is not None:
            begins = np.append(begins, -1)[place.chosen]
        return _Elements(
            place.located.element, np.where(element_index < 0, -1, begins + element_index)
        )

    def _place_of_all_elements(self, place: _Place, counts: Ints) -> _Place:
        """Place of every element of each list."""
        match place:
            case _Elements(located=WalkedList(element=element), chosen=None):
                return _Elements(element, None)
            case _:
                pass
        there = np.maximum(counts, 0)
        owner = np.repeat(np.arange(there.size), there)
        number = np.arange(owner.size) - np.repeat(np.cumsum(there) - there, there)
        if isinstance(place, _Positions):
            place = replace(place, at=place.at[owner])
        else:
            chosen = owner if place.chosen is None else place.chosen[owner]
            place = replace(place, chosen=chosen)
        return self._place_of_existing_element(place, number)

    def _find_element_by_name(self, place: _Place, name: str) -> Ints:
        """Index of a name in the list `name` of each message; -1 if absent."""
        assert isinstance(place, _Elements)
        assert isinstance(place.located, NestedMessage)
        names = place.located.fields["name"]
        assert isinstance(names, WalkedList)
        assert isinstance(names.element, TextField)
        if (names.mark, name) not in self._found:
            text = names.element.mark
            self._found[names.mark, name] = find_name_in_lists(
                self.data,
                self.mark_values[text],
                self.mark_values[text + 1],
                self.mark_values[names.mark],
                name,
            )
        found = self._found[names.mark, name]
        return found if place.chosen is None else np.append(found, -1)[place.chosen]

    def _gather_contiguous_elements(self, place: _Place, counts: Ints) -> Array:
        """Elements of lists of numbers, contiguous in the data."""
        counts = np.maximum(counts, 0)
        if isinstance(place, _Positions):
            array = place.value
            assert isinstance(array, InlineArray)
            starts = place.at + (place.offset + array.offset)
        else:
            array = place.located
            assert isinstance(array, StridedList)
            starts = self._select_marks(array.mark, place.chosen)
        assert isinstance(array.element, InlineField)
        kind = array.element.kind
        stored = concatenate_byte_ranges(self.data, starts, counts * DTYPES[kind].itemsize)
        return make_element_array(convert_bytes_to_numbers(stored, kind, swap=self.swap), kind)

    def _gather_values(self, place: _Place) -> Array:
        """Values at a place as an Arrow array."""
        if isinstance(place, _Elements):
            assert isinstance(place.located, TextField)
            starts = self._select_marks(place.located.mark, place.chosen)
            sizes = self._select_marks(place.located.mark + 1, place.chosen, absent_mark=0)
            return make_string_array(
                *gather_string_views(self.data, starts, sizes), is_absent=starts < 0
            )
        value = place.value
        assert isinstance(value, InlineField)
        offset = place.offset + value.offset
        bits = gather_values(self.data, place.at, offset, value.kind, swap=self.swap)
        return make_value_array(bits, value.kind, is_absent=place.at < 0)


def _is_contiguous(place: _Place) -> bool:
    array = place.value if isinstance(place, _Positions) else place.located
    return (
        isinstance(array, InlineArray | StridedList)
        and isinstance(array.element, InlineField)
        and array.element.kind in WIDTHS
    )


def _wrap_in_lists(values: Array, list_counts: list[Ints]) -> Array:
    """Nest values into lists, from the inside out."""
    for counts in reversed(list_counts):
        values = make_list_array(counts, values)
    return values
