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
        low, high = 0, keys.size
        # recorders number connections one after another
        middle = min(max(key - first, 0), high - 1)
        while low < high:
            if keys[middle] < key:
                low = middle + 1
            elif keys[middle] > key:
                high = middle
            else:
                low = high = middle
            middle = (low + high) // 2
        places[row] = low if low < keys.size and keys[low] == key else -1
