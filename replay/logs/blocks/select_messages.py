"""Select messages of a slab by connection and log time, and count the contents of chunks."""

from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Ints
from estimators.interpreted import compiled
from replay.logs.blocks.slabs import Slab
from replay.logs.messages.raw_batch import RawBatch
from replay.logs.storage import KEY, LENGTH, OFFSET, TIME

#: Later than any log time, ns.
_INT64_MAX: Final = 2**63 - 1


def select_messages_of_connections(
    data: NDArray[np.uint8], rows: Ints, wanted: Ints, first: int, last: int
) -> Iterator[RawBatch]:
    """Select messages of a slab, as one batch per connection with messages.

    Args:
        data: (bytes,) bytes of the slab.
        rows: (4, n) records of the slab.
        wanted: (connections,) requested connections, ascending.
        first: first log time in ns.
        last: last log time in ns.
    """
    ends = np.zeros(wanted.size, np.int64)
    found = np.empty((3, rows.shape[1]), np.int64)
    fill_wanted_messages(rows, indices_of_keys(rows[KEY], wanted), first, last, ends, found)
    begin = 0
    for key, end in zip(wanted.tolist(), ends.tolist(), strict=True):
        if end > begin:
            offsets, lengths, times = found[:, begin:end]
            yield RawBatch(key, data, offsets, lengths, times)
        begin = end


@compiled
def fill_wanted_messages(
    rows: Ints, owners: Ints, first: int, last: int, ends: Ints, found: Ints
) -> None:
    """Store offset, length and time of each requested message, grouped by connection.

    Args:
        rows: (4, n) records.
        owners: (n,) index of the requested connection of each message, or -1 if not requested;
            out: -1 also for messages outside the interval.
        first: first log time.
        last: last log time.
        ends: (connections,) in: zeros; out: end of each connection's messages in `found`.
        found: (3, n) output.
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


def indices_of_keys(values: Ints, keys: Ints) -> Ints:
    """Index of each of `values` (n,) in the ascending `keys`; -1 if absent."""
    places = np.empty(values.size, np.int64)
    _fill_key_indices(values, keys, places)
    return places


@compiled
def _fill_key_indices(found: Ints, keys: Ints, places: Ints) -> None:
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


class ChunkStats(NamedTuple):
    """Statistics of a block."""

    #: by connection, in the order of the keys that were asked for; then those of all others
    counts: list[int]
    #: log times in ns, of those that are none of the year 2262 and later
    first_ns: int
    last_ns: int
    #: messages of such times
    late: int


def chunk_stats(slab: Slab, keys: Ints) -> list[ChunkStats]:
    """Count the contents of each of `slab.parts`; `keys` (connections,) are ascending."""
    bounds = np.array([part[1:3] for part in slab.parts], np.int64).reshape(-1, 2)
    counts = np.zeros((len(bounds), keys.size + 1), np.int64)
    spans = np.tile(np.array([_INT64_MAX, -1, 0]), (len(bounds), 1))
    # -1, of a key that nobody asked for, is the last: that of all others
    _count_messages_per_block(
        slab.rows, bounds, indices_of_keys(slab.rows[KEY], keys), counts, spans
    )
    pairs = zip(counts.tolist(), spans.tolist(), strict=True)
    return [ChunkStats(held, *span) for held, span in pairs]


@compiled
def _count_messages_per_block(
    rows: Ints, bounds: Ints, owners: Ints, counts: Ints, spans: Ints
) -> None:
    """Count messages and time span of each block, by connection."""
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
