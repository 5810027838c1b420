"""Compile a message definition to a program of `locate_fields_in_messages`.

The steps of the program are the fields in order; consecutive numbers are one step. Only requested
fields are marked, but the whole message is walked, since whether it is complete must not depend on
the requested fields.
"""

from dataclasses import dataclass, field
from enum import IntEnum
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from replay.logs.decoding.field_places import (
    FieldPlace,
    NestedMessage,
    SpanField,
    StridedList,
    TextField,
    WalkedList,
)
from replay.logs.decoding.spans import (
    NoPlanError,
    Span,
    append_field_at_fixed_offset,
    compute_first_number_alignment_bytes,
    compute_list_element_stride_bytes,
    compute_min_encoded_size_bytes,
    is_preceded_by_byte_size,
    list_members_as_encoded,
    make_span_of_fixed_size_element,
)
from replay.logs.decoding.wire import WireEncoding
from replay.logs.messages.message_types import FieldType, ListOf, RecordType, Scalar

#: Requested fields as a tree by name, in which lists have no level of their own; {} for a leaf.
Wanted: TypeAlias = dict[str, "Wanted"]


class DecodeOperation(IntEnum):
    """Operation of a step."""

    SPAN = 0
    TEXT = 1
    #: a list whose elements have one size
    STRIDED = 2
    #: a list whose elements are walked: its start, and (NEXT) the end of an element
    LIST = 3
    NEXT = 4


class Operand(IntEnum):
    """Meaning of the columns of `DecodeProgram.steps`; -1 for no mark or node."""

    OP = 0
    ALIGNMENT = 1
    #: bytes of a span, or the least of one list element
    SIZE = 2
    STRIDE = 3
    #: number of a list's elements, -1 if the message states it
    LENGTH = 4
    MARK = 5
    #: the node whose elements the marks belong to; for NEXT, the node whose element ends
    NODE = 6
    #: the step to continue with: for LIST if it is empty, for NEXT if there are more elements
    JUMP = 7


@dataclass(frozen=True, slots=True, eq=False)
class DecodeProgram:
    """Decoder of one message type in one wire encoding, compiled to steps."""

    #: encoding of the messages
    wire: WireEncoding
    #: (steps, 8) int64, with the columns of `Operand`
    steps: NDArray[np.int64]
    #: (marks,) the node of each mark
    mark_nodes: NDArray[np.int64]
    #: number of nodes of the type's tree
    nodes: int
    #: largest depth of nested lists
    depth: int
    #: fewest bytes of a complete message
    least_bytes: int
    #: places of the requested fields in the message
    root: NestedMessage


def compile_decode_program(
    record: RecordType, wanted_fields: Wanted, wire: WireEncoding
) -> DecodeProgram:
    """Compile the program of a message type.

    Raises:
        NoPlanError: a field fits no column, or the type is too large.
    """
    least_bytes = compute_min_encoded_size_bytes(record, wire)
    compiler = _Compiler(wire)
    root = compiler.compile_message_fields(record, wanted_fields)
    steps = np.array(compiler.steps, np.int64).reshape(-1, len(Operand))
    return DecodeProgram(
        wire,
        steps,
        np.array(compiler.mark_nodes, np.int64),
        compiler.nodes,
        compiler.most_depth,
        least_bytes,
        root,
    )


@dataclass(slots=True)
class _Compiler:
    wire: WireEncoding
    steps: list[list[int]] = field(default_factory=list[list[int]])
    mark_nodes: list[int] = field(default_factory=list[int])
    nodes: int = 1
    #: node whose element is being compiled; -1 if none of its fields is requested
    node: int = 0
    depth: int = 0
    most_depth: int = 0
    #: span of the last step, while more can be appended to it
    span: Span | None = None

    def compile_message_fields(
        self, record: RecordType, wanted_fields: Wanted | None
    ) -> NestedMessage:
        """Compile the fields of a message, and return the places of the requested ones."""
        fields: dict[str, FieldPlace] = {}
        for name, kind in list_members_as_encoded(record, self.wire):
            located = self._compile_field_of_type(
                kind, None if wanted_fields is None else wanted_fields.get(name)
            )
            if located is not None:
                fields[name] = located
        return NestedMessage(fields)

    def _compile_field_of_type(
        self, field_type: FieldType, wanted_subfields: Wanted | None
    ) -> FieldPlace | None:
        if isinstance(field_type, RecordType):
            return self.compile_message_fields(field_type, wanted_subfields)
        if field_type == Scalar("string"):
            self._close_span_and_append_step(DecodeOperation.TEXT)
            return (
                None
                if wanted_subfields is None
                else TextField(self._allocate_first_mark_of_last_step(2))
            )
        if make_span_of_fixed_size_element(field_type, self.wire) is not None:
            return self._append_to_span(field_type, wanted_subfields)
        assert isinstance(field_type, ListOf), (
            "a value that is neither list nor string has a fixed size"
        )
        return self._compile_list_and_locate_it(field_type, wanted_subfields)

    def _append_to_span(
        self, field_type: FieldType, wanted_subfields: Wanted | None
    ) -> SpanField | None:
        """Place a number or fixed-size array in the open span, or else in a new one."""
        value = (
            None
            if self.span is None
            else append_field_at_fixed_offset(self.span, field_type, self.wire)
        )
        if value is None:
            # the first byte of a message has any alignment
            alignment = (
                compute_first_number_alignment_bytes(field_type, self.wire)
                if self.steps
                else self.wire.max_alignment
            )
            span = Span(alignment)
            value = append_field_at_fixed_offset(span, field_type, self.wire)
            assert value is not None
            self._close_span_and_append_step(DecodeOperation.SPAN, alignment=alignment)
            self.span = span
        assert self.span is not None
        self.steps[-1][Operand.SIZE] = self.span.size
        return (
            None
            if wanted_subfields is None
            else SpanField(self._allocate_first_mark_of_last_step(1), value)
        )

    def _compile_list_and_locate_it(
        self, list_type: ListOf, wanted_subfields: Wanted | None
    ) -> FieldPlace | None:
        if list_type.length == 0:
            # rosbags pads before it, and the walk over elements of no bytes would be unbounded
            raise NoPlanError("no plan for an array of length 0 whose elements vary in size")
        if is_preceded_by_byte_size(list_type, self.wire):
            self._append_to_span(Scalar("uint32"), None)
        least = compute_min_encoded_size_bytes(list_type.element, self.wire)
        length = -1 if list_type.length is None else list_type.length
        fixed = make_span_of_fixed_size_element(list_type.element, self.wire)
        if fixed is None:
            return self._compile_list_of_varying_elements(
                list_type.element, length, least, wanted_subfields
            )
        # arrays of fixed size are in spans
        assert list_type.length is None
        if not least:
            return self._append_to_span(Scalar("uint32"), None)
        one, value = fixed
        stride = compute_list_element_stride_bytes(one)
        self._close_span_and_append_step(
            DecodeOperation.STRIDED, alignment=one.alignment, size=one.size, stride=stride
        )
        return (
            None
            if wanted_subfields is None
            else StridedList(self._allocate_first_mark_of_last_step(2), stride, value)
        )

    def _compile_list_of_varying_elements(
        self,
        element_type: FieldType,
        length: int,
        min_element_bytes: int,
        wanted_subfields: Wanted | None,
    ) -> WalkedList | None:
        head = self._close_span_and_append_step(
            DecodeOperation.LIST, size=min_element_bytes, length=length
        )
        mark = -1 if wanted_subfields is None else self._allocate_first_mark_of_last_step(1)
        above, self.node = self.node, -1 if wanted_subfields is None else self.nodes
        self.nodes += wanted_subfields is not None
        self.depth += 1
        self.most_depth = max(self.depth, self.most_depth)
        located = self._compile_field_of_type(element_type, wanted_subfields)
        end = self._close_span_and_append_step(DecodeOperation.NEXT, jump=head + 1)
        self.steps[head][Operand.JUMP] = end + 1
        self.depth -= 1
        inner, self.node = self.node, above
        if wanted_subfields is None or located is None:
            return None
        return WalkedList(mark, inner, located)

    def _close_span_and_append_step(
        self,
        operation: DecodeOperation,
        *,
        alignment: int = 1,
        size: int = 0,
        stride: int = 0,
        length: int = -1,
        jump: int = -1,
    ) -> int:
        """Append a step, which closes the open span, and return its index."""
        self.span = None
        self.steps.append([operation, alignment, size, stride, length, -1, self.node, jump])
        return len(self.steps) - 1

    def _allocate_first_mark_of_last_step(self, count: int) -> int:
        """Reserve marks for the last step, unless it has some, and return the first one."""
        step = self.steps[-1]
        if step[Operand.MARK] < 0:
            step[Operand.MARK] = len(self.mark_nodes)
            self.mark_nodes += [self.node] * count
        return step[Operand.MARK]
