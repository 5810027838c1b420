"""Values from where the walk found them. One pass a column keeps the writes sequential.

The loops are compiled by numba and cached on disk. A position of -1 is a value that is not there;
it gives 0.
"""

from typing import Any, Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]
Words = NDArray[np.uint64]

#: Little-endian numbers of the kinds; a bool is a byte until it is compared with 0.
DTYPES: Final = {
    "bool": np.dtype("u1"),
    "byte": np.dtype("i1"),
    "char": np.dtype("u1"),
    **{f"int{8 * size}": np.dtype(f"<i{size}") for size in (1, 2, 4, 8)},
    **{f"uint{8 * size}": np.dtype(f"<u{size}") for size in (1, 2, 4, 8)},
    "float32": np.dtype("<f4"),
    "float64": np.dtype("<f8"),
}
#: How a value of each kind becomes 64 bits: by its size in bytes, a negative one with its sign.
_FLOAT32, _STAMP = 5, 6
LOADS: Final = {
    **{kind: -d.itemsize if d.kind == "i" else d.itemsize for kind, d in DTYPES.items()},
    "float32": _FLOAT32,
    "stamp": _STAMP,
}
#: Strings up to here lie in Arrow's view of them.
_INLINE: Final = 12


@njit(cache=True, nogil=True)
def load_values(
    data: Bytes,
    overlapping: tuple[NDArray[np.uint16], NDArray[np.uint32], Words],
    marks: Ints,
    bases: Ints,
    offsets: Ints,
    loads: Ints,
    swap: bool,
    out: Words,
    floats: NDArray[np.float64],
) -> None:
    """Values of several columns as 64 bits each: floats as double, stamps in ns.

    Args:
        data: (bytes,) where they lie.
        overlapping: the numbers of 2, 4 and 8 bytes at every byte of `data`.
        marks: positions, those of all columns.
        bases: (columns,) where the positions of each column begin in `marks`.
        offsets: (columns,) how far behind its positions a column's values lie.
        loads: (columns,) what they are, see `LOADS`.
        swap: whether they are big-endian.
        out: (columns, n) out.
        floats: the same memory as doubles.
    """
    short, word, long = overlapping
    bits = np.empty(1, np.uint32)
    single = bits.view(np.float32)
    for column in range(bases.size):
        base, offset, load = bases[column], offsets[column], loads[column]
        size = abs(load)
        if size == 8:  # nearly all of them, in a loop with no other case in it
            for k in range(out.shape[1]):
                at = marks[base + k]
                if at < 0:
                    out[column, k] = 0
                else:
                    eight = long[at + offset]
                    out[column, k] = _swapped8(eight) if swap else eight
            continue
        for k in range(out.shape[1]):
            at = marks[base + k]
            if at < 0:
                out[column, k] = 0
                continue
            at += offset
            if load == _STAMP:
                seconds = _swapped4(word[at]) if swap else np.uint64(word[at])
                rest = _swapped4(word[at + 4]) if swap else np.uint64(word[at + 4])
                out[column, k] = _signed(seconds, 32) * np.int64(10**9) + np.int64(rest)
            elif load == _FLOAT32:
                bits[0] = _swapped4(word[at]) if swap else np.uint64(word[at])
                floats[column, k] = single[0]
            else:
                if size == 4:
                    value = _swapped4(word[at]) if swap else np.uint64(word[at])
                elif size == 2:
                    value = np.uint64(short[at])
                    if swap:
                        value = (value & np.uint64(0xFF)) << np.uint64(8) | value >> np.uint64(8)
                else:
                    value = np.uint64(data[at])
                out[column, k] = _signed(value, 8 * size) if load < 0 else np.int64(value)


@njit(cache=True, nogil=True)
def _signed(value: np.uint64, bits: int) -> np.int64:
    gap = np.int64(64 - bits)
    return np.int64(value) << gap >> gap


@njit(cache=True, nogil=True)
def _swapped4(value: np.uint32) -> np.uint64:
    low = np.uint64(value)
    byte = np.uint64(0xFF)
    return (
        (low & byte) << np.uint64(24)
        | (low >> np.uint64(8) & byte) << np.uint64(16)
        | (low >> np.uint64(16) & byte) << np.uint64(8)
        | low >> np.uint64(24)
    )


@njit(cache=True, nogil=True)
def _swapped8(value: np.uint64) -> np.uint64:
    low = value & np.uint64(0xFFFFFFFF)
    return _swapped4(low) << np.uint64(32) | _swapped4(value >> np.uint64(32))


@njit(cache=True, nogil=True)
def _copy(data: Bytes, words: Words, starts: Ints, sizes: Ints, out: Bytes, out_words: Words) -> None:
    to = 0
    for k in range(starts.size):
        at = starts[k]
        end = to + sizes[k]
        while to + 8 <= end:
            out_words[to] = words[at]
            to += 8
            at += 8
        while to < end:
            out[to] = data[at]
            to += 1
            at += 1


@njit(cache=True, nogil=True)
def _view(data: Bytes, starts: Ints, sizes: Ints, out: NDArray[np.uint32], text: Bytes) -> None:
    lanes = np.empty(3, np.uint32)
    bytes_of = lanes.view(np.uint8)
    to = 0
    for k in range(starts.size):
        at, size = starts[k], sizes[k]
        shown = min(size, np.int64(_INLINE))
        lanes[:] = 0
        for byte in range(shown):
            bytes_of[byte] = data[at + byte]
        out[k, 0] = size
        out[k, 1] = lanes[0]
        if size <= _INLINE:
            out[k, 2] = lanes[1]
            out[k, 3] = lanes[2]
        else:
            out[k, 2] = 0
            out[k, 3] = to
            for byte in range(size):
                text[to + byte] = data[at + byte]
            to += size


@njit(cache=True, nogil=True)
def _find(data: Bytes, starts: Ints, sizes: Ints, counts: Ints, name: Bytes, found: Ints) -> None:
    first = 0
    for row in range(counts.size):
        found[row] = -1
        for k in range(counts[row]):
            at = starts[first + k]
            same = sizes[first + k] == name.size
            byte = 0
            while same and byte < name.size:
                same = data[at + byte] == name[byte]
                byte += 1
            if same:
                found[row] = k
                break
        first += counts[row]


def find(data: Bytes, starts: Ints, sizes: Ints, counts: Ints, name: str) -> Ints:
    """Where in each list of strings a name comes first, -1 where it does not.

    Args:
        data: what the strings lie in.
        starts: (strings,) where each begins; the lists' strings follow one another.
        sizes: (strings,) bytes of each.
        counts: (lists,) strings of each list.
        name: what is looked for.
    """
    found = np.empty(counts.size, np.int64)
    # a copy, since numba would compile anew for an array that cannot be written
    encoded = np.array(bytearray(name.encode()))
    _find(data, starts, sizes, counts, encoded, found)
    return found


def values(
    data: Bytes, marks: Ints, bases: Ints, offsets: Ints, loads: Ints, rows: int, *, swap: bool
) -> Words:
    """Values of several columns, (columns, rows) of 64 bits; see `load_values`."""
    out = np.empty((bases.size, rows), np.uint64)
    views = (
        _overlapping(data, np.dtype(np.uint16)),
        _overlapping(data, np.dtype(np.uint32)),
        _overlapping(data, np.dtype(np.uint64)),
    )
    load_values(data, views, marks, bases, offsets, loads, swap, out, out.view(np.float64))
    return out


def views(data: Bytes, starts: Ints, sizes: Ints) -> tuple[NDArray[np.uint32], Bytes]:
    """Strings as Arrow's views (n, 4), with the text of those that do not fit into theirs."""
    out = np.empty((starts.size, 4), np.uint32)
    text = np.empty(int(sizes[sizes > _INLINE].sum()), np.uint8)
    _view(data, starts, sizes, out, text)
    return out, text


def runs(data: Bytes, starts: Ints, sizes: Ints) -> Bytes:
    """Runs of bytes, one behind the other."""
    out = np.empty(int(sizes.sum()), np.uint8)
    word = np.dtype(np.uint64)
    _copy(data, _overlapping(data, word), starts, sizes, out, _overlapping(out, word))
    return out


def number_runs(data: Bytes, starts: Ints, counts: Ints, kind: str, *, swap: bool) -> NDArray[Any]:
    """Runs of numbers of one kind, one run behind the other."""
    dtype = DTYPES[kind]
    bits = runs(data, starts, counts * dtype.itemsize).view(f"u{dtype.itemsize}")
    return (bits.byteswap() if swap else bits).view(dtype)


def _overlapping(data: Bytes, dtype: np.dtype[Any]) -> NDArray[Any]:
    """The number at every byte, not only at every multiple of its size."""
    count = max(data.size - dtype.itemsize + 1, 0)
    return np.ndarray((count,), dtype, data, 0, (1,))
