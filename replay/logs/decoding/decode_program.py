"""A message definition as a program for `walk_messages`: order of fields, and what to note.

Only requested fields are noted. The whole message is walked, since whether it is complete must not
depend on the requested fields; consecutive numbers are one step.
"""

from dataclasses import dataclass, field
from enum import IntEnum
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from replay.logs.decoding.field_places import (
    InSpan,
    Located,
    NestedMessage,
    StridedList,
    TextField,
    WalkedList,
)
from replay.logs.decoding.spans import (
    NoPlanError,
    Span,
    append_field_to_span,
    element_stride_bytes,
    first_number_alignment_bytes,
    is_preceded_by_byte_size,
    list_stored_members,
    make_fixed_size_span,
    min_size_bytes,
)
from replay.logs.decoding.wire import Wire
from replay.logs.messages.message_types import FieldType, ListOf, RecordType, Scalar

#: Fields asked for, as a tree: by name, with the lists' elements left out. Empty for a leaf.
Wanted: TypeAlias = dict[str, "Wanted"]


class Op(IntEnum):
    """Operation of a step."""

    SPAN = 0
    TEXT = 1
    #: a list whose elements have one size
    STRIDED = 2
    #: a list whose elements are walked: the head, and the end of an element
    LIST = 3
    NEXT = 4


class Operand(IntEnum):
    """Meaning of the columns of `DecodeProgram.steps`; -1 for no mark or node."""

    OP = 0
    ALIGNMENT = 1
    #: of a span, or of one element of a list at least
    SIZE = 2
    STRIDE = 3
    #: of a list's elements, -1 where the message says it
    LENGTH = 4
    MARK = 5
    #: the node whose elements the marks belong to; of NEXT, the node whose element ends
    NODE = 6
    #: the step to go on with: of LIST when it is empty, of NEXT when there are more elements
    JUMP = 7


@dataclass(frozen=True, slots=True, eq=False)
class DecodeProgram:
    """Decoder of one message type in one wire encoding, compiled to steps."""

    #: encoding of the messages
    wire: Wire
    #: (steps, 8) int64, see `Column`
    steps: NDArray[np.int64]
    #: (marks,) the node of each mark
    mark_nodes: NDArray[np.int64]
    #: number of nodes of the type's tree
    nodes: int
    #: lists inside lists at most
    depth: int
    #: no message with fewer bytes is whole
    least_bytes: int
    #: the whole message
    root: NestedMessage


def compile_program(record: RecordType, wanted: Wanted, wire: Wire) -> DecodeProgram:
    """Compile the decoder of a message type.

    Raises:
        NoPlanError: a field fits no column, or the type is too large.
    """
    least_bytes = min_size_bytes(record, wire)
    compiler = _Compiler(wire)
    root = compiler.compile_record(record, wanted)
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
    wire: Wire
    steps: list[list[int]] = field(default_factory=list[list[int]])
    mark_nodes: list[int] = field(default_factory=list[int])
    nodes: int = 1
    #: whose element is being compiled; -1 where nothing of it is asked for
    node: int = 0
    depth: int = 0
    most_depth: int = 0
    #: the last step's span, while more can be appended to it
    span: Span | None = None

    def compile_record(self, record: RecordType, wanted: Wanted | None) -> NestedMessage:
        """Compile the fields of a message."""
        fields: dict[str, Located] = {}
        for name, kind in list_stored_members(record, self.wire):
            located = self._compile_field(kind, None if wanted is None else wanted.get(name))
            if located is not None:
                fields[name] = located
        return NestedMessage(fields)

    def _compile_field(self, kind: FieldType, wanted: Wanted | None) -> Located | None:
        if isinstance(kind, RecordType):
            return self.compile_record(kind, wanted)
        if kind == Scalar("string"):
            self._append_step(Op.TEXT)
            return None if wanted is None else TextField(self._reserve_marks(2))
        if make_fixed_size_span(kind, self.wire) is not None:
            return self._allocate_in_span(kind, wanted)
        assert isinstance(kind, ListOf), "a value that is neither list nor string has a fixed size"
        return self._compile_list(kind, wanted)

    def _allocate_in_span(self, kind: FieldType, wanted: Wanted | None) -> InSpan | None:
        """Place a number or fixed-size array in the open span, or else in a new one."""
        value = None if self.span is None else append_field_to_span(self.span, kind, self.wire)
        if value is None:
            # the first byte of a message is aligned to everything
            alignment = (
                first_number_alignment_bytes(kind, self.wire)
                if self.steps
                else self.wire.max_alignment
            )
            span = Span(alignment)
            value = append_field_to_span(span, kind, self.wire)
            assert value is not None
            self._append_step(Op.SPAN, alignment=alignment)
            self.span = span
        assert self.span is not None
        self.steps[-1][Operand.SIZE] = self.span.size
        return None if wanted is None else InSpan(self._reserve_marks(1), value)

    def _compile_list(self, kind: ListOf, wanted: Wanted | None) -> Located | None:
        if kind.length == 0:
            # rosbags pads before it; and lists of what takes no bytes would be walked without bound
            raise NoPlanError("no plan for an array of length 0 whose elements vary in size")
        if is_preceded_by_byte_size(kind, self.wire):
            self._allocate_in_span(Scalar("uint32"), None)
        least = min_size_bytes(kind.element, self.wire)
        length = -1 if kind.length is None else kind.length
        fixed = make_fixed_size_span(kind.element, self.wire)
        if fixed is None:
            return self._compile_walked_list(kind.element, length, least, wanted)
        # arrays of a fixed size lie in spans
        assert kind.length is None
        if not least:
            return self._allocate_in_span(Scalar("uint32"), None)
        one, value = fixed
        stride = element_stride_bytes(one)
        self._append_step(Op.STRIDED, alignment=one.alignment, size=one.size, stride=stride)
        return None if wanted is None else StridedList(self._reserve_marks(2), stride, value)

    def _compile_walked_list(
        self, element: FieldType, length: int, min_element_bytes: int, wanted: Wanted | None
    ) -> WalkedList | None:
        head = self._append_step(Op.LIST, size=min_element_bytes, length=length)
        mark = -1 if wanted is None else self._reserve_marks(1)
        above, self.node = self.node, -1 if wanted is None else self.nodes
        self.nodes += wanted is not None
        self.depth += 1
        self.most_depth = max(self.depth, self.most_depth)
        located = self._compile_field(element, wanted)
        end = self._append_step(Op.NEXT, jump=head + 1)
        self.steps[head][Operand.JUMP] = end + 1
        self.depth -= 1
        inner, self.node = self.node, above
        if wanted is None or located is None:
            return None
        return WalkedList(mark, inner, located)

    def _append_step(
        self,
        op: Op,
        *,
        alignment: int = 1,
        size: int = 0,
        stride: int = 0,
        length: int = -1,
        jump: int = -1,
    ) -> int:
        """Append a step, which closes the open span."""
        self.span = None
        self.steps.append([op, alignment, size, stride, length, -1, self.node, jump])
        return len(self.steps) - 1

    def _reserve_marks(self, count: int) -> int:
        """Reserve marks for the last step; returns the first one."""
        step = self.steps[-1]
        if step[Operand.MARK] < 0:
            step[Operand.MARK] = len(self.mark_nodes)
            self.mark_nodes += [self.node] * count
        return step[Operand.MARK]
