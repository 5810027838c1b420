"""Values from where the walk found them. One pass a column keeps the writes sequential.

The loops are compiled by numba and cached on disk. A position of -1 is a value that is not there;
it gives 0.
"""

from typing import Any, Final, NamedTuple

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


class Source(NamedTuple):
    """Bytes, and the numbers of 2, 4 and 8 bytes at every one of them."""

    data: Bytes
    short: NDArray[np.uint16]
    word: NDArray[np.uint32]
    long: Words


def source_of(data: Bytes) -> Source:
    """Bytes to gather from."""
    return Source(data, *(_overlapping(data, f"u{size}") for size in (2, 4, 8)))


def _overlapping(data: Bytes, kind: str) -> NDArray[Any]:
    """The number at every byte, not only at every multiple of its size."""
    dtype = np.dtype(kind)
    count = max(data.size - dtype.itemsize + 1, 0)
    return np.ndarray((count,), dtype, data, 0, (1,))


@njit(cache=True, nogil=True)
def load(
    source: Source,
    positions: Ints,
    offset: int,
    how: int,
    swap: bool,
    out: Words,
    floats: NDArray[np.float64],
) -> None:
    """Values of a column as 64 bits each: floats as double, stamps in ns.

    Args:
        source: where they lie.
        positions: (n,) what they lie behind.
        offset: how far behind.
        how: what they are, see `LOADS`.
        swap: whether they are big-endian.
        out: (n,) out.
        floats: the same memory as doubles.
    """
    data, short, word, long = source
    size = abs(how)
    if size == 8:  # nearly all of them, in a loop with no other case in it
        for k in range(positions.size):
            at = positions[k]
            if at < 0:
                out[k] = 0
            else:
                eight = long[at + offset]
                out[k] = _swapped8(eight) if swap else eight
        return
    bits = np.empty(1, np.uint32)
    single = bits.view(np.float32)
    for k in range(positions.size):
        at = positions[k]
        if at < 0:
            out[k] = 0
            continue
        at += offset
        if how == _STAMP:
            seconds = _swapped4(word[at]) if swap else np.uint64(word[at])
            rest = _swapped4(word[at + 4]) if swap else np.uint64(word[at + 4])
            out[k] = _signed(seconds, 32) * np.int64(10**9) + np.int64(rest)
        elif how == _FLOAT32:
            bits[0] = _swapped4(word[at]) if swap else np.uint64(word[at])
            floats[k] = single[0]
        else:
            if size == 4:
                value = _swapped4(word[at]) if swap else np.uint64(word[at])
            elif size == 2:
                value = np.uint64(short[at])
                if swap:
                    value = (value & np.uint64(0xFF)) << np.uint64(8) | value >> np.uint64(8)
            else:
                value = np.uint64(data[at])
            out[k] = _signed(value, 8 * size) if how < 0 else np.int64(value)


@njit(cache=True, nogil=True)
def _signed(value: np.uint64, bits: int) -> np.int64:
    gap = np.int64(64 - bits)
    return np.int64(value) << gap >> gap


@njit(cache=True, nogil=True)
def _swapped4(value: Any) -> np.uint64:
    low = np.uint64(value)
    byte = np.uint64(0xFF)
    return (
        (low & byte) << np.uint64(24)
        | (low >> np.uint64(8) & byte) << np.uint64(16)
        | (low >> np.uint64(16) & byte) << np.uint64(8)
        | low >> np.uint64(24)
    )


@njit(cache=True, nogil=True)
def _swapped8(value: Any) -> np.uint64:
    low = value & np.uint64(0xFFFFFFFF)
    return _swapped4(low) << np.uint64(32) | _swapped4(value >> np.uint64(32))


@njit(cache=True, nogil=True)
def copy_equal(
    source: Source, positions: Ints, offset: int, size: int, out: Bytes, words: Words, to: int
) -> None:
    """Copy runs of one size, `offset` bytes behind positions (n,).

    Args:
        source: where they lie.
        positions: (n,) what they lie behind.
        offset: how far behind.
        size: bytes of each.
        out: takes them, one behind the other.
        words: the 64 bits at every byte of it.
        to: where in it.
    """
    data, long = source.data, source.long
    for k in range(positions.size):
        at = positions[k] + offset
        end = to + size
        while to + 8 <= end:
            words[to] = long[at]
            to += 8
            at += 8
        while to < end:
            out[to] = data[at]
            to += 1
            at += 1


@njit(cache=True, nogil=True)
def view(source: Source, starts: Ints, sizes: Ints, out: NDArray[np.uint32], text: Bytes) -> int:
    """Strings as Arrow's views of them (n, 4): size, then all of it, or else where the text is.

    Args:
        source: where they lie.
        starts: (n,) where each begins.
        sizes: (n,) bytes of each.
        out: (n, 4) out.
        text: out, those that do not fit into their views, as far as there is room.

    Returns:
        The bytes of `text` that they need.
    """
    data = source.data
    lanes = np.empty(3, np.uint32)
    characters = lanes.view(np.uint8)
    to = 0
    for k in range(starts.size):
        at, size = starts[k], sizes[k]
        lanes[:] = 0
        for byte in range(min(size, np.int64(_INLINE))):
            characters[byte] = data[at + byte]
        out[k, 0] = size
        out[k, 1] = lanes[0]
        if size <= _INLINE:
            out[k, 2] = lanes[1]
            out[k, 3] = lanes[2]
            continue
        out[k, 2] = 0
        out[k, 3] = to
        if to + size <= text.size:
            for byte in range(size):
                text[to + byte] = data[at + byte]
        to += size
    return to


@njit(cache=True, nogil=True)
def _copy(source: Source, starts: Ints, sizes: Ints, out: Bytes, words: Words) -> None:
    data, long = source.data, source.long
    to = 0
    for k in range(starts.size):
        at = starts[k]
        end = to + sizes[k]
        while to + 8 <= end:
            words[to] = long[at]
            to += 8
            at += 8
        while to < end:
            out[to] = data[at]
            to += 1
            at += 1


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


def values(source: Source, positions: Ints, offset: int, kind: str, *, swap: bool) -> Words:
    """Values of one kind, 64 bits each, at `positions + offset`."""
    out = np.empty(positions.size, np.uint64)
    load(source, positions, offset, LOADS[kind], swap, out, out.view(np.float64))
    return out


def views(source: Source, starts: Ints, sizes: Ints) -> tuple[NDArray[np.uint32], Bytes]:
    """Strings as Arrow's views (n, 4), with the text of those that do not fit into theirs."""
    out = np.empty((starts.size, 4), np.uint32)
    text = np.empty(int(sizes[sizes > _INLINE].sum()), np.uint8)
    view(source, starts, sizes, out, text)
    return out, text


def runs(source: Source, starts: Ints, sizes: Ints) -> Bytes:
    """Runs of bytes, one behind the other."""
    out = np.empty(int(sizes.sum()), np.uint8)
    _copy(source, starts, sizes, out, words_of(out))
    return out


def words_of(out: Bytes) -> Words:
    """The 64 bits at every byte."""
    return _overlapping(out, "u8")


def numbers(run: Bytes, kind: str, *, swap: bool) -> NDArray[Any]:
    """Numbers of one kind, from their bytes."""
    dtype = DTYPES[kind]
    bits = run.view(f"u{dtype.itemsize}")
    return (bits.byteswap() if swap else bits).view(dtype)
