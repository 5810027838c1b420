"""Load numbers at any byte of an array, in loops that may be interpreted or compiled.

In compiled loops, these functions are those of `unaligned`.
"""

from collections.abc import Callable
from typing import Any, Final, cast

import numpy as np

from estimators.arrays import Bytes
from estimators.interpreted import Primitive


def _make_unsigned_integer_loader(size_bytes: int) -> Callable[[Bytes, int], np.int64]:
    def load_unsigned(data: Bytes, at: int) -> np.int64:
        return np.int64(int.from_bytes(data[at : at + size_bytes].tobytes(), "little"))

    return load_unsigned


def _load_64_bits(data: Bytes, offset: int) -> np.int64:
    return np.int64(int.from_bytes(data[offset : offset + 8].tobytes(), "little", signed=True))


def _copy_bytes(data: Bytes, offset: int, target: Bytes, target_offset: int, size: int) -> None:
    target[target_offset : target_offset + size] = data[offset : offset + size]


def _convert_float_bits_to_double_bits(float_bits: int) -> np.int64:
    """Convert the bits of a 32-bit float to the bits of the equal 64-bit float."""
    single = np.array(int(float_bits) & 0xFFFFFFFF, np.uint32).view(np.float32)
    return np.int64(single.astype(np.float64).view(np.int64))


def _skip_prefetch(data: Bytes, offset: int) -> None:
    pass


#: Typical bytes of a record of a log: an iteration of a loop over records.
_RECORD_BYTES: Final = 256


def estimate_scan_iterations(_data: Bytes, start: int, end: int, *__: Any) -> int:
    """Estimate the iterations of a loop over the records from byte `start` to byte `end`."""
    return (end - start) // _RECORD_BYTES


def _make_compiled_primitive(name: str, interpreted: Callable[..., Any]) -> Any:
    def import_compiled() -> Any:
        from replay.logs.decoding import unaligned  # imports numba, which is slow

        return getattr(unaligned, name)

    return Primitive(interpreted, import_compiled)


#: (data, at) -> unsigned integer of 2 and of 4 little-endian bytes, and signed integer of 8
load16 = cast(
    "Callable[[Bytes, int], int]",
    _make_compiled_primitive("load16", _make_unsigned_integer_loader(2)),
)
load32 = cast(
    "Callable[[Bytes, int], int]",
    _make_compiled_primitive("load32", _make_unsigned_integer_loader(4)),
)
load64 = cast("Callable[[Bytes, int], int]", _make_compiled_primitive("load64", _load_64_bits))
#: (data, at, target, to, size): copy `size` bytes
copy = cast(
    "Callable[[Bytes, int, Bytes, int, int], None]", _make_compiled_primitive("copy", _copy_bytes)
)
#: (bits of a 32-bit float) -> bits of the equal 64-bit float
widened = cast(
    "Callable[[int], int]", _make_compiled_primitive("widened", _convert_float_bits_to_double_bits)
)
#: (data, at): prefetch that byte into the processor's cache
fetch = cast("Callable[[Bytes, int], None]", _make_compiled_primitive("fetch", _skip_prefetch))
