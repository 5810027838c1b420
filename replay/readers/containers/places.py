"""Where connections stand among several, compiled."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

Ints = NDArray[np.int64]


def places_of(found: Ints, keys: Ints) -> Ints:
    """The place of each of `found` (n,) in `keys`, which ascend; -1 for one not among them."""
    places = np.empty(found.size, np.int64)
    _search(found, keys, places)
    return places


@njit(cache=True, nogil=True)
def _search(found: Ints, keys: Ints, places: Ints) -> None:
    first = keys[0] if keys.size else 0
    for row in range(found.size):
        key = found[row]
        # recorders number connections one after another
        near = key - first
        if 0 <= near < keys.size and keys[near] == key:
            places[row] = near
            continue
        low, high = 0, keys.size
        while low < high:
            middle = (low + high) // 2
            if keys[middle] < key:
                low = middle + 1
            else:
                high = middle
        places[row] = low if low < keys.size and keys[low] == key else -1
