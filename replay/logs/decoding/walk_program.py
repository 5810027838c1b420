"""The walk: run a decode program over messages, and mark where their fields are.

Compiled by numba and cached on disk. It reads nothing outside a message: every length is compared
with the rest of the message before advancing, and every element of a list takes at least a byte, so
that a message of n bytes costs at most a multiple of n steps.

Most messages repeat the layout of the previous one, which depends only on the size of a message and
on the lengths of its strings and lists. Strings are mostly names of frames and joints, so they are
compared as well, and an equal string needs no second UTF-8 check. A message that repeats all of
these has the marks of the previous one, shifted.

Passing an array from one compiled function to another costs as much as a step if references are
counted; here they are not (`estimators.compiled.compiled_without_refcounts`).
"""

from typing import Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Bytes, Ints
from estimators.interpreted import compiled, compiled_inline, compiled_without_refcounts
from replay.logs.decoding.bytes_at import fetch, load32, load64
from replay.logs.decoding.decode_program import DecodeOperation, Operand

# plain integers: numba freezes them into the machine code
_SPAN, _TEXT, _STRIDED, _LIST, _NEXT = (int(op) for op in DecodeOperation)
(_OP, _ALIGNMENT, _SIZE, _STRIDE, _LENGTH, _MARK, _NODE, _JUMP) = (int(c) for c in Operand)

#: Faults of a message, by the number that the walk returns.
FAULTS: Final = (
    "",
    "it ends before its last field",
    "a string is longer than the rest of the message",
    "a string lacks its terminator",
    "a string in it is not UTF-8",
    "a list is longer than the rest of the message",
    "it has data after its last field",
)
_ENDS, _LONG_TEXT, _NO_NUL, _NO_UTF8, _LONG_LIST, _GOES_ON = range(1, len(FAULTS))
#: Stands for the encapsulation of a message that is too short to have one.
TOO_SHORT: Final = -1
_NOT_ASCII: Final = np.uint64(0x8080808080808080).astype(np.int64)

#: Number of messages by which prefetching is ahead: messages of one topic are not contiguous.
_AHEAD: Final = 16
_LINE_BYTES: Final = 64

#: Most byte ranges and notes of a template; a message with more is not used as one.
_MOST_CHECKS: Final = 64
_MOST_NOTES: Final = 256
#: After this many messages in a row without a repeated layout, fewer become templates.
_PATIENCE: Final = 8
_LATER: Final = 64


class EncodedMessages(NamedTuple):
    """Messages of one encoding."""

    #: (bytes,) bytes that contain the messages
    data: Bytes
    #: (n,) start of each message after its encapsulation, from which alignment counts
    begins: Ints
    #: (n,) bytes of each message, without its encapsulation
    sizes: Ints


class Encoding(NamedTuple):
    """Properties of an encoding that the walk needs."""

    #: strings end in a NUL, and up to 3 bytes may pad a message
    cdr: bool
    #: numbers are big-endian
    swap: bool
    #: alignment of the lengths of strings and lists
    length_alignment: int


class WalkNotes(NamedTuple):
    """Marks that a walk has stored, and its scratch memory."""

    #: (marks, 3) node of each mark, start of its values in `marks`, and number of elements for
    #: which there is room; more are only counted
    table: Ints
    #: values by mark and element of its node
    marks: Ints
    #: (nodes,) number of elements of each node; incomplete messages do not count, so that the
    #: elements of node 0 are the complete messages
    filled: Ints
    #: (nodes,) scratch: `filled` before the message
    kept: Ints
    #: (depth,) scratch: remaining elements of the lists being walked
    left: Ints


class LayoutTemplate(NamedTuple):
    """Layout of a message, reused for messages that repeat it."""

    #: (checks, 2) bytes that must be equal: their offset in the message, and their number
    checks: Ints
    #: (notes, 4) the mark, the element of its node from the message's first, a position in the
    #: message for the mark, and a count for it or for the next mark; -1 for no position or count
    notes: Ints
    #: (nodes,) number of elements that the message has of each node, except node 0
    elements: Ints
    #: number of checks (-1 without a template) and of notes; start, size and end of the message;
    #: number of messages in a row that repeated no layout
    state: Ints


class WalkOutcome(NamedTuple):
    """Outcome of each walked message."""

    #: (n,) fault of each message, see `FAULTS`
    faults: NDArray[np.int8]
    #: (n,) byte at which each message ends, or at which its fault was found
    places: Ints


def allocate_message_layout_template(node_count: int) -> LayoutTemplate:
    """Allocate memory for a template, initially empty."""
    state = np.array([-1, 0, 0, 0, 0, 0])
    checks, notes = np.empty((_MOST_CHECKS, 2), np.int64), np.empty((_MOST_NOTES, 4), np.int64)
    return LayoutTemplate(checks, notes, np.zeros(node_count, np.int64), state)


@compiled_without_refcounts
def locate_fields_in_messages(
    messages: EncodedMessages,
    first: int,
    end: int,
    encoding: Encoding,
    steps: Ints,
    walk_notes: WalkNotes,
    template: LayoutTemplate,
    outcome: WalkOutcome,
) -> None:
    """Walk messages, and note the marks of the complete ones.

    Args:
        messages: all messages.
        first: first message to walk.
        end: end of the messages to walk.
        encoding: their encoding.
        steps: the program.
        walk_notes: receives the marks.
        template: in: layout of the previous message, if any; out: of the last one.
        outcome: receives the outcome of each message.
    """
    data, starts, sizes = messages
    faults, places = outcome
    table, marks, filled, kept, left = walk_notes
    checks, notes, elements, state = template
    check_count, note_count, other, other_size, other_end, walked = state
    for message in range(first, end):
        start, size = starts[message], sizes[message]
        _prefetch_message(data, starts, sizes, message)
        is_known = check_count >= 0 and size == other_size
        if is_known and has_same_layout_bytes(data, start, other, checks, check_count):
            _fill_positions_from_repeated_layout(table, marks, filled, notes, note_count, start)
            _count_message_and_its_elements(filled, elements)
            faults[message] = 0
            places[message] = other_end
            walked = 0
            continue
        check_count = 0 if walked < _PATIENCE or walked % _LATER == 0 else -1
        walked += 1
        _copy_filled_counts(filled, kept)
        at = step = depth = fault = note_count = 0
        while step < steps.shape[0]:
            place, count, length_end, stop, at, fault = read_decode_step(
                data, start, at, size, steps, step, encoding
            )
            if fault != 0:
                break
            check_count = _append_range_to_compare(checks, check_count, length_end, stop)
            mark = steps[step, _MARK]
            if mark >= 0:
                node = steps[step, _NODE]
                element = int(filled[node])
                check_count, note_count = _add_note_to_template(
                    notes, check_count, note_count, mark, element - int(kept[node]), place, count
                )
                _fill_position_and_count(table, marks, mark, element, place, count, start)
            step, depth = find_next_step(steps, step, filled, left, depth, count)
        if fault == 0 and size - at > (3 if encoding.cdr else 0):
            fault = _GOES_ON
        faults[message] = fault
        places[message] = at
        if fault == 0:
            other, other_size, other_end = start, size, at
            _count_message_and_store_list_lengths(filled, kept, elements)
        else:
            check_count = -1
            _copy_filled_counts(kept, filled)
    state[0], state[1], state[2] = check_count, note_count, other
    state[3], state[4], state[5] = other_size, other_end, walked


@compiled_inline
def _prefetch_message(data: Bytes, starts: Ints, sizes: Ints, message_index: int) -> None:
    """Prefetch a later message into the processor's cache."""
    if message_index + _AHEAD < starts.size:
        start = starts[message_index + _AHEAD]
        for line in range(start, start + sizes[message_index + _AHEAD], _LINE_BYTES):
            fetch(data, line)


@compiled_inline
def has_same_layout_bytes(
    data: Bytes, start: int, other_begin: int, ranges_to_compare: Ints, range_count: int
) -> bool:
    """Whether a message equals another of the same size in all bytes that determine the layout."""
    gap = other_begin - start
    same = True
    check = 0
    while same and check < range_count:
        at = start + ranges_to_compare[check, 0]
        last = at + ranges_to_compare[check, 1]
        while same and at + 8 <= last:
            same = load64(data, at) == load64(data, at + gap)
            at += 8
        while same and at < last:
            same = data[at] == data[at + gap]
            at += 1
        check += 1
    return same


@compiled_inline
def _fill_positions_from_repeated_layout(
    table: Ints, marks: Ints, filled_counts: Ints, template_notes: Ints, count: int, start: int
) -> None:
    """Write the marks of a message that repeats another's layout."""
    for number in range(count):
        mark = template_notes[number, 0]
        element = filled_counts[table[mark, 0]] + template_notes[number, 1]
        _fill_position_and_count(
            table, marks, mark, element, template_notes[number, 2], template_notes[number, 3], start
        )


@compiled_inline
def _fill_position_and_count(
    table: Ints, marks: Ints, mark: int, element: int, position: int, count: int, start: int
) -> None:
    """Write position and count of an element, each unless it is -1, if there is room."""
    if element < table[mark, 2]:
        if position >= 0:
            marks[table[mark, 1] + element] = start + position
            mark += 1
        if count >= 0:
            marks[table[mark, 1] + element] = count


#: Numbers of checks and of notes; -1 checks if the template is full.
CheckAndNoteCounts: TypeAlias = tuple[int, int]


@compiled_inline
def _add_note_to_template(
    notes: Ints, checks: int, count: int, mark: int, element: int, position: int, value: int
) -> CheckAndNoteCounts:
    """Add a note to the template; return its numbers of checks and notes, -1 checks if full."""
    if checks < 0:
        return checks, count
    if count == _MOST_NOTES:
        return -1, count
    notes[count, 0] = mark
    notes[count, 1] = element
    notes[count, 2] = position
    notes[count, 3] = value
    return checks, count + 1


@compiled_inline
def _copy_filled_counts(filled_counts: Ints, out: Ints) -> None:
    for node in range(filled_counts.size):
        out[node] = filled_counts[node]


@compiled_inline
def _count_message_and_its_elements(filled_counts: Ints, elements: Ints) -> None:
    """Count a message that repeats a template, and the elements of its lists."""
    for node in range(1, filled_counts.size):
        filled_counts[node] += elements[node]
    filled_counts[0] += 1


@compiled_inline
def _count_message_and_store_list_lengths(filled: Ints, kept: Ints, elements: Ints) -> None:
    """Count a message, and store in the template how many elements its lists have."""
    for node in range(1, filled.size):
        elements[node] = filled[node] - kept[node]
    filled[0] += 1


#: Index of a step, and its depth of nested lists.
StepAndDepth: TypeAlias = tuple[int, int]


@compiled_inline
def find_next_step(
    steps: Ints, step: int, filled_counts: Ints, elements_left: Ints, depth: int, count: int
) -> StepAndDepth:
    """Find the next step and its depth of nested lists, and count the elements of lists."""
    op = steps[step, _OP]
    if op == _NEXT:
        node = steps[step, _NODE]
        if node >= 0:
            filled_counts[node] += 1
        elements_left[depth - 1] -= 1
        if elements_left[depth - 1] > 0:
            return steps[step, _JUMP], depth
        return step + 1, depth - 1
    if op == _LIST:
        if count == 0:
            return steps[step, _JUMP], depth
        elements_left[depth] = count
        return step + 1, depth + 1
    return step + 1, depth


@compiled_inline
def read_decode_step(
    data: Bytes, start: int, offset: int, size: int, steps: Ints, step: int, encoding: Encoding
) -> tuple[int, int, int, int, int, int]:
    """Locate and check the bytes of one step.

    Returns:
        Position and count (-1 for none), start and end of the bytes that determine the layout,
        position after the step, and fault (0 for none).
    """
    op = steps[step, _OP]
    if op == _NEXT:
        return -1, -1, offset, offset, offset, 0
    if op == _SPAN:
        alignment = steps[step, _ALIGNMENT]
        offset = (offset + alignment - 1) & -alignment
        if steps[step, _SIZE] > size - offset:
            return -1, -1, offset, offset, offset, _ENDS
        return offset, -1, offset, offset, offset + steps[step, _SIZE], 0
    count, length_end, offset, fault = _read_length_field(
        data, start, offset, size, encoding, steps[step, _LENGTH]
    )
    if fault != 0:
        return -1, -1, length_end, offset, offset, fault
    if op == _TEXT:
        place, count, end, fault = _locate_string(data, start, offset, size, count, encoding.cdr)
        return place, count, length_end, end, end, fault
    if op == _STRIDED:
        place, end, fault = _locate_strided_elements(steps, step, offset, size, count)
        return place, count, length_end, offset, end if fault == 0 else offset, fault
    # each element has at least a byte; the first comparison prevents overflow of the product
    is_long = count > size - offset or count * steps[step, _SIZE] > size - offset
    return -1, count, length_end, offset, offset, _LONG_LIST if is_long else 0


#: Length, start and end of the bytes that state it, and fault.
LengthField: TypeAlias = tuple[int, int, int, int]


@compiled_inline
def _read_length_field(
    data: Bytes, start: int, offset: int, size: int, encoding: Encoding, fixed_length: int
) -> LengthField:
    """Read the length of a string or list, unless the definition fixes it (then not negative)."""
    if fixed_length >= 0:
        return fixed_length, offset, offset, 0
    offset = (offset + encoding.length_alignment - 1) & -encoding.length_alignment
    if size - offset < 4:
        return 0, offset, offset, _ENDS
    length = load32(data, start + offset)
    if encoding.swap:
        length = (
            length >> 24 | (length >> 8 & 0xFF00) | (length & 0xFF00) << 8 | (length & 0xFF) << 24
        )
    return length, offset, offset + 4, 0


#: Start of a string, its bytes without terminator, its end, and fault.
StringLocation: TypeAlias = tuple[int, int, int, int]


@compiled_inline
def _locate_string(
    data: Bytes, message_start: int, offset: int, message_size: int, text_length: int, is_cdr: bool
) -> StringLocation:
    """Locate the text of a string without its terminator, and check that it is UTF-8."""
    if text_length > message_size - offset:
        return offset, text_length, offset, _LONG_TEXT
    stop, count = offset + text_length, text_length
    if is_cdr and text_length > 0:
        count -= 1
        if data[message_start + offset + count] != 0:
            return offset, count, stop, _NO_NUL
    byte, last = message_start + offset, message_start + offset + count
    while byte + 8 <= last and load64(data, byte) & _NOT_ASCII == 0:
        byte += 8
    while byte < last and data[byte] < 0x80:
        byte += 1
    is_text = byte == last or is_utf8(data, byte, last)
    return offset, count, stop, 0 if is_text else _NO_UTF8


#: Start and end of a list's elements, and fault.
ElementsLocation: TypeAlias = tuple[int, int, int]


@compiled_inline
def _locate_strided_elements(
    steps: Ints, step: int, offset: int, size: int, count: int
) -> ElementsLocation:
    """Locate the elements of a list of fixed-size elements."""
    span = 0
    if count > 0:
        alignment = steps[step, _ALIGNMENT]
        offset = (offset + alignment - 1) & -alignment
        # the comparison prevents overflow of the product
        if count > size - offset:
            return offset, offset, _LONG_LIST
        span = (count - 1) * steps[step, _STRIDE] + steps[step, _SIZE]
    return offset, offset + span, _LONG_LIST if span > size - offset else 0


@compiled_inline
def _append_range_to_compare(ranges: Ints, range_count: int, start: int, end: int) -> int:
    """Append a range of bytes to compare; return the number of ranges, -1 if there is no room."""
    if range_count < 0 or end == start:
        return range_count
    if range_count == _MOST_CHECKS:
        return -1
    ranges[range_count, 0] = start
    ranges[range_count, 1] = end - start
    return range_count + 1


def read_encapsulation_identifiers(data: NDArray[np.uint8], offsets: Ints, lengths: Ints) -> Ints:
    """Read each message's encapsulation identifier, its first two bytes big-endian, (n,)."""
    identifiers = np.empty(offsets.size, np.int64)
    _fill_encapsulation_identifiers(data, offsets, lengths, identifiers)
    return identifiers


@compiled
def _fill_encapsulation_identifiers(
    data: NDArray[np.uint8], offsets: Ints, lengths: Ints, out_identifiers: Ints
) -> None:
    for k in range(offsets.size):
        if k + _AHEAD < offsets.size:
            fetch(data, offsets[k + _AHEAD])
        at = offsets[k]
        out_identifiers[k] = (
            np.int64(data[at]) << 8 | data[at + 1] if lengths[k] >= 4 else TOO_SHORT
        )


@compiled_without_refcounts
def is_utf8(data: NDArray[np.uint8], start: int, end: int) -> bool:
    """Whether bytes are valid UTF-8 (Unicode table 3-7), as Python decodes it."""
    at = start
    while at < end:
        first = data[at]
        at += 1
        if first < 0x80:
            continue
        if 0xC2 <= first <= 0xDF:
            more = 1
        elif 0xE0 <= first <= 0xEF:
            more = 2
        elif 0xF0 <= first <= 0xF4:
            more = 3
        else:
            return False
        if more > end - at:
            return False
        second = data[at]
        # overlong forms, surrogates, values beyond U+10FFFF
        low = 0xA0 if first == 0xE0 else 0x90 if first == 0xF0 else 0x80
        high = 0x9F if first == 0xED else 0x8F if first == 0xF4 else 0xBF
        if second < low or second > high:
            return False
        for k in range(1, more):
            if data[at + k] & 0xC0 != 0x80:
                return False
        at += more
    return True
