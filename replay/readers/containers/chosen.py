"""The messages of a slab that are asked for, connection by connection."""

from collections.abc import Iterator

import numpy as np
from numba import njit
from numpy.typing import NDArray

from replay.messages.batch import RawBatch
from replay.readers.containers.places import places_of
from replay.readers.containers.records import KEY, LENGTH, OFFSET, TIME

Ints = NDArray[np.int64]


def chosen_batches(
    data: NDArray[np.uint8], rows: Ints, wanted: Ints, first: int, last: int
) -> Iterator[RawBatch]:
    """A batch for each connection that has messages in a slab, in their order.

    Args:
        data: (bytes,) of the slab.
        rows: (4, n) its records.
        wanted: (connections,) ascending.
        first: the first log time, in ns.
        last: the last.
    """
    ends = np.zeros(wanted.size, np.int64)
    found = np.empty((3, rows.shape[1]), np.int64)
    _part(rows, places_of(rows[KEY], wanted), first, last, ends, found)
    begin = 0
    for key, end in zip(wanted.tolist(), ends.tolist(), strict=True):
        if end > begin:
            offsets, lengths, times = found[:, begin:end]
            yield RawBatch(key, data, offsets, lengths, times)
        begin = end


@njit(cache=True, nogil=True)
def _part(rows: Ints, owners: Ints, first: int, last: int, ends: Ints, found: Ints) -> None:
    """Put offset, length and time of each wanted message behind those of its connection.

    Args:
        rows: (4, n) records.
        owners: (n,) whose each is, -1 where nobody wants it; those of other times become that.
        first: the first log time.
        last: the last.
        ends: (connections,) in: zeros; out: where the messages of each end in `found`.
        found: (3, n) out.
    """
    for row in range(rows.shape[1]):
        if not first <= rows[TIME, row] <= last:
            owners[row] = -1
        elif owners[row] >= 0:
            ends[owners[row]] += 1
    begin = 0
    for owner in range(ends.size):
        count = ends[owner]
        ends[owner] = begin
        begin += count
    for row in range(rows.shape[1]):
        owner = owners[row]
        if owner >= 0:
            place = ends[owner]
            found[0, place] = rows[OFFSET, row]
            found[1, place] = rows[LENGTH, row]
            found[2, place] = rows[TIME, row]
            ends[owner] = place + 1
