"""The messages of a slab that are asked for, connection by connection."""

from collections.abc import Iterator

import numpy as np
from numba import njit
from numpy.typing import NDArray

from replay.decoding.batch import RawBatch
from replay.readers.containers.place_of import place_of
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
    _part(rows, wanted, first, last, np.empty(rows.shape[1], np.int64), ends, found)
    begin = 0
    for key, end in zip(wanted.tolist(), ends.tolist(), strict=True):
        if end > begin:
            offsets, lengths, times = found[:, begin:end]
            yield RawBatch(key, data, offsets, lengths, times)
        begin = end


@njit(cache=True, nogil=True)
def _part(
    rows: Ints, wanted: Ints, first: int, last: int, owners: Ints, ends: Ints, found: Ints
) -> None:
    """Put offset, length and time of each wanted message behind those of its connection.

    Args:
        rows: (4, n) records.
        wanted: (connections,) ascending.
        first: the first log time.
        last: the last.
        owners: (n,) scratch.
        ends: (connections,) in: zeros; out: where the messages of each end in `found`.
        found: (3, n) out.
    """
    for row in range(rows.shape[1]):
        owners[row] = -1
        if first <= rows[TIME, row] <= last:
            owner = place_of(rows[KEY, row], wanted)
            if owner >= 0:
                owners[row] = owner
                ends[owner] += 1
    begin = 0
    for owner in range(wanted.size):
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
