"""The walk: a program over a batch of messages, noting where things lie.

Compiled by numba and cached on disk. It reads nothing outside a message: every length is held
against what is left of the message before anything moves, and every element of a list takes at
least a byte, so that a message of n bytes costs at most a multiple of n steps.
"""

from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from replay.decoding.program import Column, Op

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


@njit(cache=True, nogil=True)
def walk(
    data: NDArray[np.uint8],
    begins: Ints,
    sizes: Ints,
    cdr: bool,
    swap: bool,
    counted: int,
    steps: Ints,
    bases: Ints,
    room: Ints,
    marks: Ints,
    filled: Ints,
    kept: Ints,
    left: Ints,
    faults: NDArray[np.int8],
    places: Ints,
) -> None:
    """Walk messages and note the marks of those that are whole.

    Args:
        data: (bytes,) what the messages lie in.
        begins: (n,) where each begins, behind its encapsulation; alignment counts from there.
        sizes: (n,) bytes of each from there on.
        cdr: whether strings end in a NUL, and up to 3 bytes may pad a message.
        swap: whether numbers are big-endian.
        counted: alignment of the lengths of strings and lists.
        steps: the program.
        bases: (marks,) where the values of each mark begin in `marks`.
        room: (nodes,) how many elements of each node `marks` has room for; more are only counted.
        marks: out, values by mark and element of its node.
        filled: (nodes,) in: zeros; out: how many elements each node has. Messages that are not
            whole leave nothing, so that those of node 0 are the whole messages.
        kept: (nodes,) scratch, `filled` before the message.
        left: (depth,) scratch, elements to go of the lists being walked.
        faults: (n,) out, what is wrong with each message, see `FAULTS`.
        places: (n,) out, the byte where that was found.
    """
    for message in range(begins.size):
        begin = begins[message]
        size = sizes[message]
        at = 0
        step = 0
        depth = 0
        fault = 0
        for node in range(filled.size):
            kept[node] = filled[node]
        while step < steps.shape[0]:
            op = steps[step, _OP]
            mark = steps[step, _MARK]
            node = steps[step, _NODE]
            if mark >= 0 and filled[node] >= room[node]:
                mark = -1
            if op == _BLOCK:
                alignment = steps[step, _ALIGNMENT]
                at = (at + alignment - 1) & -alignment
                if steps[step, _SIZE] > size - at:
                    fault = _ENDS
                    break
                if mark >= 0:
                    marks[bases[mark] + filled[node]] = begin + at
                at += steps[step, _SIZE]
            elif op == _NEXT:
                if node >= 0:
                    filled[node] += 1
                left[depth - 1] -= 1
                if left[depth - 1] > 0:
                    step = steps[step, _JUMP]
                    continue
                depth -= 1
            else:
                # all others begin with a length
                length = steps[step, _LENGTH]
                if length < 0:
                    at = (at + counted - 1) & -counted
                    if size - at < 4:
                        fault = _ENDS
                        break
                    length = _number(data, begin + at, swap)
                    at += 4
                if op == _TEXT:
                    if length > size - at:
                        fault = _LONG_TEXT
                        break
                    start = begin + at
                    at += length
                    if cdr and length > 0:
                        length -= 1
                        if data[start + length] != 0:
                            fault = _NO_NUL
                            break
                    if not _is_utf8(data, start, start + length):
                        fault = _NO_UTF8
                        break
                    if mark >= 0:
                        marks[bases[mark] + filled[node]] = start
                        marks[bases[mark + 1] + filled[node]] = length
                elif op == _STRIDED:
                    span = 0
                    if length > 0:
                        alignment = steps[step, _ALIGNMENT]
                        at = (at + alignment - 1) & -alignment
                        # the first comparison keeps the product from overflowing
                        if length > size - at:
                            fault = _LONG_LIST
                            break
                        span = (length - 1) * steps[step, _STRIDE] + steps[step, _SIZE]
                    if span > size - at:
                        fault = _LONG_LIST
                        break
                    if mark >= 0:
                        marks[bases[mark] + filled[node]] = begin + at
                        marks[bases[mark + 1] + filled[node]] = length
                    at += span
                else:
                    if length > size - at or length * steps[step, _SIZE] > size - at:
                        fault = _LONG_LIST
                        break
                    if mark >= 0:
                        marks[bases[mark] + filled[node]] = length
                    if length == 0:
                        step = steps[step, _JUMP]
                        continue
                    left[depth] = length
                    depth += 1
            step += 1
        if fault == 0 and size - at > (3 if cdr else 0):
            fault = _GOES_ON
        faults[message] = fault
        places[message] = at
        if fault == 0:
            filled[0] += 1
        else:
            for node in range(filled.size):
                filled[node] = kept[node]


@njit(cache=True, nogil=True)
def _number(data: NDArray[np.uint8], at: int, swap: bool) -> np.int64:
    a, b = np.int64(data[at]), np.int64(data[at + 1])
    c, d = np.int64(data[at + 2]), np.int64(data[at + 3])
    if swap:
        return a << 24 | b << 16 | c << 8 | d
    return d << 24 | c << 16 | b << 8 | a


@njit(cache=True, nogil=True)
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
