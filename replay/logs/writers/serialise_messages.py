"""Serialise columns of messages; messages of one layout are serialised at once, as rows of bytes.

The layout of a message follows from the lengths of its lists and texts alone. Messages with the
same lengths are one structured array: shared bytes are written once, each column in one assignment.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype

from estimators.arrays import Bytes, Ints
from replay.logs.decoding.wire import WireEncoding
from replay.logs.writers.message_columns import (
    Column,
    RaggedColumn,
    assign_list_layout_number_to_messages,
)

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

#: Function that returns what precedes messages of a given size in the container: constant bytes, or
#: numbers (n,) with their type.
Envelope: TypeAlias = Callable[[int], "Sequence[bytes | tuple[str, Ints]]"]
_DTYPES: Final = {"bool": "?", "byte": "i1", "char": "u1", "octet": "u1"}
#: Name of the byte of an empty ROS 2 message.
_PLACEHOLDER: Final = "structure_needs_at_least_one_member"
#: Encapsulation of little-endian CDR.
_ENCAPSULATION: Final = b"\0\1\0\0"


class SameLayout(NamedTuple):
    """Messages of one layout: their indices (k,), None for all; and their bytes (k, size)."""

    chosen: Ints | None
    rows: Bytes


def serialise_messages(
    store: "Typestore",
    msgtype: str,
    column: Mapping[str, Column],
    message_count: int,
    wire: WireEncoding,
    envelope: Envelope = lambda _: (),
) -> list[SameLayout]:
    """Serialise messages of one type.

    Args:
        store: store with the type's definition, of ROS 1 or 2 to match the encoding.
        msgtype: type name, such as `sensor_msgs/msg/Imu`.
        column: messages by field; arrays have one row per message.
        message_count: number of messages.
        wire: encoding; numbers are little-endian.
        envelope: what precedes each message; alignment counts from its end.

    Returns:
        Messages grouped by layout, each preceded by its envelope.
    """
    found = assign_list_layout_number_to_messages(column)
    numbers = np.empty(0, np.int64) if found is None else np.unique(found)
    if found is None or numbers.size == 1:
        return [
            SameLayout(
                None,
                serialise_messages_of_one_layout(
                    store, msgtype, column, slice(message_count), wire, envelope
                ),
            )
        ]
    groups = (np.flatnonzero(found == number) for number in numbers)
    return [
        SameLayout(
            rows, serialise_messages_of_one_layout(store, msgtype, column, rows, wire, envelope)
        )
        for rows in groups
    ]


#: Selected elements of a column: a slice, or their indices (k,).
_Chosen: TypeAlias = "slice | Ints"


def serialise_messages_of_one_layout(
    store: "Typestore",
    msgtype: str,
    column: Column,
    message_indices: _Chosen,
    wire: WireEncoding,
    envelope: Envelope,
) -> Bytes:
    """Serialise the chosen messages, which share one layout, to bytes (k, size)."""
    count = message_indices.stop if isinstance(message_indices, slice) else message_indices.size
    layout = _Layout(store, wire)
    if wire.cdr:
        layout.head = _ENCAPSULATION
    layout.append_nested_message(msgtype, column, message_indices)
    before = _Layout(store, wire)
    for part in envelope(len(layout.head) + layout.size):
        if isinstance(part, bytes):
            before.append_constant_bytes(part)
        else:
            before.append_numeric_column(np.dtype(part[0]), part[1][message_indices])
    first = before.size
    base = first + len(layout.head)
    template = np.zeros(base + layout.size, np.uint8)
    rows = np.empty((count, template.size), np.uint8)
    constants = [
        *before.constants,
        (first, layout.head),
        *((base + at, data) for at, data in layout.constants),
    ]
    for at, data in constants:
        template[at : at + len(data)] = np.frombuffer(data, np.uint8)
    rows[:] = template
    placed = [*before.columns, *((base + at, dtype, made) for at, dtype, made in layout.columns)]
    if not placed or not count:
        return rows
    offsets, dtypes, values = zip(*placed, strict=True)
    names = [str(number) for number in range(len(placed))]
    fields: Any = {
        "names": names,
        "offsets": offsets,
        "formats": dtypes,
        "itemsize": template.size,
    }
    structured = rows.reshape(-1).view(np.dtype(fields))
    for name, made in zip(names, values, strict=True):
        structured[name] = made
    return rows


@dataclass(eq=False)
class _Layout:
    """Offsets and contents of the fields of messages of equal lengths."""

    store: "Typestore"
    wire: WireEncoding
    head: bytes = b""
    size: int = 0
    #: constant bytes, and columns of varying values, each with its offset
    constants: list[tuple[int, bytes]] = field(default_factory=list[tuple[int, bytes]])
    columns: list[tuple[int, np.dtype[Any], NDArray[Any]]] = field(
        default_factory=list[tuple[int, np.dtype[Any], NDArray[Any]]]
    )

    def append_nested_message(self, name: str, column: Column, message_indices: _Chosen) -> None:
        """Append the fields of a message, or of a nested one."""
        known = column if isinstance(column, Mapping) else {}
        for key, description in self.store.fielddefs[name][1]:
            if key == _PLACEHOLDER and not self.wire.cdr:
                continue
            self._append_described_value(description, known.get(key), message_indices)

    def append_constant_bytes(self, data: bytes) -> None:
        """Append the same bytes to every message."""
        self.constants.append((self.size, data))
        self.size += len(data)

    def append_numeric_column(self, dtype: np.dtype[Any], values: NDArray[Any]) -> None:
        """Append numbers (k,), or arrays of numbers (k, length), to the messages."""
        if values.ndim == 2:
            dtype = np.dtype((dtype, values.shape[1:]))
        self.columns.append((self.size, dtype, values))
        self.size += dtype.itemsize

    def _append_described_value(
        self, description: Any, column: Column, message_indices: _Chosen
    ) -> None:
        node, detail = description
        if node == Nodetype.NAME:
            self.append_nested_message(detail, column, message_indices)
        elif node == Nodetype.BASE and detail[0] == "string":
            self._append_text_column(column, message_indices)
        elif node == Nodetype.BASE:
            self._append_number_lists(_make_numpy_dtype(detail[0]), column, message_indices, 1)
        else:
            element, limit = detail
            self._append_list_column(
                element, limit if node == Nodetype.ARRAY else None, column, message_indices
            )

    def _append_text_column(self, column: Column, message_indices: _Chosen) -> None:
        end = b"\0" if self.wire.cdr else b""
        if isinstance(column, RaggedColumn):
            length = _find_common_list_length(column, message_indices)
            self._append_list_length(length + len(end))
            if length:
                self.append_numeric_column(
                    np.dtype("u1"), stack_elements_of_length(column, message_indices, length)
                )
            self.append_constant_bytes(end)
        else:
            data = str(column or "").encode() + end
            self._append_list_length(len(data))
            self.append_constant_bytes(data)

    def _append_list_column(
        self, element: Any, fixed_length: int | None, column: Column, message_indices: _Chosen
    ) -> None:
        length = _find_list_length(column, message_indices, fixed_length)
        if fixed_length is None:
            self._append_list_length(length)
        is_number = element[0] == Nodetype.BASE and element[1][0] != "string"
        if is_number:
            if length or fixed_length is not None:
                self._append_number_lists(
                    _make_numpy_dtype(element[1][0]), column, message_indices, length
                )
            return
        for number in range(length):
            if isinstance(column, RaggedColumn):
                at = column.first_indices[message_indices] + number
                self._append_described_value(element, column.content, at)
            else:
                one = column[number] if isinstance(column, list | tuple) else None
                self._append_described_value(element, one, message_indices)

    def _append_number_lists(
        self, dtype: np.dtype[Any], column: Column, message_indices: _Chosen, length: int
    ) -> None:
        self._append_alignment_padding(dtype.itemsize)
        if isinstance(column, RaggedColumn):
            self.append_numeric_column(
                dtype, stack_elements_of_length(column, message_indices, length)
            )
        elif isinstance(column, np.ndarray):
            self.append_numeric_column(dtype, column[message_indices])
        elif column is None:
            self.append_constant_bytes(bytes(dtype.itemsize * length))
        else:
            self.append_constant_bytes(np.array(column, dtype).tobytes())

    def _append_list_length(self, length: int) -> None:
        self._append_alignment_padding(4)
        self.append_constant_bytes(np.array(length, "<u4").tobytes())

    def _append_alignment_padding(self, alignment_bytes: int) -> None:
        alignment_bytes = min(alignment_bytes, self.wire.max_alignment)
        self.append_constant_bytes(bytes(-self.size % alignment_bytes))


def _make_numpy_dtype(scalar_type: str) -> np.dtype[Any]:
    return np.dtype(_DTYPES.get(scalar_type, scalar_type)).newbyteorder("<")


def _find_common_list_length(column: RaggedColumn, message_indices: _Chosen) -> int:
    lengths = column.lengths[message_indices]
    return int(lengths[0]) if lengths.size else 0


def _find_list_length(column: Column, message_indices: _Chosen, fixed_length: int | None) -> int:
    if isinstance(column, RaggedColumn):
        length = _find_common_list_length(column, message_indices)
    elif isinstance(column, np.ndarray):
        length = int(column.shape[1])
    elif isinstance(column, list | tuple):
        length = len(column)
    else:
        length = fixed_length or 0
    assert fixed_length is None or length == fixed_length, (
        f"an array of {fixed_length} given {length} elements"
    )
    return length


def stack_elements_of_length(
    column: RaggedColumn, message_indices: _Chosen, length: int
) -> NDArray[Any]:
    """Stack the elements (k, length) of the selected lists, which all have this length."""
    assert isinstance(column.content, np.ndarray)
    return column.content[column.first_indices[message_indices][:, None] + np.arange(length)]
