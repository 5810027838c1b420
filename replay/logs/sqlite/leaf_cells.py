"""Compiled parser of a cell of a SQLite table's leaf page: a row, or its first part."""

from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from estimators.compiled import compiled_without_refcounts
from replay.logs.sqlite.database_pages import PageLayout
from replay.logs.storage import LARGEST_BYTES

#: Serial types of values: 0 null, 1 to 6 integers, 7 a float, 8 and 9 the integers 0 and 1; from 12
#: on, even types are blobs and odd ones texts.
_NULL: Final = 0
_FLOAT: Final = 7
_ZERO: Final = 8
_ONE: Final = 9
_BLOB: Final = 12

#: Kinds of cells: a message; damaged; with values of other types than a message, which SQLite
#: permits; or with a layout that no recorder writes, which is left to SQLite.
MESSAGE, DAMAGED, NO_MESSAGE, UNUSUAL = range(4)


@compiled_without_refcounts
def read_big_endian(data: NDArray[np.uint8], offset: int, size: int) -> int:
    """Read an unsigned big-endian integer of less than 8 bytes."""
    value = np.int64(0)
    for k in range(size):
        value = (value << np.int64(8)) | np.int64(data[offset + k])
    return value  # pyright: ignore[reportReturnType] an int outside of numba


@compiled_without_refcounts
def read_signed_integer(data: NDArray[np.uint8], offset: int, size: int) -> int:
    """Read a big-endian two's complement integer of 1 to 8 bytes."""
    value = np.int64(data[offset])
    if value > 127:
        value -= np.int64(256)
    for k in range(1, size):
        value = (value << np.int64(8)) | np.int64(data[offset + k])
    return value  # pyright: ignore[reportReturnType] an int outside of numba


#: Integer, and offset after it; the offset is -1 if the integer is incomplete.
IntegerAndEnd: TypeAlias = tuple[int, int]


@compiled_without_refcounts
def read_varint_and_end(data: NDArray[np.uint8], offset: int, end: int) -> IntegerAndEnd:
    """Read an SQLite varint of 1 to 9 bytes; return its value and the offset after it.

    The offset is -1 if the varint does not end before or at `end`.
    """
    value, bits, stop = np.int64(0), 0, -1
    # with several returns, numba would count references to the data, which takes longer than this
    while offset < end and stop < 0:
        byte = np.int64(data[offset])
        offset += 1
        if bits == 56:
            value = (value << np.int64(8)) | byte
            stop = offset
        else:
            value = (value << np.int64(7)) | (byte & np.int64(127))
            bits += 7
            if byte < 128:
                stop = offset
    return value, stop  # pyright: ignore[reportReturnType] an int outside of numba


@compiled_without_refcounts
def count_value_bytes(serial_type: int) -> int:
    """Bytes of a value of a serial type; -1 for an invalid type."""
    if serial_type >= _BLOB:
        return (serial_type - _BLOB) // 2
    if serial_type < 0 or serial_type > _ONE:
        return -1
    if serial_type <= 4:
        return serial_type
    if serial_type == 5:
        return 6
    return 8 if serial_type <= _FLOAT else 0


@compiled_without_refcounts
def _count_local_bytes(record_bytes: int, usable_page_bytes: int) -> int:
    """Number of a record's bytes in its leaf; the rest is on overflow pages."""
    if record_bytes <= usable_page_bytes - 35:
        return record_bytes
    least = (usable_page_bytes - 12) * 32 // 255 - 23
    some = least + (record_bytes - least) % (usable_page_bytes - 4)
    return some if some <= usable_page_bytes - 35 else least


@compiled_without_refcounts
def parse_row_cell(
    data: NDArray[np.uint8],
    offset: int,
    start: int,
    end: int,
    layout: PageLayout,
    is_message_wanted: bool,
) -> tuple[int, int, int, int, int, int, int, int]:
    """Parse the cell at `offset` in a page with its cells in [begin, end).

    Returns:
        Kind (`MESSAGE`, `DAMAGED`, `NO_MESSAGE` or `UNUSUAL`), row id, topic, time, start and size
        of the message, its bytes in the leaf, and the end of the record's part in the leaf.
    """
    damaged = (DAMAGED, 0, 0, 0, 0, 0, 0, 0)
    payload, row_id, offset, stop = parse_cell_header(data, offset, start, end, layout)
    if stop < 0:
        return damaged
    head, field = read_varint_and_end(data, offset, stop)
    if field < 0 or head < 0 or head > stop - offset:
        return damaged
    what = MESSAGE if payload <= LARGEST_BYTES else UNUSUAL
    head_end = body = offset + head
    column, topic, time, message, length = 0, 0, 0, 0, 0
    while field < head_end:
        kind, field = read_varint_and_end(data, field, head_end)
        size = count_value_bytes(kind)
        if field < 0 or size < 0 or size > offset + payload - body:
            return damaged
        if column == layout.data:
            message, length = body, size
            if is_message_wanted and (kind < _BLOB or kind % 2 == 1):
                what = max(what, NO_MESSAGE)
        elif column == layout.topic:
            topic, found = read_integer_column(data, body, kind, size, stop)
            what = max(what, found)
        elif column == layout.time:
            time, found = read_integer_column(data, body, kind, size, stop)
            what = max(what, found)
        body += size
        column += 1
    if field != head_end or body != offset + payload:
        return damaged
    local = min(length, stop - message)
    # missing columns, which were added later, and columns after a message on overflow pages
    if column < layout.columns or local < 0 or (local < length and message + length < body):
        what = UNUSUAL
    return what, row_id, topic, time, message, length, local, stop


#: Bytes of the record, row id, start of the record, and end of its part in the leaf.
CellHeader: TypeAlias = tuple[int, int, int, int]


@compiled_without_refcounts
def parse_cell_header(
    data: NDArray[np.uint8], offset: int, start: int, end: int, layout: PageLayout
) -> CellHeader:
    """Parse a cell's header: size of its record, row id, start, and end of its part in the leaf.

    The end is -1 if the cell is damaged.
    """
    damaged = (0, 0, 0, -1)
    if offset < start or offset >= end:
        return damaged
    payload, offset = read_varint_and_end(data, offset, end)
    if offset < 0 or payload < 0 or payload > layout.pages * layout.page_bytes:
        return damaged
    row_id, offset = read_varint_and_end(data, offset, end)
    if offset < 0:
        return damaged
    here = _count_local_bytes(payload, layout.usable_bytes)
    stop = offset + here
    if stop + (4 if here < payload else 0) > end:
        return damaged
    return payload, row_id, offset, stop


#: Integer, and the kind of row that has such a value: MESSAGE, NO_MESSAGE or UNUSUAL.
IntegerAndClass: TypeAlias = tuple[int, int]


@compiled_without_refcounts
def read_integer_column(
    data: NDArray[np.uint8], offset: int, serial_type: int, size_bytes: int, stop_offset: int
) -> IntegerAndClass:
    """Read the integer of a column, and classify whether its row is a message.

    Returns:
        The integer, 0 if there is none; and MESSAGE, NO_MESSAGE or UNUSUAL.
    """
    if serial_type in (_NULL, _FLOAT) or serial_type > _ONE:
        return 0, NO_MESSAGE
    if offset + size_bytes > stop_offset:
        return 0, UNUSUAL
    return (
        serial_type - _ZERO if size_bytes == 0 else read_signed_integer(data, offset, size_bytes)
    ), MESSAGE
