"""Spans: stretches of a message whose layout its definition fixes."""

from dataclasses import dataclass
from typing import Final

from replay.logs.decoding.field_places import InlineArray, InlineField, InlineRecord, InlineValue
from replay.logs.decoding.wire import WIDTHS, Wire
from replay.logs.messages.message_types import FieldType, ListOf, RecordType, Scalar

#: A definition whose messages must be larger than this describes none that exists.
LARGEST_BYTES: Final = 2**30


class NoPlanError(Exception):
    """A type has no columnar plan; one line with the reason."""


@dataclass(slots=True)
class Span:
    """Numbers at fixed distances from a first byte that is a multiple of `alignment`."""

    alignment: int
    size: int = 0

    def append_field(self, alignment: int, size: int) -> int | None:
        """Append `size` bytes and return their offset; None where padding would vary."""
        if alignment > self.alignment:
            return None
        offset = -(-self.size // alignment) * alignment
        self.size = offset + size
        return offset


def find_alignment_bytes(kind: str, wire: Wire) -> int:
    """Alignment of a number or stamp, in bytes."""
    return min(4 if kind == "stamp" else find_width_bytes(kind), wire.max_alignment)


def find_width_bytes(kind: str) -> int:
    """Size of a number or stamp, in bytes.

    Raises:
        NoPlanError: the type fits no column.
    """
    if kind == "stamp":
        return 8
    if kind not in WIDTHS:
        raise NoPlanError(f"no plan for a {kind}")
    return WIDTHS[kind]


def list_stored_members(record: RecordType, wire: Wire) -> tuple[tuple[str, FieldType], ...]:
    """The fields as stored: an empty message takes a byte in CDR."""
    return record.fields or ((("", Scalar("uint8")),) if wire.cdr else ())


def append_field_to_span(span: Span, kind: FieldType, wire: Wire) -> InlineValue | None:
    """Append a field to a span; None if its place would vary."""
    if isinstance(kind, Scalar):
        if kind.kind == "string":
            return None
        offset = span.append_field(
            find_alignment_bytes(kind.kind, wire), find_width_bytes(kind.kind)
        )
        return None if offset is None else InlineField(offset, kind.kind)
    if isinstance(kind, RecordType):
        fields: dict[str, InlineValue] = {}
        for name, field in list_stored_members(kind, wire):
            placed = append_field_to_span(span, field, wire)
            if placed is None:
                return None
            fields[name] = placed
        return InlineRecord(fields)
    if kind.length is None or make_fixed_size_span(kind.element, wire) is None:
        return None
    if is_preceded_by_byte_size(kind, wire) and span.append_field(4, 4) is None:
        return None
    return append_array_to_span(span, kind.element, kind.length, wire)


def append_array_to_span(
    span: Span, element: FieldType, length: int, wire: Wire
) -> InlineArray | None:
    """Append an array of fixed size; None if its place would vary."""
    fixed = make_fixed_size_span(element, wire)
    assert fixed is not None
    one, value = fixed
    size = (length - 1) * element_stride_bytes(one) + one.size if length else 0
    offset = span.append_field(one.alignment, size)
    return None if offset is None else InlineArray(offset, length, element_stride_bytes(one), value)


def make_fixed_size_span(element: FieldType, wire: Wire) -> tuple[Span, InlineValue] | None:
    """An element as a span of its own; None if its size varies."""
    span = Span(first_number_alignment_bytes(element, wire))
    value = append_field_to_span(span, element, wire)
    return None if value is None else (span, value)


def element_stride_bytes(span: Span) -> int:
    """Distance between consecutive elements, in bytes."""
    return -(-span.size // span.alignment) * span.alignment


def first_number_alignment_bytes(kind: FieldType, wire: Wire) -> int:
    """Alignment of a field's first number, which may be a string's length."""
    if isinstance(kind, RecordType):
        filled = (f for _, f in list_stored_members(kind, wire) if min_size_bytes(f, wire))
        first = next(filled, None)
        return 1 if first is None else first_number_alignment_bytes(first, wire)
    if isinstance(kind, Scalar) and kind.kind != "string":
        return find_alignment_bytes(kind.kind, wire)
    if (
        isinstance(kind, ListOf)
        and kind.length is not None
        and not is_preceded_by_byte_size(kind, wire)
    ):
        return first_number_alignment_bytes(kind.element, wire)
    return wire.length_alignment


def is_preceded_by_byte_size(kind: ListOf, wire: Wire) -> bool:
    """Whether a list is preceded by its size in bytes; a stamp counts as a message."""
    is_number = isinstance(kind.element, Scalar) and kind.element.kind in WIDTHS
    return wire.delimited_lists and not is_number


def min_size_bytes(kind: FieldType, wire: Wire) -> int:
    """Minimum size of a field in bytes, without padding.

    Raises:
        NoPlanError: it exceeds the largest message.
    """
    if isinstance(kind, Scalar):
        size = 4 if kind.kind == "string" else find_width_bytes(kind.kind)
    elif isinstance(kind, RecordType):
        size = sum(min_size_bytes(field, wire) for _, field in list_stored_members(kind, wire))
    elif kind.length is None:
        min_size_bytes(kind.element, wire)
        size = 4
    else:
        size = kind.length * min_size_bytes(kind.element, wire)
    if size > LARGEST_BYTES:
        raise NoPlanError("a field is larger than any message")
    return size
