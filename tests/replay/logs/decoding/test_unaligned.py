"""Numbers at any byte, in compiled code."""

import math
import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import TypingError, njit

from replay.logs.decoding.unaligned import copy, fetch, load16, load32, load64, widened


@njit
def _loaded(data: Any, at: int) -> tuple[int, int, int]:
    return load16(data, at), load32(data, at), load64(data, at)


@njit
def _copied(data: Any, at: int, target: Any, to: int, size: int) -> None:
    fetch(data, at)
    copy(data, at, target, to, size)


@njit
def _as_double_bits(bits: int) -> int:
    return widened(bits)


_BYTES = st.binary(min_size=8, max_size=40)


@settings(deadline=None)  # the first compiles
@given(_BYTES, st.data())
def test_a_number_is_what_its_bytes_say_at_any_of_them(data: bytes, draw: st.DataObject) -> None:
    at = draw.draw(st.integers(0, len(data) - 8))
    assert _loaded(np.frombuffer(data, np.uint8), at) == (
        int.from_bytes(data[at : at + 2], "little"),
        int.from_bytes(data[at : at + 4], "little"),
        int.from_bytes(data[at : at + 8], "little", signed=True),
    )


@settings(deadline=None)  # the first compiles
@given(_BYTES, _BYTES, st.data())
def test_a_copy_touches_nothing_else(data: bytes, target: bytes, draw: st.DataObject) -> None:
    size = draw.draw(st.integers(0, min(len(data), len(target))))
    at = draw.draw(st.integers(0, len(data) - size))
    to = draw.draw(st.integers(0, len(target) - size))
    out = np.array(bytearray(target))
    _copied(np.frombuffer(data, np.uint8), at, out, to, size)
    assert out.tobytes() == target[:to] + data[at : at + size] + target[to + size :]


@pytest.mark.parametrize(
    "data", [np.zeros(40, np.uint8)[::2], np.zeros((8, 8), np.uint8).T, np.zeros(8, np.uint64)]
)
def test_what_are_no_bytes_that_follow_one_another_is_refused(data: Any) -> None:
    with pytest.raises(TypingError):
        _loaded(data, 0)
    with pytest.raises(TypingError):
        _copied(np.zeros(8, np.uint8), 0, data, 0, 8)


@settings(deadline=None)  # the first compiles
@given(st.floats(width=32))
def test_single_precision_becomes_the_double_that_equals_it(value: float) -> None:
    (bits,) = struct.unpack("<I", struct.pack("<f", value))
    (double,) = struct.unpack("<d", struct.pack("<q", _as_double_bits(bits)))
    assert double == value or (math.isnan(double) and math.isnan(value))
