"""The walk: a program over messages, noting where things lie.

Compiled by numba and cached on disk. It reads nothing outside a message: every length is held
against what is left of the message before anything moves, and every element of a list takes at
least a byte, so that a message of n bytes costs at most a multiple of n steps.

Most messages repeat the one before: where things lie depends on the size of a message and on the
lengths of its strings and lists, and on nothing else. Strings mostly are names of frames and
joints, so that they are compared as well, and what is the same is UTF-8 again. A message that
repeats all of these has the marks of the one before, moved.

It is one function: an array that is handed to another costs as much as a step.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.compiled import compiled
from replay.decoding.program import Column, Op
from replay.decoding.unaligned import fetch, load32, load64

Ints = NDArray[np.int64]

# plain integers: numba freezes them into the machine code
_BLOCK, _TEXT, _STRIDED, _LIST, _NEXT = (int(op) for op in Op)
(_OP, _ALIGNMENT, _SIZE, _STRIDE, _LENGTH, _MARK, _NODE, _JUMP) = (int(c) for c in Column)

#: What can be wrong with a message, by the number that the walk gives.
FAULTS: Final = (
    "",
    "it ends before its fields do",
    "a string is longer than what is left of it",
    "a string lacks its terminator",
    "a string is no UTF-8",
    "a list is longer than what is left of it",
    "it goes on behind its last field",
)
_ENDS, _LONG_TEXT, _NO_NUL, _NO_UTF8, _LONG_LIST, _GOES_ON = range(1, len(FAULTS))
#: What stands in the place of an encapsulation that a message is too short for.
TOO_SHORT: Final = -1
_NOT_ASCII: Final = np.uint64(0x8080808080808080).astype(np.int64)

#: Messages of one topic are apart from each other; the processor is told of what comes.
_AHEAD: Final = 16
_LINE_BYTES: Final = 64

#: A layout with more to compare, or more to note, is not remembered.
_MOST_CHECKS: Final = 64
_MOST_NOTES: Final = 256
#: After so many messages in a row that repeat nothing, only every so many-th is remembered.
_PATIENCE: Final = 8
_LATER: Final = 64


class Encoding(NamedTuple):
    """What of an encoding the walk needs."""

    #: strings end in a NUL, and up to 3 bytes may pad a message
    cdr: bool
    #: numbers are big-endian
    swap: bool
    #: alignment of the lengths of strings and lists
    counted: int


class Noted(NamedTuple):
    """What a walk notes."""

    #: (marks,) the node of each mark
    nodes: Ints
    #: (marks,) where the values of each begin in `marks`
    bases: Ints
    #: (nodes,) how many elements of each node there is room for; more are only counted
    room: Ints
    #: values by mark and element of its node
    marks: Ints
    #: (nodes,) how many elements each node has; messages that are not whole leave nothing, so that
    #: those of node 0 are the whole messages
    filled: Ints
    #: (nodes,) scratch, `filled` before the message
    kept: Ints
    #: (depth,) scratch, elements to go of the lists being walked
    left: Ints


class Layout(NamedTuple):
    """The layout of a message."""

    #: (checks, 2) bytes that must be the same: from the message's begin on, and how many
    checks: Ints
    #: (notes, 4) the mark, the element of its node counted from the message's first, a position
    #: from the message's begin on for the mark, and a count for it or for the next; -1 for neither
    notes: Ints
    #: (nodes,) how many elements it has of each node, but for the messages' own
    elements: Ints
    #: checks and notes that there are, -1 checks where none is remembered; begin and size of the
    #: message, and where it ended; messages in a row that repeated nothing
    state: Ints


def no_layout(nodes: int) -> Layout:
    """Memory for a layout, none remembered."""
    state = np.array([-1, 0, 0, 0, 0, 0])
    checks, notes = np.empty((_MOST_CHECKS, 2), np.int64), np.empty((_MOST_NOTES, 4), np.int64)
    return Layout(checks, notes, np.zeros(nodes, np.int64), state)


@compiled
def walk(
    data: NDArray[np.uint8],
    begins: Ints,
    sizes: Ints,
    first: int,
    end: int,
    encoding: Encoding,
    steps: Ints,
    noted: Noted,
    layout: Layout,
    faults: NDArray[np.int8],
    places: Ints,
) -> None:
    """Walk messages and note the marks of those that are whole.

    Args:
        data: (bytes,) what they lie in.
        begins: (n,) where each begins, behind its encapsulation; alignment counts from there.
        sizes: (n,) bytes of each from there on.
        first: the first of them.
        end: behind the last of them.
        encoding: of all of them.
        steps: the program.
        noted: takes their marks.
        layout: of the message before the first, if one is remembered; then of the last.
        faults: (n,) out, what is wrong with each message, see `FAULTS`.
        places: (n,) out, the byte where it ends or that was found.
    """
    cdr, swap, counted = encoding
    nodes, bases, room, marks, filled, kept, left = noted
    checks, notes, elements, state = layout
    check_count, note_count, other, other_size, other_end, walked = state
    for message in range(first, end):
        begin, size = begins[message], sizes[message]
        if message + _AHEAD < begins.size:
            ahead = begins[message + _AHEAD]
            for line in range(ahead, ahead + sizes[message + _AHEAD], _LINE_BYTES):
                fetch(data, line)

        same = check_count >= 0 and size == other_size
        check = 0
        while same and check < check_count:
            at = begin + checks[check, 0]
            gap = other - begin
            last = at + checks[check, 1]
            while same and at + 8 <= last:
                same = load64(data, at) == load64(data, at + gap)
                at += 8
            while same and at < last:
                same = data[at] == data[at + gap]
                at += 1
            check += 1
        if same:
            for number in range(note_count):
                mark = notes[number, 0]
                node = nodes[mark]
                element = filled[node] + notes[number, 1]
                if element < room[node]:
                    place, count = notes[number, 2], notes[number, 3]
                    if place >= 0:
                        marks[bases[mark] + element] = begin + place
                        mark += 1
                    if count >= 0:
                        marks[bases[mark] + element] = count
            for node in range(1, filled.size):
                filled[node] += elements[node]
            filled[0] += 1
            faults[message] = 0
            places[message] = other_end
            walked = 0
            continue

        remembered = walked < _PATIENCE or walked % _LATER == 0
        walked += 1
        check_count = note_count = 0
        for node in range(filled.size):
            kept[node] = filled[node]
        at = step = depth = fault = 0
        while step < steps.shape[0]:
            op, mark, node = steps[step, _OP], steps[step, _MARK], steps[step, _NODE]
            following = step + 1
            place = count = -1
            span = 0
            checked = at
            if op == _BLOCK:
                alignment = steps[step, _ALIGNMENT]
                at = (at + alignment - 1) & -alignment
                if steps[step, _SIZE] > size - at:
                    fault = _ENDS
                    break
                place = checked = at
                at += steps[step, _SIZE]
            elif op == _NEXT:
                if node >= 0:
                    filled[node] += 1
                left[depth - 1] -= 1
                if left[depth - 1] > 0:
                    following = steps[step, _JUMP]
                else:
                    depth -= 1
                mark = -1
            else:
                # all others begin with a length
                count = steps[step, _LENGTH]
                if count < 0:
                    at = (at + counted - 1) & -counted
                    if size - at < 4:
                        fault = _ENDS
                        break
                    count = load32(data, begin + at)
                    if swap:
                        count = (
                            count >> 24
                            | (count >> 8 & 0xFF00)
                            | (count & 0xFF00) << 8
                            | (count & 0xFF) << 24
                        )
                    checked = at
                    at += 4
                if op == _TEXT:
                    if count > size - at:
                        fault = _LONG_TEXT
                        break
                    place = at
                    at += count
                    if cdr and count > 0:
                        count -= 1
                        if data[begin + place + count] != 0:
                            fault = _NO_NUL
                            break
                    byte, last = begin + place, begin + place + count
                    while byte + 8 <= last and load64(data, byte) & _NOT_ASCII == 0:
                        byte += 8
                    while byte < last and data[byte] < 0x80:
                        byte += 1
                    if byte < last and not _is_utf8(data, byte, last):
                        fault = _NO_UTF8
                        break
                elif op == _STRIDED:
                    start = at
                    if count > 0:
                        alignment = steps[step, _ALIGNMENT]
                        start = (at + alignment - 1) & -alignment
                        # the first comparison keeps the product from overflowing
                        if count > size - start:
                            fault = _LONG_LIST
                            break
                        span = (count - 1) * steps[step, _STRIDE] + steps[step, _SIZE]
                    if span > size - start:
                        fault = _LONG_LIST
                        break
                    place = start
                else:
                    if count > size - at or count * steps[step, _SIZE] > size - at:
                        fault = _LONG_LIST
                        break
                    if count == 0:
                        following = steps[step, _JUMP]
                    else:
                        left[depth] = count
                        depth += 1
            if remembered and at > checked and op != _BLOCK:
                # the length, and what a string says
                if check_count == _MOST_CHECKS:
                    remembered = False
                else:
                    checks[check_count, 0] = checked
                    checks[check_count, 1] = at - checked
                    check_count += 1
            if op == _STRIDED:
                at = place + span
            if mark >= 0:
                element = filled[node]
                if remembered:
                    if note_count == _MOST_NOTES:
                        remembered = False
                    else:
                        notes[note_count, 0] = mark
                        notes[note_count, 1] = element - kept[node]
                        notes[note_count, 2] = place
                        notes[note_count, 3] = count
                        note_count += 1
                if element < room[node]:
                    if place >= 0:
                        marks[bases[mark] + element] = begin + place
                        mark += 1
                    if count >= 0:
                        marks[bases[mark] + element] = count
            step = following
        if fault == 0 and size - at > (3 if cdr else 0):
            fault = _GOES_ON
        faults[message] = fault
        places[message] = at
        if fault == 0 and remembered:
            other, other_size, other_end = begin, size, at
            for node in range(1, filled.size):
                elements[node] = filled[node] - kept[node]
        else:
            check_count = -1
        if fault == 0:
            filled[0] += 1
        else:
            for node in range(filled.size):
                filled[node] = kept[node]
    state[0], state[1], state[2] = check_count, note_count, other
    state[3], state[4], state[5] = other_size, other_end, walked


def encapsulations(data: NDArray[np.uint8], offsets: Ints, lengths: Ints) -> Ints:
    """The two bytes (n,) that name each message's encoding, most significant first."""
    kinds = np.empty(offsets.size, np.int64)
    _name_encodings(data, offsets, lengths, kinds)
    return kinds


@compiled
def _name_encodings(data: NDArray[np.uint8], offsets: Ints, lengths: Ints, kinds: Ints) -> None:
    for k in range(offsets.size):
        if k + _AHEAD < offsets.size:
            fetch(data, offsets[k + _AHEAD])
        at = offsets[k]
        kinds[k] = np.int64(data[at]) << 8 | data[at + 1] if lengths[k] >= 4 else TOO_SHORT


@compiled
def _is_utf8(data: NDArray[np.uint8], start: int, end: int) -> bool:
    """Whether bytes are UTF-8 as Unicode defines it (table 3-7), which Python decodes too."""
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
        # overlong forms, surrogates, what lies beyond U+10FFFF
        low = 0xA0 if first == 0xE0 else 0x90 if first == 0xF0 else 0x80
        high = 0x9F if first == 0xED else 0x8F if first == 0xF4 else 0xBF
        if second < low or second > high:
            return False
        for k in range(1, more):
            if data[at + k] & 0xC0 != 0x80:
                return False
        at += more
    return True
