"""Gather values at positions that the walk found, one pass per column.

The loops are compiled by numba and cached on disk. A position of -1 stands for a missing value, and
gives 0.
"""

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Bytes, Ints
from estimators.interpreted import compiled
from replay.logs.decoding.bytes_at import copy, load16, load32, load64, widened

#: Little-endian data type of each kind; a bool is a byte until it is compared with 0.
DTYPES: Final = {
    "bool": np.dtype("u1"),
    "byte": np.dtype("i1"),
    "char": np.dtype("u1"),
    **{f"int{8 * size}": np.dtype(f"<i{size}") for size in (1, 2, 4, 8)},
    **{f"uint{8 * size}": np.dtype(f"<u{size}") for size in (1, 2, 4, 8)},
    "float32": np.dtype("<f4"),
    "float64": np.dtype("<f8"),
}
#: Code of the conversion of each kind to 64 bits: its size in bytes, negative if it is signed.
_FLOAT32, _STAMP = 5, 6
LOADS: Final = {
    **{kind: -d.itemsize if d.kind == "i" else d.itemsize for kind, d in DTYPES.items()},
    "float32": _FLOAT32,
    "stamp": _STAMP,
}
#: Bytes up to which an Arrow view contains the string itself.
_INLINE: Final = 12


@compiled
def load_64_bit_patterns(
    data: Bytes, positions: Ints, offset: int, conversion_code: int, swap: bool, out: Ints
) -> None:
    """Load 64-bit patterns of the values of a column: floats as doubles, stamps in ns.

    Args:
        data: (bytes,) bytes that contain the values.
        positions: (n,) base positions.
        offset: offset from the base positions.
        conversion_code: type of the values, see `LOADS`.
        swap: whether they are big-endian.
        out: (n,) output.
    """
    size = abs(conversion_code)
    if size == 8:
        _load_8_byte_values(data, positions, offset, swap, out)
        return
    for k in range(positions.size):
        at = positions[k]
        if at < 0:
            out[k] = 0
            continue
        at += offset
        if conversion_code == _STAMP:
            seconds = _swap_4_bytes(load32(data, at)) if swap else load32(data, at)
            rest = _swap_4_bytes(load32(data, at + 4)) if swap else load32(data, at + 4)
            out[k] = _sign_extend(seconds, 32) * np.int64(10**9) + rest
        elif conversion_code == _FLOAT32:
            out[k] = widened(_swap_4_bytes(load32(data, at)) if swap else load32(data, at))
        else:
            if size == 4:
                value = _swap_4_bytes(load32(data, at)) if swap else load32(data, at)
            elif size == 2:
                value = load16(data, at)
                if swap:
                    value = (value & 0xFF) << 8 | value >> 8
            else:
                value = int(data[at])
            out[k] = _sign_extend(value, 8 * size) if conversion_code < 0 else value


@compiled
def _load_8_byte_values(data: Bytes, positions: Ints, offset: int, swap: bool, out: Ints) -> None:
    """Load 8-byte values, the common case, in a loop without branches."""
    for k in range(positions.size):
        at = positions[k]
        if at < 0:
            out[k] = 0
        else:
            eight = load64(data, at + offset)
            out[k] = _swap_8_bytes(eight) if swap else eight


@compiled
def _sign_extend(value: int, bits: int) -> int:
    return int(np.int64(value) << 64 - bits >> 64 - bits)


@compiled
def _swap_4_bytes(value: int) -> int:
    return (value & 0xFF) << 24 | (value & 0xFF00) << 8 | value >> 8 & 0xFF00 | value >> 24 & 0xFF


@compiled
def _swap_8_bytes(value: int) -> int:
    return _swap_4_bytes(value) << 32 | _swap_4_bytes(value >> 32)


@compiled
def copy_ranges_of_equal_size(
    data: Bytes, positions: Ints, offset: int, size: int, out: Bytes
) -> None:
    """Copy byte ranges of equal size, one after the other.

    Args:
        data: (bytes,) source bytes.
        positions: (n,) base positions.
        offset: offset from the base positions.
        size: bytes per range.
        out: (n size,) output.
    """
    for k in range(positions.size):
        copy(data, positions[k] + offset, out, k * size, size)


@compiled
def fill_string_views(
    data: Bytes,
    starts: Ints,
    sizes: Ints,
    out: NDArray[np.uint32],
    characters: Bytes,
    text: Bytes,
) -> int:
    """Write strings as Arrow views (n, 4): the size, then the text or its position.

    Args:
        data: (bytes,) bytes that contain the strings.
        starts: (n,) start of each string.
        sizes: (n,) bytes of each string.
        out: (n, 4) output.
        characters: (n, 16) the bytes of `out`.
        text: output for strings too long for their view; what does not fit is dropped.

    Returns:
        Bytes of `text` needed.
    """
    to = 0
    for k in range(starts.size):
        at, size = starts[k], sizes[k]
        out[k, 0] = size
        out[k, 1] = 0
        out[k, 2] = 0
        out[k, 3] = 0
        for byte in range(min(size, np.int64(_INLINE))):
            characters[k, 4 + byte] = data[at + byte]
        if size <= _INLINE:
            continue
        out[k, 2] = 0
        out[k, 3] = to
        if to + size <= text.size:
            copy(data, at, text, to, size)
        to += size
    return to


@compiled
def _copy_byte_ranges(data: Bytes, starts: Ints, sizes: Ints, out: Bytes) -> None:
    to = 0
    for k in range(starts.size):
        copy(data, starts[k], out, to, sizes[k])
        to += sizes[k]


@compiled
def _fill_name_index_in_each_list(
    data: Bytes, starts: Ints, sizes: Ints, counts: Ints, name: Bytes, out_indices: Ints
) -> None:
    first = 0
    for row in range(counts.size):
        out_indices[row] = -1
        for k in range(counts[row]):
            at = starts[first + k]
            same = sizes[first + k] == name.size
            byte = 0
            while same and byte < name.size:
                same = data[at + byte] == name[byte]
                byte += 1
            if same:
                out_indices[row] = k
                break
        first += counts[row]


def find_name_index_in_each_list(
    data: Bytes, starts: Ints, sizes: Ints, counts: Ints, name: str
) -> Ints:
    """Find the first index of a name in each list of strings; -1 if absent.

    Args:
        data: bytes that contain the strings.
        starts: (strings,) start of each string; lists are consecutive.
        sizes: (strings,) bytes of each string.
        counts: (lists,) number of strings in each list.
        name: name to find.
    """
    found = np.empty(counts.size, np.int64)
    # a copy, since numba would compile another version for a read-only array
    encoded = np.array(bytearray(name.encode()))
    _fill_name_index_in_each_list(data, starts, sizes, counts, encoded, found)
    return found


def gather_64_bit_patterns(
    data: Bytes, positions: Ints, offset: int, value_type: str, *, swap: bool
) -> Ints:
    """Gather 64-bit patterns (n,) of values of one type: integers, bits of doubles, stamps in ns.

    Args:
        data: (bytes,) bytes that contain the values.
        positions: (n,) base positions.
        offset: offset from the base positions.
        value_type: type of the values, see `LOADS`.
        swap: whether they are big-endian.
    """
    out = np.empty(positions.size, np.int64)
    load_64_bit_patterns(data, positions, offset, LOADS[value_type], swap, out)
    return out


class StringViews(NamedTuple):
    """Strings as Arrow views (n, 4), and the text of the long ones."""

    views: NDArray[np.uint32]
    long_text: Bytes


def gather_string_views(data: Bytes, starts: Ints, sizes_bytes: Ints) -> StringViews:
    """Gather strings as Arrow views (n, 4), and the text of those too long for their view."""
    out = np.empty((starts.size, 4), np.uint32)
    text = np.empty(int(sizes_bytes[sizes_bytes > _INLINE].sum()), np.uint8)
    fill_string_views(data, starts, sizes_bytes, out, out.view(np.uint8), text)
    return StringViews(out, text)


def concatenate_byte_ranges(data: Bytes, starts: Ints, sizes_bytes: Ints) -> Bytes:
    """Concatenate byte ranges with the given starts and sizes."""
    out = np.empty(int(sizes_bytes.sum()), np.uint8)
    _copy_byte_ranges(data, starts, sizes_bytes, out)
    return out


def convert_bytes_to_numbers(stored_bytes: Bytes, number_type: str, *, swap: bool) -> NDArray[Any]:
    """Reinterpret bytes as numbers of one type."""
    dtype = DTYPES[number_type]
    bits = stored_bytes.view(f"u{dtype.itemsize}")
    return (bits.byteswap() if swap else bits).view(dtype)
