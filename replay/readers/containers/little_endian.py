"""Numbers in bytes, for compiled code."""

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True, nogil=True)
def little_endian(data: NDArray[np.uint8], at: int, size: int) -> int:
    """An unsigned integer of at most 8 bytes; the highest bit of the 8th becomes the sign."""
    value = np.int64(0)
    for k in range(size):
        value |= np.int64(data[at + k]) << np.int64(8 * k)
    return value  # pyright: ignore[reportReturnType] an int outside of numba
