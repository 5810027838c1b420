"""Make Arrow arrays of gathered values, without copying them."""

from typing import Any, Final, TypeAlias

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from estimators.arrays import Ints

#: pyarrow ships no types.
Array: TypeAlias = Any
Flags = NDArray[np.bool_]

_INT64: Final[Any] = pa.int64()
#: Arrow type of 64 gathered bits, by kind; other kinds are signed integers.
_TYPES: Final[dict[str, Any]] = {
    "float32": pa.float64(),
    "float64": pa.float64(),
    "uint64": pa.uint64(),
}
#: Arrow type of list elements, which keep their size, by kind.
ELEMENT_TYPES: Final[dict[str, Any]] = {
    "byte": pa.int8(),
    "char": pa.uint8(),
    **{f"int{size}": getattr(pa, f"int{size}")() for size in (8, 16, 32, 64)},
    **{f"uint{size}": getattr(pa, f"uint{size}")() for size in (8, 16, 32, 64)},
    "float32": pa.float32(),
    "float64": pa.float64(),
    "stamp": _INT64,
}


def make_value_array(bits: Ints, value_type: str, is_absent: Flags | None = None) -> Array:
    """Make an array of values (n,) from their 64-bit patterns; null where absent."""
    if value_type == "bool":
        return pa.array(bits != 0, mask=is_absent)
    validity = _make_validity_bitmap(is_absent)
    return pa.Array.from_buffers(
        _TYPES.get(value_type, _INT64), bits.size, [validity, pa.py_buffer(bits)]
    )


def make_element_array(numbers: NDArray[Any], element_type: str) -> Array:
    """Make an array of list elements (n,), in their original size."""
    if element_type == "bool":
        return pa.array(numbers != 0)
    return pa.Array.from_buffers(
        ELEMENT_TYPES[element_type], numbers.size, [None, pa.py_buffer(numbers)]
    )


def make_time_array(times_ns: Ints) -> Array:
    """Make an array of times (n,) in ns."""
    return pa.Array.from_buffers(_INT64, times_ns.size, [None, pa.py_buffer(times_ns)])


def make_string_array(
    views: NDArray[np.uint32], long_text: NDArray[np.uint8], is_absent: Flags | None = None
) -> Array:
    """Make an array of strings (n,) from their views (n, 4) and the text of long ones."""
    buffers = [
        _make_validity_bitmap(is_absent),
        pa.py_buffer(views),
        *([pa.py_buffer(long_text)] if long_text.size else []),
    ]
    return pa.Array.from_buffers(pa.string_view(), len(views), buffers)


def make_list_array(counts: Ints, elements: Array) -> Array:
    """Make an array of lists (n,) with the given numbers of elements; -1 stands for null."""
    ends = np.zeros(counts.size + 1, np.int64)
    absent = counts < 0
    np.cumsum(np.maximum(counts, 0), out=ends[1:])
    return pa.Array.from_buffers(
        pa.large_list(elements.type),
        counts.size,
        [_make_validity_bitmap(absent), pa.py_buffer(ends)],
        children=[elements],
    )


def _make_validity_bitmap(is_absent: Flags | None) -> Any:
    if is_absent is None or not is_absent.any():
        return None
    return pa.py_buffer(np.packbits(~is_absent, bitorder="little"))
