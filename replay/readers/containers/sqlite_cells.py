"""Find the rows in leaf pages of a SQLite table, compiled: a row costs some tens of nanoseconds."""

from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from replay.readers.containers.block import LARGEST_BYTES
from replay.readers.containers.records import KEY, LENGTH, OFFSET, TIME
from replay.readers.containers.sqlite_pages import Layout, Wanted

#: The row of ids in what `records` gives rows of.
ID: Final = 4

LEAF: Final = 13
_PAGE_HEAD: Final = 8
#: A record's types: 0 null, 1 to 6 integers, 7 a float, 8 and 9 the integers 0 and 1, from 12 on
#: even blobs and odd texts.
_FLOAT: Final = 7
_ONE: Final = 9
_BLOB: Final = 12

#: Of a spilled row: which it is, where in the leaf its message begins, and how many bytes of it are
#: there; the first overflow page, and how many bytes are on that and those behind it.
ROW, BEGIN, LOCAL, PAGE, REST = range(5)
#: Where a scan is: the leaf, the cell in it, and the id of the row before.
LEAF_AT, CELL_AT, ID_BEFORE = range(3)


@njit(cache=True, nogil=True)
def big_endian(data: NDArray[np.uint8], at: int, size: int) -> int:
    """An unsigned integer of less than 8 bytes."""
    value = np.int64(0)
    for k in range(size):
        value = (value << np.int64(8)) | np.int64(data[at + k])
    return value  # pyright: ignore[reportReturnType] an int outside of numba


@njit(cache=True, nogil=True)
def varint(data: NDArray[np.uint8], at: int, end: int) -> tuple[int, int]:
    """An integer of 1 to 9 bytes, and where it ends: -1 where not before `end`."""
    value, bits, stop = np.int64(0), 0, -1
    # with several ways out numba would count references to the data, which takes longer than this
    while at < end and stop < 0:
        byte = np.int64(data[at])
        at += 1
        if bits == 56:
            value = (value << np.int64(8)) | byte
            stop = at
        else:
            value = (value << np.int64(7)) | (byte & np.int64(127))
            bits += 7
            if byte < 128:
                stop = at
    return value, stop  # pyright: ignore[reportReturnType] an int outside of numba


@njit(cache=True, nogil=True)
def _signed(data: NDArray[np.uint8], at: int, size: int) -> int:
    """A two's complement integer of 1 to 8 bytes."""
    value = np.int64(data[at])
    if value > 127:
        value -= np.int64(256)
    for k in range(1, size):
        value = (value << np.int64(8)) | np.int64(data[at + k])
    return value  # pyright: ignore[reportReturnType] an int outside of numba


@njit(cache=True, nogil=True)
def _size(kind: int) -> int:
    """Bytes of a value of a record's type; -1 for what is no type."""
    if kind >= _BLOB:
        return (kind - _BLOB) // 2
    if kind < 0 or kind > _ONE:
        return -1
    if kind <= 4:
        return kind
    if kind == 5:
        return 6
    return 8 if kind <= _FLOAT else 0


@njit(cache=True, nogil=True)
def _local_bytes(payload: int, usable: int) -> int:
    """How much of a record stands in its leaf; the rest is on overflow pages."""
    if payload <= usable - 35:
        return payload
    least = (usable - 12) * 32 // 255 - 23
    some = least + (payload - least) % (usable - 4)
    return some if some <= usable - 35 else least


@njit(cache=True, nogil=True)
def _parse(
    data: NDArray[np.uint8], at: int, end: int, layout: Layout
) -> tuple[int, int, int, int, int, int, int]:
    """What a cell holds, and whether it is a usual row.

    Returns:
        Id, topic, time; where the message begins, its bytes, and those of them in the leaf; and
        where the leaf's part of the record ends, -1 for what is damaged or unusual.
    """
    none = (0, 0, 0, 0, 0, 0, -1)
    payload, at = varint(data, at, end)
    if at < 0 or payload < 0 or payload > min(LARGEST_BYTES, layout.pages * layout.page_bytes):
        return none
    row_id, at = varint(data, at, end)
    if at < 0:
        return none
    here = _local_bytes(payload, layout.usable_bytes)
    stop = at + here
    if stop + (4 if here < payload else 0) > end:
        return none
    head, field = varint(data, at, stop)
    if field < 0 or head < 0 or head > here:
        return none
    head_end = at + head
    body = head_end
    topic, time, begin, length = 0, 0, 0, 0
    for column in range(layout.columns):
        kind, field = varint(data, field, head_end)
        size = _size(kind)
        if field < 0 or size < 0 or size > at + payload - body:
            return none
        if column in (layout.topic, layout.time):
            if kind == 0 or kind == _FLOAT or kind > _ONE or body + size > stop:
                return none
            value = kind - 8 if size == 0 else _signed(data, body, size)
            if column == layout.topic:
                topic = value
            else:
                time = value
        elif column == layout.data:
            if kind < _BLOB or kind % 2 == 1:
                return none
            begin, length = body, size
        body += size
    if field != head_end or body != at + payload:
        return none
    local = min(length, stop - begin)
    # what stands behind a message on overflow pages would have to be told from it
    if local < 0 or (local < length and begin + length != body):
        return none
    return row_id, topic, time, begin, length, local, stop


@njit(cache=True, nogil=True)
def _holds(keys: NDArray[np.int64], key: int) -> bool:
    first, last = 0, keys.size
    while first < last:
        middle = (first + last) // 2
        if keys[middle] < key:
            first = middle + 1
        else:
            last = middle
    return first < keys.size and keys[first] == key


@njit(cache=True, nogil=True)
def scan_leaves(
    data: NDArray[np.uint8],
    leaves: NDArray[np.int64],
    layout: Layout,
    wanted: Wanted,
    tail: int,
    room: int,
    place: NDArray[np.int64],
    rows: NDArray[np.int64],
    spills: NDArray[np.int64],
) -> tuple[int, int, int, bool]:
    """Wanted rows in leaf pages, until there is no more room or a cell is damaged.

    Args:
        data: holds the pages.
        leaves: (pages,) where in `data` each begins.
        layout: of the pages.
        wanted: which rows.
        tail: where in `data` messages from overflow pages will stand.
        room: bytes that these may take, unless it is a single one.
        place: (3,) the page to begin with, counted in `leaves`, its cell, and the id of the row
            before; becomes where the scan stopped.
        rows: (5, n) is filled, as `records` has it, and with ids.
        spills: (5, m) is filled: rows whose message is not whole in its leaf.

    Returns:
        Rows and spilled rows found, bytes behind `tail` that these need, and whether the place
        where it stopped is whole.
    """
    found = spilled = used = 0
    while place[LEAF_AT] < leaves.size:
        base = int(leaves[place[LEAF_AT]])
        end = base + layout.usable_bytes
        cells = big_endian(data, base + 3, 2)
        pointers = base + _PAGE_HEAD
        contents = pointers + 2 * cells
        if data[base] != LEAF or cells == 0 or contents > end:
            return found, spilled, used, False
        while place[CELL_AT] < cells:
            at = base + big_endian(data, pointers + 2 * int(place[CELL_AT]), 2)
            if at < contents or at >= end:
                return found, spilled, used, False
            row_id, topic, time, begin, length, local, stop = _parse(data, at, end, layout)
            if stop < 0:
                return found, spilled, used, False
            in_time = time >= wanted.first_ns and time <= wanted.last_ns
            if in_time and (wanted.every_topic or _holds(wanted.keys, topic)):
                if found == rows.shape[1]:
                    return found, spilled, used, True
                offset = begin
                if local < length and wanted.with_data:
                    if spilled == spills.shape[1] or (used and used + length > room):
                        return found, spilled, used, True
                    offset = tail + used
                    used += length
                    spills[ROW, spilled] = found
                    spills[BEGIN, spilled] = begin
                    spills[LOCAL, spilled] = local
                    spills[PAGE, spilled] = big_endian(data, stop, 4)
                    spills[REST, spilled] = length - local
                    spilled += 1
                rows[KEY, found] = topic
                rows[TIME, found] = time
                rows[OFFSET, found] = offset
                rows[LENGTH, found] = length
                rows[ID, found] = row_id
                found += 1
            place[ID_BEFORE] = row_id
            place[CELL_AT] += 1
        place[LEAF_AT] += 1
        place[CELL_AT] = 0
    return found, spilled, used, True
