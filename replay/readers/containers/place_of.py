"""Where a connection stands among several, compiled."""

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True, nogil=True)
def place_of(key: int, keys: NDArray[np.int64]) -> int:
    """The place of `key` in `keys` (n,), which ascend; -1 where it is not among them."""
    if not keys.size:
        return -1
    # recorders number connections one after another
    place = key - keys[0]
    if not 0 <= place < keys.size or keys[place] != key:
        place = int(np.searchsorted(keys, key))
    return place if place < keys.size and keys[place] == key else -1
