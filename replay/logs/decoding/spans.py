"""Spans: parts of a message whose layout is fixed by its definition."""

from dataclasses import dataclass
from typing import Final, NamedTuple

from replay.logs.decoding.field_places import InlineArray, InlineField, InlineRecord, InlineValue
from replay.logs.decoding.wire import WIDTHS, WireEncoding
from replay.logs.messages.message_types import FieldType, ListOf, RecordType, Scalar

#: Most bytes of a message: a definition whose messages must be larger is not a real one.
LARGEST_BYTES: Final = 2**30


class NoPlanError(Exception):
    """Raised if a type has no columnar plan; one line with the reason."""


@dataclass(slots=True)
class Span:
    """Fields at fixed offsets from a first byte whose position is a multiple of `alignment`."""

    alignment: int
    size: int = 0

    def append_field_bytes(self, alignment: int, size: int) -> int | None:
        """Append `size` bytes and return their offset; None if padding before them would vary."""
        if alignment > self.alignment:
            return None
        offset = -(-self.size // alignment) * alignment
        self.size = offset + size
        return offset


def get_alignment_bytes(field_type: str, wire: WireEncoding) -> int:
    """Alignment of a number or stamp, in bytes."""
    return min(
        4 if field_type == "stamp" else get_scalar_size_bytes(field_type), wire.max_alignment
    )


def get_scalar_size_bytes(scalar_type: str) -> int:
    """Size of a number or stamp, in bytes.

    Raises:
        NoPlanError: no column can hold the type.
    """
    if scalar_type == "stamp":
        return 8
    if scalar_type not in WIDTHS:
        raise NoPlanError(f"no plan for a {scalar_type}")
    return WIDTHS[scalar_type]


def list_members_as_encoded(
    record: RecordType, wire: WireEncoding
) -> tuple[tuple[str, FieldType], ...]:
    """List the fields as encoded: in CDR, an empty message has one of a byte."""
    return record.fields or ((("", Scalar("uint8")),) if wire.cdr else ())


def append_field_at_fixed_offset(
    bytes_span: Span, field_type: FieldType, wire: WireEncoding
) -> InlineValue | None:
    """Append a field to a span and return its place; None if its size or offset would vary."""
    if isinstance(field_type, Scalar):
        if field_type.kind == "string":
            return None
        offset = bytes_span.append_field_bytes(
            get_alignment_bytes(field_type.kind, wire), get_scalar_size_bytes(field_type.kind)
        )
        return None if offset is None else InlineField(offset, field_type.kind)
    if isinstance(field_type, RecordType):
        fields: dict[str, InlineValue] = {}
        for name, field in list_members_as_encoded(field_type, wire):
            placed = append_field_at_fixed_offset(bytes_span, field, wire)
            if placed is None:
                return None
            fields[name] = placed
        return InlineRecord(fields)
    if (
        field_type.length is None
        or make_span_of_fixed_size_element(field_type.element, wire) is None
    ):
        return None
    if is_preceded_by_byte_size(field_type, wire) and bytes_span.append_field_bytes(4, 4) is None:
        return None
    return append_array_at_fixed_offset(bytes_span, field_type.element, field_type.length, wire)


def append_array_at_fixed_offset(
    bytes_span: Span, element_type: FieldType, length: int, wire: WireEncoding
) -> InlineArray | None:
    """Append an array of fixed size and return its place; None if its offset would vary."""
    fixed = make_span_of_fixed_size_element(element_type, wire)
    assert fixed is not None
    one, value = fixed
    size = (length - 1) * compute_list_element_stride_bytes(one) + one.size if length else 0
    offset = bytes_span.append_field_bytes(one.alignment, size)
    return (
        None
        if offset is None
        else InlineArray(offset, length, compute_list_element_stride_bytes(one), value)
    )


class ElementSpan(NamedTuple):
    """Span of one list element, and the element's place in the span."""

    span: Span
    value: InlineValue


def make_span_of_fixed_size_element(
    element_type: FieldType, wire: WireEncoding
) -> ElementSpan | None:
    """Make the span of a single list element; None if its size varies."""
    span = Span(compute_first_number_alignment_bytes(element_type, wire))
    value = append_field_at_fixed_offset(span, element_type, wire)
    return None if value is None else ElementSpan(span, value)


def compute_list_element_stride_bytes(element_span: Span) -> int:
    """Distance between consecutive elements, in bytes."""
    return -(-element_span.size // element_span.alignment) * element_span.alignment


def compute_first_number_alignment_bytes(field_type: FieldType, wire: WireEncoding) -> int:
    """Alignment in bytes of a field's first number, which may be a string's length."""
    if isinstance(field_type, RecordType):
        filled = (
            f
            for _, f in list_members_as_encoded(field_type, wire)
            if compute_min_encoded_size_bytes(f, wire)
        )
        first = next(filled, None)
        return 1 if first is None else compute_first_number_alignment_bytes(first, wire)
    if isinstance(field_type, Scalar) and field_type.kind != "string":
        return get_alignment_bytes(field_type.kind, wire)
    if (
        isinstance(field_type, ListOf)
        and field_type.length is not None
        and not is_preceded_by_byte_size(field_type, wire)
    ):
        return compute_first_number_alignment_bytes(field_type.element, wire)
    return wire.length_alignment


def is_preceded_by_byte_size(list_type: ListOf, wire: WireEncoding) -> bool:
    """Whether a list is preceded by its size in bytes, as lists of anything but numbers may be."""
    is_number = isinstance(list_type.element, Scalar) and list_type.element.kind in WIDTHS
    return wire.delimited_lists and not is_number


def compute_min_encoded_size_bytes(field_type: FieldType, wire: WireEncoding) -> int:
    """Minimum size of a field in bytes, without padding.

    Raises:
        NoPlanError: the size exceeds `LARGEST_BYTES`.
    """
    if isinstance(field_type, Scalar):
        size = 4 if field_type.kind == "string" else get_scalar_size_bytes(field_type.kind)
    elif isinstance(field_type, RecordType):
        size = sum(
            compute_min_encoded_size_bytes(field, wire)
            for _, field in list_members_as_encoded(field_type, wire)
        )
    elif field_type.length is None:
        compute_min_encoded_size_bytes(field_type.element, wire)
        size = 4
    else:
        size = field_type.length * compute_min_encoded_size_bytes(field_type.element, wire)
    if size > LARGEST_BYTES:
        raise NoPlanError("a field is larger than any message")
    return size
