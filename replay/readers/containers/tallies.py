"""What the blocks of a slab hold: messages by connection, and between which log times."""

from typing import Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from replay.readers.containers.places import places_of
from replay.readers.containers.records import KEY, TIME, Slab

Ints = NDArray[np.int64]

_INT64_MAX: Final = 2**63 - 1


class Tally(NamedTuple):
    """Of one block."""

    #: by connection, in the order of the keys that were asked for; then those of all others
    counts: list[int]
    #: log times in ns, of those that are none of the year 2262 and later
    first_ns: int
    last_ns: int
    #: messages of such times
    late: int


def tallies(slab: Slab, keys: Ints) -> list[Tally]:
    """A tally for each of `slab.parts`; `keys` (connections,) ascend."""
    bounds = np.array([part[1:3] for part in slab.parts], np.int64).reshape(-1, 2)
    counts = np.zeros((len(bounds), keys.size + 1), np.int64)
    spans = np.tile(np.array([_INT64_MAX, -1, 0]), (len(bounds), 1))
    # -1, of a key that nobody asked for, is the last: that of all others
    _count(slab.rows, bounds, places_of(slab.rows[KEY], keys), counts, spans)
    pairs = zip(counts.tolist(), spans.tolist(), strict=True)
    return [Tally(held, *span) for held, span in pairs]


@njit(cache=True, nogil=True)
def _count(rows: Ints, bounds: Ints, owners: Ints, counts: Ints, spans: Ints) -> None:
    for part in range(bounds.shape[0]):
        for row in range(bounds[part, 0], bounds[part, 1]):
            time = rows[TIME, row]
            if rows[KEY, row] < 0:
                continue
            counts[part, owners[row]] += 1
            if time < 0:
                spans[part, 2] += 1
            else:
                spans[part, 0] = min(spans[part, 0], time)
                spans[part, 1] = max(spans[part, 1], time)
