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


@njit(cache=True, nogil=True)
def _pick(view: NDArray[Any], positions: Ints, offset: int, out: NDArray[Any]) -> None:
    for k in range(positions.size):
        # no conditional expression: numba would give it a float's type
        if positions[k] < 0:
            out[k] = 0
        else:
            out[k] = view[positions[k] + offset]


@njit(cache=True, nogil=True)
def _copy(
    data: Bytes,
    words: NDArray[np.uint64],
    starts: Ints,
    sizes: Ints,
    out: Bytes,
    out_words: NDArray[np.uint64],
) -> None:
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


def numbers(data: Bytes, positions: Ints, offset: int, kind: str, *, swap: bool) -> NDArray[Any]:
    """Numbers of one kind, in its own dtype, at `positions + offset`."""
    dtype = DTYPES[kind]
    out = np.empty(positions.size, f"u{dtype.itemsize}")
    _pick(_overlapping(data, out.dtype), positions, offset, out)
    return _typed(out, kind, swap=swap)


def stamps(data: Bytes, positions: Ints, offset: int, *, swap: bool) -> Ints:
    """Times or durations in ns."""
    seconds = numbers(data, positions, offset, "int32", swap=swap).astype(np.int64)
    return seconds * 10**9 + numbers(data, positions, offset + 4, "uint32", swap=swap)


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
    return _typed(bits, kind, swap=swap)


def _typed(bits: NDArray[Any], kind: str, *, swap: bool) -> NDArray[Any]:
    values = (bits.byteswap() if swap else bits).view(DTYPES[kind])
    return values != 0 if kind == "bool" else values


def _overlapping(data: Bytes, dtype: np.dtype[Any]) -> NDArray[Any]:
    """The number at every byte, not only at every multiple of its size."""
    count = max(data.size - dtype.itemsize + 1, 0)
    return np.ndarray((count,), dtype, data, 0, (1,))
